"""The watch over a swarm: whose end is told, and in which order."""

import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain, count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from numpy import arange

from deltaswarm_orchestrator.base.signals import Stop
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import Part
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.run import watch
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.watch import Watch
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.truth import Truth
from deltaswarm_wire.exits import WORLD_LOST
from deltaswarm_wire.keys import AGENT, OPERATOR, WORLD, Keys
from deltaswarm_wire.operator_messages import Report
from deltaswarm_world.core.retransmit_buffer import AHEAD_STEPS
from tests.support.swarms import started, wait_until

PATIENCE_S = 60.0
UNTIL_KILLED = "import signal\nwhile True: signal.pause()"


class Told:
    """A real process of which the fork server tells only when it has been asked some times after its end."""

    def __init__(self, program: str, told_after: int) -> None:
        self._process = subprocess.Popen([sys.executable, "-c", program])
        self._askings_left = told_after
        self.pid = self._process.pid

    @property
    def exitcode(self) -> int | None:
        """As the fork server tells it."""
        code = self._process.poll()
        if code is None or self._askings_left:
            self._askings_left -= code is not None
            return None
        return code

    def end(self) -> int:
        """Kill it, unless it has ended by itself."""
        self._process.kill()
        return self._process.wait()


@pytest.fixture
def ending() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


REPORTER = cast(Any, SimpleNamespace(update=lambda status, rate_60s_hz: None))


def an_observer(**more: Any) -> SimpleNamespace:
    """One that hears nothing, unless told otherwise."""
    quiet = {"work": lambda within_s: False, "newest_workload": None, "orders": deque(), "heard_at": time.monotonic()}
    return SimpleNamespace(**{**quiet, "records": True, "leave_when_done": lambda: None, **more})


def a_swarm(**more: Any) -> SimpleNamespace:
    """One without a station."""
    return SimpleNamespace(**{"station": None, "write_pids": lambda: None, "stop_world": lambda: None, **more})


@pytest.mark.parametrize("told_after", range(6))
def test_the_end_of_the_world_is_told_before_that_of_an_operator_who_lost_it(
    told_after: int, ending: ExitStack, tmp_path: Path
) -> None:
    """Even if the orchestrator hears of the operator's end first; and nobody starts an operator without a world."""
    world = Told(UNTIL_KILLED, told_after)
    operator = Told(f"raise SystemExit({WORLD_LOST})", told_after=0)
    for process in (world, operator):
        ending.callback(process.end)
    parts = [Part(role, 0, cast(Any, each), tmp_path / role) for role, each in ((WORLD, world), (OPERATOR, operator))]
    for part in parts:
        ending.callback(part.close)
    assert operator._process.wait() == WORLD_LOST
    assert world.end() == -signal.SIGKILL
    started: list[bool] = []
    swarm = a_swarm(
        part=lambda role: next(part for part in parts if part.role == role),
        ended=lambda: [part for part in parts if part.exit_code is not None],
        start_operator=lambda publish_all, is_restart: started.append(is_restart),
    )
    observer = an_observer(status=SimpleNamespace(phase="stepping", step=7), newest_step=7)
    made = Watch(cast(Any, swarm), cast(Any, observer), REPORTER, Stop(), PATIENCE_S)
    made.watch_to_the_end()
    assert [line.split()[0] for line in made.why] == [WORLD, OPERATOR]
    assert "SIGKILL" in made.why[0]
    assert not started


class Clock:
    """A world that says nothing until `ends_at_s`, as an orchestrator sees it that looks at these times [s]."""

    def __init__(self, looks_at_s: Iterator[float], ends_at_s: float) -> None:
        self.now_s = 0.0
        self._looks_at_s, self._ends_at_s = looks_at_s, ends_at_s

    def work(self, within_s: float) -> bool:
        """Until it looks again."""
        self.now_s = next(self._looks_at_s)
        return False

    @property
    def exit_code(self) -> int | None:
        """Of the world."""
        return None if self.now_s < self._ends_at_s else 0


def whys(monkeypatch: pytest.MonkeyPatch, looks_at_s: Iterator[float], ends_at_s: float) -> list[str]:
    """What a watch says of a world that is silent until its end."""
    clock = Clock(looks_at_s, ends_at_s)
    monkeypatch.setattr(watch, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
    observer = an_observer(work=clock.work, status=None, heard_at=0.0, newest_step=7)
    swarm = a_swarm(part=lambda role: clock, ended=list)
    made = Watch(cast(Any, swarm), cast(Any, observer), cast(Any, None), Stop(), PATIENCE_S)
    made.watch_to_the_end()
    return made.why


def test_a_world_that_is_silent_for_too_long_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    """And not before."""
    too_long_s = PATIENCE_S + watch.SILENCE_S + 1.0
    assert len(whys(monkeypatch, count(0.0, 0.1), ends_at_s=too_long_s)) == 1
    assert not whys(monkeypatch, count(0.0, 0.1), ends_at_s=too_long_s - 2.0)


def test_who_did_not_look_blames_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """An orchestrator that was stopped, or held up by its disk, has not heard what the world said meanwhile."""
    looks = chain(arange(0.0, 10.0, 0.1), count(10.0 + 2 * PATIENCE_S, 0.1))
    assert not whys(monkeypatch, map(float, looks), ends_at_s=10.0 + 2.5 * PATIENCE_S)


@pytest.mark.processes
def test_a_world_is_heard_before_what_it_said_is_taken(tmp_path: Path) -> None:
    """A recorder that is long at work with one step has its world nonetheless."""
    with started(load_scenario("smoke", ["run.duration_s=1_000_000"]), "heard", tmp_path) as (_, observer):
        before = observer.heard_at
        wait_until(lambda: observer.heard_at > before, "a sign of life")


@pytest.mark.parametrize(
    ("role", "phase", "stops"), [(AGENT, "waiting", 1), (AGENT, "running", 0), (OPERATOR, "running", 0)]
)
def test_a_part_lost_before_the_first_step_ends_the_run_and_one_lost_in_it_does_not(
    role: str, phase: str, stops: int, ending: ExitStack, tmp_path: Path
) -> None:
    """The world's next status tells which: the newest may be older than the step. An operator is started again."""
    process = Told(UNTIL_KILLED, told_after=0)
    lost = Part(role, 0, cast(Any, process), tmp_path / "log")
    ending.callback(lost.close)
    assert process.end() == -signal.SIGKILL
    looks = 0

    def work(within_s: float) -> bool:
        nonlocal looks
        looks += 1
        if looks == 3:
            observer.status = SimpleNamespace(phase=phase, step=0)
        return False

    observer = an_observer(work=work, status=SimpleNamespace(phase="waiting", step=0), newest_step=-1)
    stopped: list[bool] = []
    started: list[bool] = []
    swarm = a_swarm(
        part=lambda role: SimpleNamespace(exit_code=None if looks < 6 else 0),
        ended=lambda: [lost],
        start_operator=lambda publish_all, is_restart: started.append(is_restart),
        stop_world=lambda: stopped.append(True),
    )
    Watch(cast(Any, swarm), cast(Any, observer), REPORTER, Stop(), PATIENCE_S).watch_to_the_end()
    assert len(stopped) == stops
    assert started == [True] * (role == OPERATOR)


STEP_TAKES_S = 0.01
STOPPED_AT = 20


class SlowSink:
    """A recorder to which the world is always far ahead; the run is asked to end in one of its steps."""

    def __init__(self, stop: Stop) -> None:
        self._stop = stop
        self.steps: list[int] = []

    def step(self, truth: Truth, reports: Sequence[Report]) -> None:
        """See the protocol `Sink`."""
        time.sleep(STEP_TAKES_S)
        self.steps.append(truth.step)
        if truth.step == STOPPED_AT:
            self._stop(signal.SIGTERM, None)

    def __getattr__(self, name: str) -> Any:
        return lambda *_: None


@contextmanager
def recorded(run: str, folder: Path, sink: SlowSink) -> Iterator[tuple[Swarm, Observer]]:
    """A run of two agents without an end, and who hears it for a recorder."""
    scenario = load_scenario("smoke", ["run.duration_s=1_000_000", "agents.count=2"])
    file = folder / "scenario.toml"
    file.write_text(to_toml(scenario))
    with Swarm(scenario, run, folder) as swarm:
        swarm.start_world("tcp/127.0.0.1:0", record=True)
        with Observer(run, swarm.recorder_link(), cast(Sink, sink), wire=False) as observer:
            swarm.start_operator(publish_all=True)
            swarm.start_agents()
            yield swarm, observer


@pytest.mark.processes
def test_a_recorder_that_is_far_behind_does_not_put_off_the_end(tmp_path: Path) -> None:
    """Its queue is never empty: what else is to be done, is done between two of its steps."""
    stop = Stop()
    sink = SlowSink(stop)
    with recorded("behind", tmp_path, sink) as (swarm, observer):
        Watch(swarm, observer, REPORTER, stop, PATIENCE_S).watch_to_the_end()
    assert stop.by
    assert STOPPED_AT <= sink.steps[-1] <= STOPPED_AT + 2 * AHEAD_STEPS
    assert sink.steps == list(range(sink.steps[-1] + 1))


@pytest.mark.processes
def test_the_world_waits_for_a_recorder_that_takes_nothing(tmp_path: Path) -> None:
    """Not even its first step: else all that the world says meanwhile would have to be kept."""
    with recorded("idle", tmp_path, SlowSink(Stop())) as (_, observer):
        for _ in range(8):  # signs of life
            before = observer.heard_at
            wait_until(lambda before=before: observer.heard_at > before, "a sign of life")  # type: ignore[misc]
        waiting = [observer._queue.get_nowait()[0] for _ in range(observer._queue.qsize())]
    assert 0 < waiting.count(Keys("idle").clock) <= AHEAD_STEPS + 1
