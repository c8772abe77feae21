"""After the last step, while the operator's person still answers or the operator itself hangs."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.swarms import BOUND_S, SMOKE_PROCESSES, RunningSwarm, is_running, running, sets, wait_until

pytestmark = pytest.mark.processes

ASKING = ("--station", "--speed", "0", *sets("operator.probes.tlx=true", "run.duration_s=50"))


@contextmanager
def asking(out: Path) -> Iterator[tuple[RunningSwarm, dict[str, int]]]:
    """A run whose last step is closed, and whose operator waits for NASA-TLX."""
    with running(out, *ASKING) as swarm:
        pids = wait_until(lambda: len(swarm.pids) == SMOKE_PROCESSES + 1 and swarm.pids, "all processes")
        wait_until(lambda: not is_running(pids["world"]), "the last step")
        yield swarm, pids


def test_an_operator_that_is_killed_while_its_person_answers_spoils_no_run(tmp_path: Path) -> None:
    """Every step was counted; that the answers are lost is said."""
    with asking(tmp_path / "run") as (swarm, pids):
        os.kill(pids["operator"], signal.SIGKILL)
        code, _, errors = swarm.finish(BOUND_S)
    summary = swarm.summary()
    assert (code, summary["valid"], summary["steps"], swarm.manifest()["exit_reason"]) == (0, True, 50, "finished")
    why = summary["why"][0]  # another may follow: if the world is just ending, the operator is started again in vain
    assert "operator was killed by SIGKILL" in why
    assert why in errors


def test_a_station_that_is_killed_while_its_person_answers_comes_back(tmp_path: Path) -> None:
    """Another process serves the page, and the question is still open."""
    with asking(tmp_path / "run") as (swarm, pids):
        os.kill(pids["station"], signal.SIGKILL)
        again = wait_until(lambda: swarm.pids["station"] != pids["station"] and swarm.pids["station"], "another one")
        assert is_running(again)
        assert is_running(pids["operator"])
        swarm.interrupt()
        swarm.end_well(BOUND_S)
    assert swarm.summary()["valid"]


def test_an_operator_that_stops_before_the_end_is_named(tmp_path: Path) -> None:
    """Not the world, which does all steps and then waits for the operator to take them."""
    waiting = sets("run.start_timeout_s=12", "run.step_timeout_s=1", "run.duration_s=60")
    paced = sets("run.clock=realtime", "run.real_time_factor=10")
    with running(tmp_path / "run", *waiting, *paced) as swarm:
        swarm.wait_until_under_way()
        swarm.signal("operator", signal.SIGSTOP)
        code, _, errors = swarm.finish(BOUND_S)
    assert code == 1
    [why] = swarm.manifest()["why"]
    assert "operator" in why
    assert "step 59" in why
    assert why in errors
