"""Which rows of a table of runs are repeated, and by which engine."""

import tomllib

from deltaswarm_orchestrator.processes.elsewhere import DENSE, PYTHON
from deltaswarm_orchestrator.sweeps.load import make_sweep
from deltaswarm_studies.checking import drawn, other_engine, told
from tests.support.studying import made

FOUR = """
schema = 1
base = "smoke"
sweep.repeats = 25
sweep.axes."radio.loss" = [0.0, 0.5]
[[sweep.variants]]
label = "hybrid"
[[sweep.variants]]
label = "with bodies"
world.dynamics = "physics"
[[sweep.variants]]
label = "by potentials"
control.mode = "potential"
[[sweep.variants]]
label = "decentralised"
control.mode = "decentralised"
"""


def test_every_part_of_a_study_is_drawn() -> None:
    """However few rows are asked for; each seed draws others, and the same seed the same."""
    jobs = make_sweep(tomllib.loads(FOUR)).jobs()
    for seed in range(20):
        some = drawn(jobs, 1, seed)
        parts = {(job.scenario.control.mode, job.scenario.world.dynamics) for job in some}
        assert {mode for mode, _ in parts} == {"hybrid", "potential", "decentralised"}
        assert {dynamics for _, dynamics in parts} == {"point", "physics"}
    assert [job.name for job in drawn(jobs, 30, 1)] == [job.name for job in drawn(jobs, 30, 1)]
    assert {job.name for job in drawn(jobs, 30, 1)} != {job.name for job in drawn(jobs, 30, 2)}
    assert (len(drawn(jobs, 30, 1)), len({job.name for job in drawn(jobs, 10**9, 1)})) == (30, len(jobs))


def test_the_other_engine_repeats_a_run() -> None:
    """The one that did not do it, if it can do it; of several, the one that it is not usually done by."""
    scenario = made().sweep.variants[0].scenario
    with_bodies = make_sweep(tomllib.loads(FOUR)).variants[1].scenario
    assert [other_engine(scenario, was) for was in (PYTHON, DENSE)] == [DENSE, PYTHON]
    assert other_engine(with_bodies, PYTHON) == PYTHON
    assert other_engine(scenario, "") == DENSE, "short runs are done by the Python engine"


def test_what_was_not_repeated_is_said() -> None:
    """Counts of rows and of differing columns, and the seed by which others draw the same."""
    differing = [{"run": "a", "metric": metric, "was": 1, "is": 2} for metric in ("m", "n")]
    counts = {"rows": 50, "repeated": 5, "equal": 4, "seed": 7}
    lines = told({"study": "own", **counts, "engines": {PYTHON: 3, DENSE: 2}, "differing": differing})
    assert "4 of 5" in lines
    assert "45 of 50" in lines
    assert "--seed 7" in lines
    assert "m differs in 1" in lines
