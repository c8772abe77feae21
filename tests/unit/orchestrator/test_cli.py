"""The command line: exit codes, JSON that can be parsed, results on standard output and the rest beside it."""

import json
import os
import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_cli.main import GROUPS, main
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import EXIT_CODES, FAILED, INTERRUPTED, MISSED, OK, USAGE
from deltaswarm_orchestrator.results.folder import RunFolder
from deltaswarm_orchestrator.results.folder_lock import OWNER
from deltaswarm_orchestrator.results.run_tables import new_manifest
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import __version__
from deltaswarm_wire.checked import load
from tests.support.complaints import Printed
from tests.support.swarms import COMMAND
from tests.support.tiers import in_one_test

SHORT = ["--in-process", "--set", "run.duration_s=40", "--set", "control.delta=2"]


def refused(*arguments: str) -> int:
    """The exit code of a command line that its parser refuses."""
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return int(caught.value.code or 0)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A finished run, by the command itself: its folder, and the JSON that was printed."""
    out = tmp_path_factory.mktemp("runs") / "mine"
    arguments = ["run", "smoke", *SHORT, "--seed", "3", "--json", "--out", str(out)]
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, check=True)
    return out, json.loads(done.stdout)


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    """As `head`: the command ends with exit code 1 and says nothing."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing) as output:
        command = [*COMMAND, "run", "paper-25", "--dry-run"]
        done = subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "")


def on_streams(redirection: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A command whose standard streams are redirected by a shell."""
    line = f"exec {shlex.join([*COMMAND, *arguments])} {redirection}"
    return subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False)


@in_one_test("arguments", [["list"], ["list", "--json"], ["--help"], ["run", "smoke", "--dry-run"]])
def test_a_result_that_nothing_can_hold_is_a_failure(arguments: list[str]) -> None:
    """On a full disk, for example: one line, exit code 1."""
    done = on_streams(">/dev/full", *arguments)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "standard output" in done.stderr


@pytest.mark.parametrize(
    "redirection", [">&-", "2>&-", "<&- >&- 2>&-", "2>/dev/full", ">/dev/full", ">/dev/full 2>/dev/full"]
)
def test_what_becomes_of_the_output_changes_no_result(
    redirection: str, finished: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    """Closed or full: the exit code, the digest and the files are those of any other run."""
    out = tmp_path / "out"
    done = on_streams(redirection, "run", "smoke", *SHORT, "--seed", "3", "--out", str(out))
    assert done.returncode == 0
    assert done.stderr.count("Error") == 0
    assert done.stderr.count("standard output") == (redirection == ">/dev/full")
    assert json.loads((out / "summary.json").read_text())["digest"] == finished[1]["digest"]
    assert {path.name for path in out.iterdir()} == {path.name for path in finished[0].iterdir()}


def test_a_sweep_without_streams_is_done(tmp_path: Path) -> None:
    shorter = ["--repeats", "1", "--prove", "1", "--set", "run.duration_s=20", "--out", str(tmp_path / "out")]
    assert on_streams("<&- >&- 2>&-", "sweep", "smoke", *shorter).returncode == 0
    assert (tmp_path / "out" / "table.csv").stat().st_size > 0


def test_a_reader_that_leaves_a_run_changes_no_result(finished: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    """As `head`, of a command whose result is on disk."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing) as output:
        command = [*COMMAND, "run", "smoke", *SHORT, "--seed", "3", "--json", "--out", str(tmp_path / "out")]
        done = subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["digest"] == finished[1]["digest"]


def test_a_pipe_that_does_not_block_gets_everything(tmp_path: Path) -> None:
    """Programs that share a terminal or a pipe may make it so; each writer then has to wait."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with os.fdopen(writing) as output, os.fdopen(reading, "rb") as received:
        code = "import sys; print('x' * 1_000_000)"
        start = f"from deltaswarm_orchestrator.base.output import open_outputs; open_outputs(); {code}"
        process = subprocess.Popen([*COMMAND[:1], "-c", start], stdout=output)
        output.close()
        assert len(received.read()) == 1_000_001
        assert process.wait() == 0


def test_an_interrupted_command_says_so(monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    """In a line, also where the command itself has nothing to say of it; exit code 130."""

    def interrupted(arguments: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("deltaswarm_cli.run.run", interrupted)
    assert main(["run", "paper-25"]) == 130
    assert capsys.readouterr().err == "deltaswarm: interrupted\n"


def test_the_version_is_the_packages(capsys: Printed) -> None:
    assert refused("--version") == 0
    assert capsys.readouterr().out == f"deltaswarm {__version__}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["walk"],
        ["run", "--seed", "many"],
        ["run", "--record", "video"],
        ["run", "--set"],
        ["run", "--zenoh", "novalue"],
        ["run", "--unknown"],
        ["run", "smoke", "smoke"],
        ["info"],
        ["doctor", "smoke", "me"],
        ["why", "runs/a", "1", "b", "--at", "3"],
    ],
    ids=lambda value: " ".join(value) or "nothing",
)
def test_wrong_usage_ends_with_2(arguments: list[str], capsys: Printed) -> None:
    """The complaint goes to standard error, and to nothing else."""
    assert refused(*arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "error: " in printed.err


def test_the_help_explains_every_exit_code(capsys: Printed) -> None:
    """A line each, from the table that the commands use."""
    assert refused("--help") == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert all([str(code), meaning] in lines for code, meaning in EXIT_CODES.items())
    assert {OK, FAILED, USAGE, MISSED, INTERRUPTED} == set(EXIT_CODES)


def test_the_help_has_every_command_in_its_group(capsys: Printed) -> None:
    """Without commands of other packages, whose group comes last."""
    assert refused("--help") == 0
    printed = capsys.readouterr().out
    assert all(f"  {title}:\n" in printed for title in GROUPS)
    assert "other packages:" not in printed


def test_a_dry_run_prints_the_effective_scenario_and_starts_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """As TOML that is a scenario; no folder is made."""
    monkeypatch.chdir(tmp_path)
    arguments = ["run", "smoke", "--set", "radio.loss=0.25", "--seed", "8", "--record", "wire", "--dry-run"]
    assert main(arguments) == 0
    printed = load(Scenario, tomllib.loads(capsys.readouterr().out))
    assert printed == load_scenario("smoke", ["radio.loss=0.25", "record=wire"], 8)
    assert list(tmp_path.iterdir()) == []


def test_json_is_all_that_a_run_prints(finished: tuple[Path, dict[str, Any]]) -> None:
    """One object: the summary, with the folder and how the run ended."""
    out, printed = finished
    assert (printed["folder"], printed["exit_reason"]) == (str(out), "finished")
    summary = json.loads((out / "summary.json").read_text())
    assert printed == {"folder": str(out), "exit_reason": "finished", **summary}
    assert (printed["valid"], printed["steps"], printed["seed"]) == (True, 40, 3)


def test_a_run_without_json_prints_a_table(tmp_path: Path, capsys: Printed) -> None:
    """With the figures, and last the folder; how it goes is told on standard error. No colours on a pipe."""
    out = tmp_path / "run"
    assert main(["run", "smoke", *SHORT, "--record", "off", "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "mean waiting time" in printed.out
    assert printed.out.rstrip().replace("\n", "").endswith(str(out))
    assert "\x1b" not in printed.out + printed.err
    assert "39/40 s" in printed.err


def test_runs_have_folders_of_their_own_by_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two in the same second as well, named after what they are."""
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert main(["run", "smoke", *SHORT, "--record", "off", "--json"]) == 0
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert len(names) == 2
    assert all(name.startswith("smoke-hybrid-seed1-") for name in names)


def test_info_tells_of_a_finished_run(finished: tuple[Path, dict[str, Any]], capsys: Printed) -> None:
    out, printed = finished
    assert main(["info", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["summary"] == json.loads((out / "summary.json").read_text())
    assert found["manifest"]["digest"] == printed["digest"]
    assert {"events.csv", "manifest.json", "recording.mcap", "scenario.toml", "series.csv", "summary.json"} <= set(
        found["files"]
    )


def test_info_tells_it_to_people_too(finished: tuple[Path, dict[str, Any]], capsys: Printed) -> None:
    out, printed = finished
    assert main(["info", str(out)]) == 0
    text = capsys.readouterr().out
    assert {"smoke", "hybrid", "complete"} <= set(re.findall(r"\w+", text.splitlines()[0]))
    assert printed["digest"] in text
    assert ["steps", "40"] in [line.split() for line in text.splitlines()]


def test_info_tells_of_an_interrupted_run(
    finished: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: Printed
) -> None:
    """From what there is of it: the figures so far, and that it is not all."""
    (tmp_path / "scenario.toml").write_bytes((finished[0] / "scenario.toml").read_bytes())
    manifest = json.loads((finished[0] / "manifest.json").read_text())
    seal.write_sealed(tmp_path / "manifest.json", manifest, seal.digests(tmp_path, ["scenario.toml"]))
    rows = (finished[0] / "series.csv").read_text().splitlines(keepends=True)
    (tmp_path / "series.csv").write_text("".join(rows[:11]) + rows[11][:9])
    assert main(["info", str(tmp_path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)["summary"]
    assert (summary["steps"], summary["complete"], summary["valid"]) == (10, False, False)
    assert main(["info", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "not valid" in text
    assert ["not", "sealed", "series.csv"] in [line.split() for line in text.splitlines()]


def test_info_calls_a_run_that_was_killed_after_its_last_step_incomplete(
    finished: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: Printed
) -> None:
    """Its manifest says that it is running, so nobody knows that the recording and the tables are whole."""
    run = shutil.copytree(finished[0], tmp_path / "run.part")
    (run / "manifest.json").write_text(json.dumps(new_manifest(load_scenario("smoke"), "processes", "off")))
    assert main(["info", str(run), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["state"].startswith("incomplete (killed")
    assert (told["summary"]["complete"], told["summary"]["valid"]) == (False, False)


def test_info_tells_a_run_that_goes_on_from_one_that_was_killed(tmp_path: Path, capsys: Printed) -> None:
    """By whether its folder is held, whatever process has its number by now; where that cannot be known it says so."""
    out = tmp_path / "run"
    folder = RunFolder(out, force=False)
    folder.prepare(load_scenario("smoke"), new_manifest(load_scenario("smoke"), "in-process", "off"))

    def state() -> str:
        assert main(["info", str(folder.path), "--json"]) == 0
        return str(json.loads(capsys.readouterr().out)["state"])

    killed = "incomplete (killed, its machine stopped, or its disk was full)"
    assert [state(), state()] == ["running", "running"]
    folder.release()
    assert state() == killed
    (folder.path / OWNER).write_text('["elsewhere", "another boot", 7, "7"]')
    assert state() == f"running, or {killed}"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("manifest.json", "[]"),
        ("manifest.json", '{"versions": "x"}'),
        ("summary.json", "{"),
        ("summary.json", '"x"'),
        ("series.csv", "step\nx\n"),
    ],
)
def test_info_says_if_a_run_cannot_be_read(
    finished: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: Printed, name: str, content: str
) -> None:
    """Whichever of its files is damaged: a line instead of a traceback, and exit code 2."""
    for kept in ("manifest.json", "scenario.toml", "series.csv"):
        (tmp_path / kept).write_bytes((finished[0] / kept).read_bytes())
    (tmp_path / name).write_text(content)
    assert main(["info", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("deltaswarm: ")


@pytest.mark.parametrize(
    ("command", "facts"),
    [
        ("info .", [".", "scenario.toml"]),
        ("why . 0 1 --at 3", [".", "scenario.toml"]),
        ("info swept", ["swept", "deltaswarm report swept"]),
        ("info mine/summary.json", ["mine/summary.json"]),
        ("report mine", ["mine", "deltaswarm info mine"]),
        ("report .", [".", "manifest.json"]),
        ("report swept", ["swept", "table.csv", "deltaswarm sweep"]),
        ("run .", ["scenario ", "'.'", "folder", "paper-25"]),
        ("sweep mine", ["sweep ", "'mine'", "folder", "modes, "]),
        ("sweep based.toml", ["base ", "'mine'", "folder", "paper-25"]),
        ("run new.toml", ["schema ", "2", "1"]),
        ("bundle --platform linux_x86_64 --out mine", ["--out", "mine"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_wrong_file_or_folder_ends_with_2(
    command: str,
    facts: list[str],
    finished: tuple[Path, dict[str, Any]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Printed,
) -> None:
    """One line names the file, what is wrong with it, and what helps."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").symlink_to(finished[0])
    (tmp_path / "swept").mkdir()
    (tmp_path / "swept" / "sweep.toml").touch()
    (tmp_path / "swept" / "manifest.json").write_text('{"swept": []}')
    (tmp_path / "based.toml").write_text('schema = 1\nbase = "mine"')
    (tmp_path / "new.toml").write_text("schema = 2")
    assert main(command.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("deltaswarm: ")
    assert all(fact in line for fact in facts), line


@pytest.mark.parametrize(
    "command",
    [["run", "smoke", "--in-process", "--out"], ["sweep", "smoke", "--out"], ["info"], ["report"], ["replay"]],
)
def test_a_name_that_no_file_can_have_is_refused(command: list[str], capsys: Printed) -> None:
    """In one line, with the exit code of wrong usage."""
    assert main([*command, "x" * 300]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_recording_is_replayed_by_its_folder(tmp_path: Path, capsys: Printed) -> None:
    (tmp_path / "recording.mcap").touch()
    assert main(["replay", str(tmp_path / "recording.mcap")]) == 2
    assert "RUN must be" in capsys.readouterr().err
