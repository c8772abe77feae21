"""A robot follows its simulated body, and its faults are its own."""

import logging
import math
import signal
import subprocess
import sys
from typing import Any

import pytest

from deltaswarm_agent.body import NOWHERE, Sensed
from deltaswarm_board.driver import APART_M, BESIDE_M, Follower
from deltaswarm_wire.messages import FREE, Act, Frame, TreeStatus
from tests.support.swarms import PATIENCE_S


class Point:
    Settings: Any = None
    REAL_TIME = True

    def __init__(self, top_mps: float) -> None:
        self.at = [0.0, 0.0]
        self.fault: Any = ""
        self.is_closed = False
        self._top_mps = top_mps
        self._time_s = 0.0
        self._velocity = (0.0, 0.0)

    def sense(self, time_s: float) -> Any:
        if isinstance(self.fault, Exception):
            raise self.fault
        for_s, self._time_s = time_s - self._time_s, time_s
        self.at = [at_m + rate * for_s for at_m, rate in zip(self.at, self._velocity, strict=True)]
        return NOWHERE._replace(fault=self.fault) if self.fault else Sensed(*self.at, 0.1)

    def move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> None:
        share = min(1.0, self._top_mps / (math.hypot(vx_mps, vy_mps) or 1.0))
        self._velocity = (vx_mps * share, vy_mps * share)

    def close(self) -> None:
        """End."""
        self.is_closed = True


def walked(follower: Follower, steps: int, step_s: float, start: int = 0) -> tuple[float, float]:
    """Follow a body that walks at 1 m/s from (5, 3) along x; return where it is."""
    for step in range(start, start + steps):
        at = (5.0 + step * step_s, 3.0)
        frame = Frame(step, step * step_s, False, *at, (), (), ())
        follower.follow(frame, Act(step, 1.0, 0.0, (), TreeStatus(FREE), step + 1))
    return at


@pytest.mark.parametrize("step_s", [0.1, 1.0, 10.0])
def test_a_robot_catches_up_and_stays_beside(step_s: float, caplog: pytest.LogCaptureFixture) -> None:
    body = Point(top_mps=2.0)
    follower = Follower(body, step_s, 5.0)
    with caplog.at_level(logging.INFO):
        at = walked(follower, round(60.0 / min(step_s, 2.0)), step_s)
    assert math.dist(body.at, at) < 0.1
    told = [record.getMessage() for record in caplog.records]
    assert told == ["the robot is 5.8 m from its simulated body", "the robot is beside its simulated body"]


def test_a_robot_that_is_too_slow_is_lost(caplog: pytest.LogCaptureFixture) -> None:
    body = Point(top_mps=0.5)
    body.at = [5.0, 3.0]
    with caplog.at_level(logging.INFO):
        walked(Follower(body, 1.0, 5.0), 20, 1.0)
    [told] = [record.getMessage() for record in caplog.records]
    assert told == f"the robot is {APART_M + 0.5:.1f} m from its simulated body"
    assert BESIDE_M < APART_M


@pytest.mark.parametrize(
    ("fault", "text"),
    [("no position", "no position"), (OSError("gone"), "body failed: OSError: gone")],
)
def test_a_fault_is_told_once_and_its_end_too(fault: Any, text: str, caplog: pytest.LogCaptureFixture) -> None:
    body = Point(top_mps=2.0)
    body.at = [5.0, 3.0]
    follower = Follower(body, 1.0, 5.0)
    body.fault = fault
    walked(follower, 3, 1.0)
    assert follower.fault == text
    body.fault = ""
    walked(follower, 3, 1.0, start=3)
    assert follower.fault == ""
    told = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert told == [f"the robot is not well: {text}", "the robot is well"]
    follower.close()
    assert body.is_closed
    body.is_closed = False
    follower.close()
    walked(follower, 3, 1.0, start=6)
    assert not body.is_closed
    assert follower.fault == ""


def test_a_robot_that_does_not_know_where_it_is_stands() -> None:
    """As one that no simulated body leads."""
    body = Point(top_mps=2.0)
    follower = Follower(body, 1.0, 0.05)
    walked(follower, 3, 1.0)
    assert follower.fault == "position has a standard deviation of 0.1 m"
    assert body.at == [0.0, 0.0]


BLOCKED = """
import signal, sys, threading, time
from deltaswarm_board.service import block_signals, stand_on_signals
signal.signal(signal.SIGINT, signal.SIG_DFL)
block_signals()
threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
stand_on_signals(lambda: print("stands", flush=True))
print("ready", flush=True)
lock = threading.Lock()
lock.acquire()
lock.acquire()
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_has_the_robot_stand_before_it_ends_the_process(number: signal.Signals) -> None:
    """Whatever the main thread is blocked in; the process ends as by the signal."""
    with subprocess.Popen([sys.executable, "-c", BLOCKED], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        assert process.stdout.read() == "stands\n"
        assert process.wait(PATIENCE_S) == -number
