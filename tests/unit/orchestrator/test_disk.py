"""The room that a run may need: of what a user is warned, against what runs really write."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import disk
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import RECORDS, Scenario


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    made = SimpleNamespace(free=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: made)
    return made


def needed_bytes(scenario: Scenario, folder: Path, free: SimpleNamespace) -> int:
    """The least room without a warning."""
    low, high = 0, 1 << 50
    while low < high:
        free.free = (low + high) // 2
        low, high = (free.free + 1, high) if disk.shortage(folder, scenario) else (low, free.free)
    return low


@pytest.mark.parametrize("record", RECORDS)
@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_a_run_fits_where_there_was_no_warning(
    tmp_path: Path, free: SimpleNamespace, record: str, step_s: float
) -> None:
    """Tables, recording and raw samples of all agents and steps; nor is a user warned for nothing."""
    sets = ["run.duration_s=120", f"run.step_s={step_s}", "agents.count=25", f"record={record}"]
    needed = needed_bytes(load_scenario("smoke", sets), tmp_path, free)
    options = [option for one in sets for option in ("--set", one)]
    assert main(["run", "smoke", "--in-process", "--out", str(tmp_path / "run"), *options]) == 0
    written = sum(file.stat().st_size for file in (tmp_path / "run").iterdir())
    assert written <= needed < 10 * written


def test_a_warning_has_no_size_of_zero(tmp_path: Path, free: SimpleNamespace) -> None:
    """Neither what is free nor what is needed, however short the run."""
    free.free = 4000
    warning = disk.shortage(tmp_path, load_scenario("smoke", ["run.duration_s=40"]))
    assert warning is not None
    assert "4 kB free" in warning
    assert " 0 " not in warning


@pytest.mark.parametrize("record", RECORDS)
def test_the_room_grows_with_steps_and_recorded_agents(tmp_path: Path, free: SimpleNamespace, record: str) -> None:
    """Half the step takes twice the room; each agent takes more if anything of it is recorded."""

    def needed(step_s: float, agents: int) -> int:
        sets = [f"run.step_s={step_s}", f"agents.count={agents}", f"record={record}"]
        return needed_bytes(load_scenario("smoke", sets), tmp_path, free)

    assert needed(0.5, 10) == 2 * needed(1.0, 10)
    assert (needed(1.0, 20) > needed(1.0, 10)) == (record != "off")
    assert needed(1.0, 30) - needed(1.0, 20) == needed(1.0, 20) - needed(1.0, 10)
