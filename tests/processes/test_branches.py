"""Branches that go on by processes: with their parents' digests, and with those of branches in one process."""

from pathlib import Path
from random import Random

import pytest

from tests.support.branching import AIR, FAULTS, SCRIPT, branched, ran, summary_of

pytestmark = pytest.mark.processes

SETS = (SCRIPT, FAULTS, *AIR, "run.duration_s=160", "run.step_s=0.5", "operator.person.policy=threshold")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("runs") / "run", *SETS)


def test_processes_go_on_where_one_process_stopped(run: Path, tmp_path: Path) -> None:
    """Without a difference, while an agent is frozen, to the parent's digest."""
    branch = branched(run, tmp_path / "branch", "--at", "75", "--processes")
    assert summary_of(branch)["digest"] == summary_of(run)["digest"]
    assert summary_of(branch)["valid"]


@pytest.mark.slow
@pytest.mark.parametrize("step", Random(20).sample(range(1, 320), 20))
def test_a_branch_by_processes_is_its_parent(run: Path, tmp_path: Path, step: int) -> None:
    """At 20 random steps."""
    branch = branched(run, tmp_path / "branch", "--at", str(step / 2), "--processes")
    assert summary_of(branch)["digest"] == summary_of(run)["digest"]


def test_a_difference_is_the_same_by_processes(run: Path, tmp_path: Path) -> None:
    """Another mode, an order less, and another setting, at once."""
    options = ("--at", "50", "--mode", "hierarchical", "--drop-command", "1", "--later", "kept")
    options += ("--set", "operator.threshold_hz=2", "--add-command", "name='hold', arguments={for_s=20}, at_s=100")
    digests = [
        summary_of(branched(run, tmp_path / name, *options, *how))["digest"]
        for name, how in (("one", ()), ("many", ("--processes",)))
    ]
    assert digests[0] == digests[1] != summary_of(run)["digest"]
