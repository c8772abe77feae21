"""What commands print: with `--json` one document on standard output and nothing else; else aligned columns."""

import json
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from docs.extensions.command_line import subparsers, with_subcommands

from deltaswarm_cli.main import all_commands, main, parser
from deltaswarm_orchestrator.base.exits import aligned, shown
from deltaswarm_studies.load import COLLECTIONS
from tests.support.complaints import Printed
from tests.support.sessions import a_file, run_here
from tests.support.swarms import COMMAND
from tests.support.tiers import in_one_test

WITHOUT_JSON = {"compile", "completion", "replay"}
"""Commands without a result, as the page of commands says."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "short"
    command = ["run", "smoke", "--in-process", "--set", "run.duration_s=20", "--out", str(out)]
    subprocess.run([*COMMAND, *command], capture_output=True, check=True)
    return out


@in_one_test("command", sorted(all_commands()))
def test_every_command_with_a_result_has_json(command: str) -> None:
    for own in with_subcommands(subparsers(parser(command))[command]):
        if not subparsers(own):
            assert ("--json" in own._option_string_actions) == (command not in WITHOUT_JSON), own.prog


@pytest.mark.parametrize(
    ("command", "keys"),
    [
        ("run smoke --dry-run", {"agents", "radio", "control"}),
        ("sweep modes --dry-run", {"sweep", "repeats", "variants"}),
        ("study smoke --plan", {"study", "variants", "families"}),
        ("list", {"scenarios", "studies"}),
        ("info {run}", {"manifest", "summary"}),
        ("why {run} 0 1 --at 3", {"sender", "receiver"}),
        ("export {run} --format csv --out {new}", {"out", "complete"}),
        ("certificates --out {new} --agents 0-1 --operator-key {new}/operator.key", {"files", "operator_key"}),
    ],
)
def test_json_is_all_on_standard_output(
    command: str, keys: set[str], run: Path, tmp_path: Path, capsys: Printed
) -> None:
    assert main([*command.format(run=run, new=tmp_path / "new").split(), "--json"]) == 0
    assert keys <= json.loads(capsys.readouterr().out).keys()


@pytest.mark.parametrize(
    "command",
    [
        "run smoke --out {run}",
        "run smoke --boards 99 --listen tcp/10.0.0.1:7447",
        "run smoke --set run.bound=everything",
        "run smoke --station-listen nowhere --station",
        "sweep smoke --scheduler tcp://127.0.0.1:9",
        "sweep {sweep}/sweep.toml --seed 5 --out {sweep}",
        "study smoke --engine local --scheduler tcp://127.0.0.1:9",
        "session {tmp}/session.toml --participant 1 --agents processes",
    ],
)
def test_a_dry_run_refuses_what_a_run_would_refuse(command: str, run: Path, tmp_path: Path, capsys: Printed) -> None:
    """In the same words and with exit code 2, and neither writes anything."""
    if "{sweep}" in command:
        assert main(["sweep", "smoke", "--repeats", "1", "--prove", "0", "--out", str(tmp_path / "swept")]) == 0
    wrong = 'scenario = "smoke"\nset = ["run.bound=everything"]\n'
    (tmp_path / "session.toml").write_text(f'schema = 1\n[[session.condition]]\nlabel = "a"\n{wrong}')
    words = command.format(run=run, sweep=tmp_path / "swept", tmp=tmp_path).split()
    before = sorted(tmp_path.rglob("*"))
    told = []
    for more in ([], ["--dry-run"]):
        capsys.readouterr()
        with suppress(SystemExit):
            assert main([*words, *more]) == 2
        told.append(capsys.readouterr())
    assert sorted(tmp_path.rglob("*")) == before
    assert told[0].err.splitlines()[-1] == told[1].err.splitlines()[-1] != ""
    assert told[1].out == ""


@pytest.mark.parametrize("command", ["run smoke", "sweep smoke", "study smoke", "session {file} --participant 3"])
def test_a_dry_run_starts_and_writes_nothing(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.chdir(tmp_path)
    words = command.format(file=a_file(tmp_path)).split()
    before = sorted(tmp_path.rglob("*"))
    assert main([*words, "--dry-run"]) == 0
    assert capsys.readouterr().out
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "command",
    [
        "run smoke --in-process --set run.duration_s=20 --out {new}",
        "sweep smoke --repeats 1 --prove 0 --out {new}",
        "session {file} --participant 3 --out {new}",
    ],
)
def test_a_quiet_command_says_nothing_beside_its_result(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """No progress, no notices; without the option there are some."""
    words = command.format(new=tmp_path / "new", file=a_file(tmp_path)).split()
    if words[0] == "session":
        monkeypatch.setattr("deltaswarm_cli.report.run_and_report", lambda *_, quiet: 0 if quiet else 1)
        monkeypatch.setattr("deltaswarm_serving.alone.serve", run_here)
    assert main([*words, "--quiet"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out
    words[words.index(str(tmp_path / "new"))] = str(tmp_path / "other")
    main(words)
    assert capsys.readouterr().err


def test_a_quiet_command_still_says_what_is_wrong(run: Path, capsys: Printed) -> None:
    assert main(["run", "smoke", "-q", "--out", str(run)]) == 2
    assert str(run) in capsys.readouterr().err


@pytest.mark.parametrize("count", [2, pytest.param(None, marks=pytest.mark.slow)])
def test_a_collection_is_a_list(count: int | None, monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    monkeypatch.setitem(COLLECTIONS, "beyond", COLLECTIONS["beyond"][:count])
    monkeypatch.setattr("deltaswarm_studies.plan.MEASURED_S", 0.0)
    assert main(["study", "beyond", "--plan", "--json"]) == 0
    assert [one["study"] for one in json.loads(capsys.readouterr().out)] == COLLECTIONS["beyond"]


def test_columns_begin_at_the_same_place() -> None:
    """Whatever the width of their cells; no line ends with a space."""
    assert aligned([("a", "b"), ("long", "")]) == "a     b\nlong"


@in_one_test(
    ("value", "text"),
    [(None, "-"), (True, "yes"), (False, "NO"), (0.126, "0.13"), (1234.5, "1234"), (7, "7"), ("a", "a")],
)
def test_a_value_is_short(value: object, text: str) -> None:
    """Fractions have two decimals, or none where they are large."""
    assert shown(value) == text


def test_nothing_slow_is_imported_before_signals_are_heeded() -> None:
    """A Ctrl-C that comes earlier ends in Python's traceback."""
    code = "import deltaswarm_orchestrator.__main__, sys; print(*{name.partition('.')[0] for name in sys.modules})"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not {"msgpack", "numpy", "zenoh", "deltaswarm_wire"} & set(printed.split())


LOUD = """
import multiprocessing
import os
import sys
import threading
import time

from deltaswarm_agent.controller import Decision
from deltaswarm_wire.plugins import NoSettings


def say(text):
    print(text)
    os.write(1, f"{text} by the descriptor\\n".encode())
    os.system(f"echo {text} by a shell")
    print(f"{text} by the first stream", file=sys.__stdout__, flush=True)


def keep_saying():
    while True:
        print("thread")
        time.sleep(0.01)


say("import")


class Loud:
    Settings = NoSettings

    def __init__(self, context):
        self.agent = context.agent

    def step(self, percept):
        if percept.step == 3 and self.agent == 1:
            say("step")
            threading.Thread(target=keep_saying).start()
            multiprocessing.get_context("fork").Process(target=time.sleep, args=(600,)).start()
        if percept.step == 5 and self.agent == 2:
            self.fail()
        return Decision()

    def fail(self):
        raise BrokenPipeError(32, "Broken pipe")
"""
SHORT = ["run", "smoke", "--in-process", "--set", "run.duration_s=10", "--set", "control.mode=loud:Loud"]


def test_standard_output_is_for_results_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a controller prints, and by whatever means; its threads and processes do not keep the command alive."""
    (tmp_path / "loud.py").write_text(LOUD)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    command = [*COMMAND, *SHORT, "--out", str(tmp_path / "run"), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert json.loads(done.stdout)["folder"] == str(tmp_path / "run")
    for said in ("import", "step"):
        for means in ("", " by the descriptor", " by a shell", " by the first stream"):
            assert f"{said}{means}\n" in done.stderr
    assert "loud.py:" in done.stderr
    assert done.stderr.count("Traceback") == 1


def test_the_debugger_stops_where_a_controller_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In its own frame; the run ends when the debugger is left."""
    (tmp_path / "loud.py").write_text(LOUD)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    command = [*COMMAND, *SHORT, "--debug", "--out", str(tmp_path / "run"), "--json"]
    asked = "p f'agent {self.agent}'\nup\np percept.step\nq\n"
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, input=asked)
    assert json.loads(done.stdout)["steps"] < 10
    assert "'agent 2'" in done.stderr
    assert "(Pdb) 5\n" in done.stderr
