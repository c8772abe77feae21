"""Commands at the command line: scripts are checked before a run, and a recorded script is the same run again."""

import subprocess
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_cli.run import EXCLUDES, NEEDS
from deltaswarm_orchestrator.base.exits import OK
from deltaswarm_orchestrator.results.run_tables import write_tables
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import SettingsError
from tests.support.commanding import script
from tests.support.swarms import COMMAND
from tests.support.tiers import in_one_test

ROWS = (
    [3, "set delta", "circle", [20, 20, 12.5], {"delta": 1}],
    [40.4, "hold", "agent", [2], {"for_s": 12.5}, 33.3],
    [40.4, "resume", "all", [], {}],
)


@pytest.mark.parametrize("step_s", [0.1, 0.3, 1.0])
def test_the_commands_of_a_run_are_a_script_of_the_same_run(tmp_path: Path, step_s: float) -> None:
    """Whatever the length of a step: the written times are those of the steps."""
    sets = ["run.duration_s=48", f"run.step_s={step_s}"]
    first = run_in_process(load_scenario("smoke", [*sets, script(*ROWS)]))
    write_tables(tmp_path, first)
    again = run_in_process(load_scenario("smoke", sets, commands=tmp_path / "commands.toml"))
    assert again.world["commands"] == first.world["commands"]
    assert again.digest == first.digest
    assert len(first.world["commands"]) == 3


@in_one_test(
    "row",
    [
        [1, "fly", "all", [], {}],
        [1, "hold", "place", [1, 1], {"for_s": 3}],
        [1, "hold", "all", [], {}],
        [1, "hold", "all", [], {"for_s": 0}],
        [1, "set delta", "all", [], {"delta": 1.5}],
        [1, "set delta", "tree", [1.5], {"delta": 1}],
        [1, "recall", "tree", [-1], {"pause_s": 3}],
        [1, "hold", "all", [], {"for_s": "1979-05-27T07:32:00Z"}],
        [1, "hold", "all", [], {"for_s": 10**60}],
    ],
)
def test_a_command_that_nobody_would_obey_is_a_mistake_of_the_scenario(row: list[object]) -> None:
    with pytest.raises(SettingsError):
        load_scenario("smoke", [script(row)])


@pytest.mark.parametrize(
    "text",
    [None, "", "command = 3", "[[command]]\nname = 3", "[command]\nname='hold'", "[[command]]\nnme='hold'", "\0"],
)
def test_a_file_that_is_no_script_is_refused(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "commands.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(SettingsError):
        load_scenario("smoke", commands=file)


WITH_VALUE = {
    "speed": "2",
    "station_listen": "127.0.0.1:0",
    "live_port": "0",
    "live_connect": "tcp/127.0.0.1:7447",
    "boards_folder": "there",
    "boards": "4",
    "markers": "127.0.0.1:5000",
    "checkpoint": "5",
    "engine": "dask",
    "scheduler": "tcp://127.0.0.1:9",
    "listen": "tcp/127.0.0.1:0",
    "zenoh": "mode='client'",
    "resume": "there",
    "seed": "1",
    "set": "seed=1",
    "out": "there",
    "record": "off",
    "commands": "there",
}


def option(name: str) -> list[str]:
    return [f"--{name.replace('_', '-')}", *([WITH_VALUE[name]] if name in WITH_VALUE else [])]


@pytest.mark.parametrize(
    "names",
    [*((name,) for name in NEEDS), *((name, other) for name, (others, _) in EXCLUDES.items() for other in others)],
    ids="-".join,
)
def test_an_option_without_effect_is_refused(
    names: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one line that names both; nothing is started or written."""
    monkeypatch.chdir(tmp_path)
    words = [word for name in names for word in (["smoke"] if name == "scenario" else option(name))]
    assert main(["run", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    both = names if len(names) == 2 else (*names, NEEDS[names[0]])
    assert all((name.upper() if name == "scenario" else option(name)[0]) in line for name in both)
    assert list(tmp_path.iterdir()) == []


def test_a_station_is_for_a_run(tmp_path: Path) -> None:
    assert main(["station", str(tmp_path / "no-run")]) != OK
    assert main(["replay", str(tmp_path)]) != OK


def test_help_loads_nothing_that_a_run_needs() -> None:
    """--version and the --help of every command are shown before numpy, protobuf and the scenario's settings load."""
    program = """
import sys
from deltaswarm_cli.main import all_commands, main
words = [[command, "--help"] for command in (*all_commands(), "agent", "world", "operator")]
for command in (["--version"], ["--help"], *words, ["agent", "board", "--help"], ["operator", "--no-world", "--help"]):
    try:
        main(command)
    except SystemExit as ended:
        assert ended.code == 0, command
slow = ("numpy", "google.protobuf", "mcap", "pandas", "rich", "deltaswarm_scenario", "deltaswarm_orchestrator.run")
print([name for name in slow if name in sys.modules], file=sys.stderr)
"""
    done = subprocess.run([*COMMAND[:1], "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "[]\n")
