"""Runs that several sweeps have in common: which are taken over from another folder, and which are not."""

from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.sweeps.folder import SweepFolder, copy_runs
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES
from deltaswarm_orchestrator.sweeps.plan import Sweep
from tests.support.sweeping import made

OURS = provenance.code_digest()


def planned(*losses: float) -> Sweep:
    """A run for each loss."""
    return made({"axes": {"radio.loss": list(losses)}, "repeats": 1, "prove": 0})


def kept(folder: Path, sweep: Sweep, means: str = IN_PROCESS, **result: Any) -> Path:
    """A folder in which all runs of a sweep have this result; nobody did them."""
    own = SweepFolder(folder)
    own.runs.mkdir(parents=True, exist_ok=True)
    for job in sweep.jobs():
        own.save(job, means, {"seed": job.scenario.seed, "means": means, **result})
    return folder


def results(folder: Path, sweep: Sweep) -> list[dict[str, Any] | None]:
    found = [SweepFolder(folder).result(job) for job in sweep.jobs()]
    return [result and {name: result[name] for name in result if name not in ("seed", "means")} for result in found]


def test_a_run_is_taken_over_as_it_is(tmp_path: Path) -> None:
    """Those of the sweep that another folder has, and no other ones of that folder."""
    other = kept(tmp_path / "other", planned(0.1, 0.2), code=OURS, host="there")
    sweep = planned(0.2, 0.3)
    assert copy_runs(sweep, tmp_path / "own", [other]) == 1
    assert results(tmp_path / "own", sweep) == [{"code": OURS, "host": "there"}, None]
    assert len(list((tmp_path / "own" / "runs").iterdir())) == 1


@pytest.mark.parametrize("origin", [{"code": "0" * len(OURS)}, {"code": None}, {}], ids=["another", "none", "unknown"])
def test_a_run_of_other_code_is_not_taken_over(tmp_path: Path, origin: dict[str, Any]) -> None:
    """Its results may be others; a later folder that has one of this code is still found."""
    sweep = planned(0.2)
    stale = kept(tmp_path / "stale", sweep, **origin)
    assert copy_runs(sweep, tmp_path / "own", [stale]) == 0
    assert results(tmp_path / "own", sweep) == [None]
    fresh = kept(tmp_path / "fresh", sweep, code=OURS)
    assert copy_runs(sweep, tmp_path / "own", [stale, fresh]) == 1
    assert results(tmp_path / "own", sweep) == [{"code": OURS}]


def test_what_the_folder_has_is_not_replaced(tmp_path: Path) -> None:
    """Nor is it counted; whatever did it, the sweep itself decides what to do with it."""
    sweep = planned(0.2)
    other = kept(tmp_path / "other", sweep, code=OURS, host="there")
    own = kept(tmp_path / "own", sweep, code=OURS, host="here")
    (own / ".lock").touch()
    assert copy_runs(sweep, own, [other, own]) == 0
    assert results(own, sweep) == [{"code": OURS, "host": "here"}]


def test_runs_by_real_processes_are_no_runs_in_one_process(tmp_path: Path) -> None:
    sweep = planned(0.2)
    other = kept(tmp_path / "other", sweep, PROCESSES, code=OURS)
    assert copy_runs(sweep, tmp_path / "own", [other]) == 0
