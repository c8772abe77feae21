"""The files that decide a run are those that were identified: a change is found, named, and nothing of it is used."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import deltaswarm
from deltaswarm_orchestrator.base import inputs
from deltaswarm_orchestrator.base.inputs import InputsChangedError
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_orchestrator.sweeps.engine import ThisProcess
from deltaswarm_orchestrator.sweeps.folder import SweepFolderError
from deltaswarm_orchestrator.sweeps.runner import SweepReporter, check_folder, run_sweep
from tests.support.sweeping import made

FILES = {
    "deciding.py": """
from dataclasses import replace
from pathlib import Path

from deltaswarm_agent.controllers.paper.controller import PaperController

from decides import helping


class Own(PaperController):
    data_files = ("weights.csv",)

    def __init__(self, context):
        import decides_late
        super().__init__(replace(context, mode="hybrid"))


class Restless(Own):
    def step(self, percept):
        Path(__file__).with_name("weights.csv").write_text("2")
        return super().step(percept)
""",
    "decides/__init__.py": "",
    "decides/helping.py": "",
    "decides_late.py": "",
    "weights.csv": "1",
    "grid.csv": "1,1\n1,1\n",
}
GRID = 'events.density={kind="grid",file="grid.csv"}'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "decides").mkdir()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    for module in ("deciding", "decides", "decides.helping", "decides_late"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    return tmp_path


def test_a_changed_file_is_named(folder: Path) -> None:
    """A module, what it imports, also late, its weights, and the grid; not one that is as it was again."""
    scenario = load_scenario("smoke", ["control.mode=deciding:Own", GRID])
    identified = inputs.identify(scenario)
    for name, text in FILES.items():
        (folder / name).write_text(text + "\n")
        with pytest.raises(InputsChangedError, match=name):
            inputs.check(scenario, identified, starts_python=True)
        (folder / name).write_text(text)
        inputs.check(scenario, identified, starts_python=True)
    (folder / "weights.csv").unlink()
    with pytest.raises(InputsChangedError, match=r"weights\.csv"):
        inputs.check(scenario, identified, starts_python=False)


def test_a_sweep_stops_at_the_change_and_uses_no_run_of_it(folder: Path) -> None:
    """It goes on when the change is undone; if it is not, the folder's sweep is another, and the file is named."""
    sweep = {"axes": {"control.mode": ["deciding:Own"]}, "repeats": 3, "prove": 0}
    done: list[str] = []

    def edit(*_: object) -> Mapping[str, Any]:
        done.append("")
        if len(done) == 2:
            (folder / "weights.csv").write_text("2")
        return {}

    result = run_sweep(made(sweep), folder / "out", lambda: ThisProcess(edit), SweepReporter())
    assert (len(done), result.finished, result.is_well, len(result.table)) == (2, 1, False, 1)
    assert "weights.csv" in str(result.failed)
    with pytest.raises(SweepFolderError, match=r"changed since: weights\.csv"):
        check_folder(made(sweep), folder / "out", "in-process")
    (folder / "weights.csv").write_text("1")
    result = run_sweep(made(sweep), folder / "out", lambda: ThisProcess(edit), SweepReporter())
    assert (len(done), result.finished, result.is_well) == (4, 3, True)


def test_a_run_during_which_a_file_changes_is_not_valid(folder: Path) -> None:
    """It says which file; a run that begins thereafter has the new one."""
    keys = {"control.mode": "deciding:Restless", "run.duration_s": 5.0, "record": "off"}
    with pytest.warns(UserWarning, match=r"weights\.csv"):
        assert not deltaswarm.run("smoke", keys, progress=False).is_valid
    assert deltaswarm.run("smoke", keys, progress=False).is_valid
    (folder / "deciding.py").write_text(FILES["deciding.py"] + "\n")
    with pytest.raises(deltaswarm.Error, match=r"deciding\.py"):
        deltaswarm.run("smoke", keys, progress=False)
