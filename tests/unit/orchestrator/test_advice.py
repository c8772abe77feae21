"""Advice is what was given: each command line that a command prints can be run as it stands; and where results go."""

import json
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from deltaswarm_cli import report
from deltaswarm_cli.main import main, parser
from deltaswarm_cli.run import KEPT
from deltaswarm_orchestrator.base.advice import as_given, command_line, options_given
from deltaswarm_orchestrator.base.exits import INTERRUPTED
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_orchestrator.sweeps import engine
from deltaswarm_orchestrator.sweeps.engine import Done
from deltaswarm_orchestrator.sweeps.job import Task
from deltaswarm_scenario.scenario import Scenario
from tests.support.complaints import Printed
from tests.support.fields import free_port
from tests.support.sessions import a_file

TRICKY = ["--out", "a 'b' $HOME", "--set", "radio.walls=[{a_m=[1, 2], b_m=[3, 4]}]", "--set", "run.duration_s=5"]


def advised(printed: str, before: str) -> list[str]:
    """The arguments of the command line that was printed, as a shell reads it."""
    (line,) = [line for line in printed.splitlines() if before in line]
    program, *words = shlex.split(line.partition(before)[2])
    assert program == "deltaswarm"
    return words


def test_a_command_line_is_told_as_it_was_given() -> None:
    """Through a shell, with all options, but those that ask for something else."""
    argv = ["sweep", "smoke", *TRICKY, "--seed", "-3", "--quiet"]
    arguments = parser("sweep").parse_args(argv)
    arguments.given = argv
    assert shlex.split(as_given(arguments)) == ["deltaswarm", *argv]
    assert shlex.split(as_given(arguments, without=["--quiet"])) == ["deltaswarm", *argv[:-1]]
    assert shlex.split(command_line("info", Path("-x y"))) == ["deltaswarm", "info", "./-x y"]


def test_what_counts_for_a_resumed_run_is_told() -> None:
    """And parses to the same values; what is fixed by the run's folder is left out."""
    own = ["--zenoh", "a/b=1", "--zenoh", 'c="d e"', "--live", "foxglove", "--live-port", "0", "--researcher", "-q"]
    given = parser("run").parse_args(["run", "smoke", *TRICKY, "--checkpoint", "9", *own])
    again = parser("run").parse_args(["run", "--resume", "x", *options_given(given, KEPT)])
    assert {name: getattr(again, name) for name in KEPT} == {name: getattr(given, name) for name in KEPT}
    assert again.checkpoint is None


def test_an_interrupted_sweep_goes_on_as_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """In the same folder, with the same keys, and to the end."""

    class Interrupted(engine.LocalEngine):
        def run(self, tasks: list[Task]) -> Iterator[Done]:
            yield from super().run(tasks[:1])
            raise KeyboardInterrupt

    out = tmp_path / "my sweep"
    keys = ["--set", "run.duration_s=5", "--set", "metrics.horizon_s=1"]
    with monkeypatch.context() as patch:
        patch.setattr(engine, "LocalEngine", Interrupted)
        code = main(["sweep", "smoke", *keys, "--repeats", "1", "--prove", "0", "-j", "1", "--out", str(out), "-q"])
    assert code == INTERRUPTED
    words = advised(capsys.readouterr().err, "to go on: ")
    assert main(words) == 0
    assert not (out / "table.csv").read_text().count("\n") < 3


def test_a_session_that_stops_goes_on_as_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """With its folder and all of its options: the training is not done again."""
    asked: list[RunOptions] = []

    def pretend(scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        asked.append(options)
        options.out.mkdir()
        (options.out / "scenario.toml").write_text(to_toml(scenario))
        is_whole = len(asked) != 2
        (options.out / "summary.json").write_text(json.dumps({"complete": is_whole, "digest": "d"}))
        return 0 if is_whole else 1

    monkeypatch.setattr(report, "run_and_report", pretend)
    markers = f"127.0.0.1:{free_port()}"
    own = ["--language", "de", "--markers", markers, "--researcher", "--station-listen", "127.0.0.1:0"]
    out = tmp_path / "all of them"
    assert main(["session", str(a_file(tmp_path)), "--participant", "7", "--out", str(out), *own]) == 1
    words = advised(capsys.readouterr().err, "to go on: ")
    assert main(words) == 0
    names = [options.out.name for options in asked]
    assert names[0] == "0-training"
    assert names[1:3] == [names[1], f"{names[1]}-2"]
    assert sum("training" in name for name in names) == 1
    assert {options.out.parent for options in asked} == {out / "participant-007"}
    assert set(own) <= set(words)


def test_a_study_without_tables_says_how_to_make_them(tmp_path: Path, capsys: Printed) -> None:
    file = tmp_path / "my-study.toml"
    file.write_text(
        'schema = 1\nbase = "smoke"\n[study]\n[sweep]\nrepeats = 2\n[sweep.axes]\nradio.loss = [0.0, 0.5]\n'
    )
    given = ["study", str(file), "--out", str(tmp_path / "page of it"), "--render"]
    assert main(given) == 1
    assert advised(capsys.readouterr().err, "to make it: ") == given[:-1]
