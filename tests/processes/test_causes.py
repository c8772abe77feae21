"""Whatever ends a run: `why` begins with what happened first, and clean-up that fails takes nothing away."""

import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.swarms import UNHURRIED, RunningSwarm, is_running, parent_of, running, sets, wait_until
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

LONG = (*sets("run.duration_s=1000000", "run.step_timeout_s=1"), *UNHURRIED)

Blow = Callable[[RunningSwarm], object]


def both(first: str, second: str) -> Blow:
    """Two parts are killed, one just after the other."""
    return lambda swarm: (swarm.signal(first, signal.SIGKILL), swarm.signal(second, signal.SIGKILL))


LOST = "operator lost its world after step "
BLOWS: dict[str, tuple[Blow, list[str]]] = {
    "SIGTERM": (lambda swarm: swarm.signal("world", signal.SIGTERM), ["world was ended by SIGTERM after step "]),
    "two at once": (
        both("operator", "world"),
        ["operator was killed by SIGKILL after step ", "world was killed by SIGKILL after step "],
    ),
    "SIGSEGV": (
        lambda swarm: swarm.signal("world", signal.SIGSEGV),
        ["world was killed by SIGSEGV after step ", LOST],
    ),
    "an agent, and the world": (
        both("agent 2", "world"),
        ["agent 2 was killed by SIGKILL after step ", "world was killed by SIGKILL after step ", LOST],
    ),
    "SIGSTOP": (
        lambda swarm: swarm.signal("operator", signal.SIGSTOP),
        ["operator was stopped by a signal; the operator"],
    ),
}


@pytest.mark.parametrize("name", first_of(BLOWS))
def test_why_tells_what_happened_in_its_order(name: str, tmp_path: Path) -> None:
    """With signal, part and step; what ended the run is why it is not valid, and is printed last."""
    blow, begins = BLOWS[name]
    with running(tmp_path / "run", *LONG) as swarm:
        swarm.wait_until_under_way()
        blow(swarm)
        code, _, errors = swarm.finish()
    summary = swarm.summary()
    assert code == 1
    assert [line[: len(begin)] for line, begin in zip(summary["why"], begins, strict=True)] == begins
    (cause,) = [line for line in summary["why"] if line in summary["invalid_because"][0]]
    assert cause.partition(" ")[0] in ("world", "operator")
    assert errors.rstrip().endswith(cause)


def test_an_agent_that_is_stopped_was_killed_by_nobody(tmp_path: Path) -> None:
    """`why` and the reasons name it, the step in which it stopped answering, and the signal that it had got."""
    with running(tmp_path / "run", *LONG, "--set", "run.duration_s=60", "--set", "metrics.horizon_s=20") as swarm:
        swarm.wait_until_under_way()
        swarm.signal("agent 3", signal.SIGSTOP)
        assert swarm.finish()[0] == 1
    summary = swarm.summary()
    step = summary["agents_hung"][0]["step"]
    assert [line.partition(" (")[0] for line in summary["why"]] == [f"agent 3 stopped answering in step {step}"]
    reasons = [*summary["why"], *summary["invalid_because"]]
    assert all("SIGSTOP" in reason and "SIGTERM" not in reason for reason in reasons), reasons


@pytest.mark.slow
def test_a_world_that_is_stopped_with_the_command_is_named_and_the_run_concluded(tmp_path: Path) -> None:
    """Zenoh cannot close a session with it in time, and the operator has lost it by then."""
    with running(tmp_path / "run", *LONG) as swarm:
        pids = swarm.wait_until_under_way()
        swarm.signal("world", signal.SIGSTOP)
        os.kill(swarm.process.pid, signal.SIGSTOP)
        wait_until(lambda: not is_running(pids["operator"]), "the operator's end")
        os.kill(swarm.process.pid, signal.SIGCONT)
        code, _, errors = swarm.finish()
    assert code == 1
    assert "Traceback" not in errors
    assert swarm.summary()["why"][0].startswith("the world said nothing for ")
    assert swarm.summary()["why"][0].endswith(": it is stopped by a signal")
    assert not swarm.part.exists()


RAISES = """
class Storm:
    reason = "storm"
    meaning = "a storm"
    holds_for_step = False

    @classmethod
    def of(cls, context):
        return cls()

    def cuts(self, links, time_s):
        raise KeyError("lightning")

    def explain(self, links, time_s):
        raise NotImplementedError
"""


@pytest.mark.parametrize("way", first_of(["--quiet", "--in-process"]))
def test_an_exception_is_named_by_its_kind_and_text(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a radio model; the summary is written."""
    (tmp_path / "storms.py").write_text(RAISES)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with running(tmp_path / "run", way, "--set", 'radio.models."storms:Storm"={}') as swarm:
        code, _, _ = swarm.finish()
    assert code == 1
    why = swarm.summary()["why"][0]
    assert why.startswith("storms:Storm.cuts" if way == "--in-process" else "world ended with exit code 1 after step ")
    assert "KeyError: 'lightning' (" in why


def test_a_run_whose_folder_is_removed_ends_with_a_line(tmp_path: Path) -> None:
    """Not hours later: nothing of it could be kept."""
    with running(tmp_path / "run", *LONG) as swarm:
        pids = swarm.wait_until_under_way()
        shutil.rmtree(swarm.part.rename(tmp_path / "gone"), ignore_errors=True)  # its parts still write into it
        code, _, errors = swarm.finish()
    assert code == 1
    assert "the run's folder was removed or moved after step " in errors.splitlines()[-1]
    assert "Traceback" not in errors
    wait_until(lambda: not any(map(is_running, pids.values())), "the end of all")


@pytest.mark.slow
def test_a_fork_server_that_is_lost_again_and_again_ends_the_run(tmp_path: Path) -> None:
    """It is replaced some times, as after a single loss, and then the run ends with a line."""
    with running(tmp_path / "run", *LONG) as swarm:
        pids = swarm.wait_until_under_way()
        os.kill(parent_of(pids["world"]), signal.SIGKILL)
        swarm.signal("operator", signal.SIGKILL)  # its successor comes from a new fork server
        wait_until(lambda: swarm.pids["operator"] != pids["operator"], "a new operator")
        swarm.wait_for_steps(5)
        swarm.interrupt()
        swarm.finish()
    assert [line.partition(" after")[0] for line in swarm.summary()["why"]] == ["operator was killed by SIGKILL"]
