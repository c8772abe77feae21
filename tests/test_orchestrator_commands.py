"""Commands at the command line: scripts are checked before a run, and a recorded script is the same run again."""

import tomllib
from pathlib import Path

import pytest

from deltaswarm_orchestrator.base.exits import OK
from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.results.run_tables import write_tables
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_wire.checked import SettingsError
from tests.commanding import script

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


def test_a_scenario_with_commands_is_the_same_after_writing_it() -> None:
    """So a run folder's scenario makes the same run."""
    scenario = load_scenario("smoke", [script(*ROWS)])
    assert load_scenario("smoke", [], None).command == ()
    assert tomllib.loads(to_toml(scenario))["command"][1]["arguments"] == {"for_s": 12.5}


@pytest.mark.parametrize(
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
    ids=str,
)
def test_a_command_that_nobody_would_obey_is_a_mistake_of_the_scenario(row: list[object]) -> None:
    """It is found before anything is started."""
    with pytest.raises(SettingsError):
        load_scenario("smoke", [script(row)])


@pytest.mark.parametrize(
    "text",
    [None, "", "command = 3", "[[command]]\nname = 3", "[command]\nname='hold'", "[[command]]\nnme='hold'", "\0"],
)
def test_a_file_that_is_no_script_is_refused(tmp_path: Path, text: str | None) -> None:
    """With its name or its key."""
    file = tmp_path / "commands.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(SettingsError):
        load_scenario("smoke", commands=file)


@pytest.mark.parametrize("arguments", [("--station", "--in-process"), ("--resume", "there", "--station")])
def test_a_station_is_for_a_new_run_by_processes(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    """Elsewhere it would be passed over in silence."""
    assert main(["run", "smoke", *arguments] if "--resume" not in arguments else ["run", *arguments]) != OK
    assert main(["station", str(tmp_path / "no-run")]) != OK
    assert main(["replay", str(tmp_path)]) != OK
