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

from deltaswarm_orchestrator.base.exits import Reporter
from deltaswarm_orchestrator.base.signals import Stop
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import Part, RunPart
from deltaswarm_orchestrator.processes.station import STATION
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.run import watch
from deltaswarm_orchestrator.run.ending import Ending
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.watch import Watch
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.truth import Truth
from deltaswarm_wire.child import LIMIT_REACHED, NO_ROOM, WORLD_LOST
from deltaswarm_wire.keys import AGENT, OPERATOR, WORLD, Keys
from deltaswarm_wire.operator_messages import Report
from deltaswarm_world.core.retransmit_buffer import AHEAD_STEPS
from tests.support.swarms import wait_until

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
        code = self._process.poll()
        if code is None or self._askings_left:
            self._askings_left -= code is not None
            return None
        return code

    def wait(self) -> int:
        return self._process.wait()

    def end(self) -> int:
        self._process.kill()
        return self.wait()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def a_watch(swarm: Any, observer: Any, stop: Stop | None = None) -> tuple[Watch, Ending]:
    """A watch over a swarm, and what it notes."""
    ending = Ending()
    context = SimpleNamespace(
        ending=ending,
        stop=stop or Stop(),
        reporter=Reporter(),
        observers=[],
        folder=SimpleNamespace(is_there=lambda: True),
        scenario=SimpleNamespace(run=SimpleNamespace(step_timeout_s=PATIENCE_S)),
    )
    return Watch(cast(Any, context), swarm, observer), ending


def an_observer(**more: Any) -> SimpleNamespace:
    """One that hears nothing, unless told otherwise."""
    quiet = {"work": lambda within_s: False, "newest_workload": None, "orders": deque(), "heard_at": time.monotonic()}
    return SimpleNamespace(**{**quiet, "records": True, "leave_when_done": lambda: None, **more})


def a_swarm(**more: Any) -> SimpleNamespace:
    return SimpleNamespace(
        **{"station": None, "parts": [], "write_pids": lambda: None, "stop_world": lambda: None, **more}
    )


@pytest.mark.parametrize("told_after", range(6))
def test_the_end_of_the_world_is_told_before_that_of_an_operator_who_lost_it(
    told_after: int, stack: ExitStack, tmp_path: Path
) -> None:
    """Even if the orchestrator hears of the operator's end first; and nobody starts an operator without a world."""
    world = Told(UNTIL_KILLED, told_after)
    operator = Told(f"raise SystemExit({WORLD_LOST})", told_after=0)
    for process in (world, operator):
        stack.callback(process.end)
    parts = [Part(role, 0, cast(Any, each), tmp_path / role) for role, each in ((WORLD, world), (OPERATOR, operator))]
    for part in parts:
        stack.callback(part.close)
    assert operator.wait() == WORLD_LOST
    assert world.end() == -signal.SIGKILL
    started: list[bool] = []
    swarm = a_swarm(
        part=lambda role: next(part for part in parts if part.role == role),
        ended=lambda: [part for part in parts if part.exit_code is not None],
        start_operator=lambda publish_all, is_restart: started.append(is_restart),
    )
    observer = an_observer(status=SimpleNamespace(phase="stepping", step=7), newest_step=7)
    made, ending = a_watch(swarm, observer)
    made.watch_to_the_end()
    world_line, operator_line = map(str, ending.why)
    assert world_line.startswith("world was killed by SIGKILL")
    assert operator_line.startswith(OPERATOR)
    assert not started


class Clock:
    """A world that says nothing until `ends_at_s`, as an orchestrator sees it that looks at these times [s]."""

    def __init__(self, looks_at_s: Iterator[float], ends_at_s: float) -> None:
        self.now_s = 0.0
        self._looks_at_s, self._ends_at_s = looks_at_s, ends_at_s

    def work(self, within_s: float) -> bool:
        self.now_s = next(self._looks_at_s)
        return False

    @property
    def exit_code(self) -> int | None:
        return None if self.now_s < self._ends_at_s else 0


def whys(monkeypatch: pytest.MonkeyPatch, looks_at_s: Iterator[float], ends_at_s: float) -> list[str]:
    """What a watch says of a world that is silent until its end."""
    clock = Clock(looks_at_s, ends_at_s)
    monkeypatch.setattr(watch, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
    observer = an_observer(work=clock.work, status=None, heard_at=0.0, newest_step=7)
    swarm = a_swarm(part=lambda role: clock, ended=list)
    made, ending = a_watch(swarm, observer)
    made.watch_to_the_end()
    return [str(line) for line in ending.why]


def test_a_world_that_is_silent_for_too_long_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    """And not before."""
    too_long_s = PATIENCE_S + watch.SILENCE_S + 1.0
    assert len(whys(monkeypatch, count(0.0, 0.1), ends_at_s=too_long_s)) == 1
    assert not whys(monkeypatch, count(0.0, 0.1), ends_at_s=too_long_s - 2.0)


def test_who_did_not_look_blames_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """An orchestrator that was stopped, or held up by its disk, has not heard what the world said meanwhile."""
    looks = chain(arange(0.0, 10.0, 0.1), count(10.0 + 2 * PATIENCE_S, 0.1))
    assert not whys(monkeypatch, map(float, looks), ends_at_s=10.0 + 2.5 * PATIENCE_S)


@pytest.mark.parametrize(
    ("role", "phase", "stops"), [(AGENT, "waiting", 1), (AGENT, "running", 0), (OPERATOR, "running", 0)]
)
def test_a_part_lost_before_the_first_step_ends_the_run_and_one_lost_in_it_does_not(
    role: str, phase: str, stops: int, stack: ExitStack, tmp_path: Path
) -> None:
    """The world's next status tells which: the newest may be older than the step. An operator is started again."""
    process = Told(UNTIL_KILLED, told_after=0)
    lost = Part(role, 0, cast(Any, process), tmp_path / "log")
    stack.callback(lost.close)
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
    a_watch(swarm, observer)[0].watch_to_the_end()
    assert len(stopped) == stops
    assert started == [True] * (role == OPERATOR)


class EndedPart(RunPart):
    exit_code: int | None = None


Death = tuple[str, int, int]
"""A part's role, its number and its exit code."""


class Watched:
    """A watch over a swarm in which parts end while it looks; the world ends in the look after the last."""

    def __init__(self, folder: Path, looks: Sequence[tuple[int, Sequence[Death]]], phase: str = "stepping") -> None:
        self.did: list[str] = []
        """What the watch did to the swarm."""
        self._folder, self._looks, self._phase = folder, iter(looks), phase
        self._parts = [self._part(WORLD), self._part(OPERATOR)]
        self._observer = an_observer(work=self._look, status=None, newest_step=-1)
        swarm = a_swarm(
            station=object(),
            part=self._newest,
            ended=lambda: [part for part in self._parts if part.exit_code is not None],
            stop_world=lambda: self.did.append("stop the world"),
            start_operator=lambda publish_all, is_restart: self._start(OPERATOR),
            start_station=lambda: self._start(STATION),
            give_up_station=lambda: self.did.append("give up the station"),
        )
        watch, self.ending = a_watch(swarm, self._observer)
        watch.watch_to_the_end()

    @property
    def why(self) -> list[str]:
        """The reasons, without what a disk has free; a part that the world must place in time as its name."""
        return [one.name if isinstance(one, RunPart) else one.partition(":")[0] for one in self.ending.why]

    def _part(self, role: str, number: int = 0, code: int | None = None) -> EndedPart:
        part = EndedPart(role, number, self._folder / "logs" / "part.log")
        part.exit_code = code
        part.ends_as_planned = number == PLANNED
        return part

    def _newest(self, role: str) -> EndedPart:
        return next(part for part in reversed(self._parts) if part.role == role)

    def _start(self, role: str) -> None:
        self.did.append(f"start the {role}")
        self._parts.append(self._part(role))

    def _look(self, within_s: float) -> bool:
        step, deaths = next(self._looks, (self._observer.newest_step, None))
        self._observer.status, self._observer.newest_step = SimpleNamespace(phase=self._phase, step=step), step
        self._parts += [self._part(*death) for death in deaths or ()]
        if deaths is None:
            self._newest(WORLD).exit_code = 0
            if self._newest(OPERATOR).exit_code is None:
                self._newest(OPERATOR).exit_code = 0
        return False


PLANNED = 99


@pytest.mark.parametrize(
    ("looks", "why", "logs"),
    [
        ([(7, [(AGENT, 3, 1)])], ["agent 3"], {"agent 3"}),
        ([(7, [(AGENT, PLANNED, 1), (AGENT, 4, 0)])], [], set()),
        ([(7, [(AGENT, 3, NO_ROOM), (AGENT, 4, 1)])], ["agent 3", "agent 4"], {"agent 4"}),
        ([(7, [(AGENT, 3, NO_ROOM), (AGENT, 4, NO_ROOM)])], ["agent 3"], set()),
        ([(7, [(AGENT, 3, NO_ROOM)]), (8, [(AGENT, 4, NO_ROOM)])], ["agent 3"], set()),
        ([(7, [(AGENT, 3, LIMIT_REACHED)])], ["agent 3"], set()),
    ],
    ids=["failed", "as planned", "full disk", "full disk at once", "full disk one after the other", "limit"],
)
def test_an_agent_that_failed_is_named_once(
    looks: list[tuple[int, list[Death]]], why: list[str], logs: set[str], tmp_path: Path
) -> None:
    """With the end of its log, unless its line tells the cause; a full disk has one line."""
    watched = Watched(tmp_path, looks)
    assert (watched.why, set(watched.ending.logs)) == (why, logs)
    assert watched.did == []


def test_an_agent_that_failed_before_the_first_step_has_a_line_that_says_so(tmp_path: Path) -> None:
    """And the world need not wait for it."""
    watched = Watched(tmp_path, [(-1, [(AGENT, 3, 1)]), (-1, [])], phase="waiting")
    assert (watched.why, watched.did) == (["agent 3 ended with exit code 1 before the first step"], ["stop the world"])


OPERATOR_DIES = [(OPERATOR, 0, 1)]


@pytest.mark.parametrize(
    ("steps", "restarts"),
    [
        ([7], 1),
        ([7, 7, 7], 3),
        ([7, 7, 7, 7], 3),
        ([7, 8, 9, 10, 11, 12], 6),
        ([7, 7, 7, 8, 8, 8], 6),
        ([7, 7, 7, 8, 8, 8, 8], 6),
        ([-1, -1], 2),
        ([-1, -1, -1], 2),
    ],
)
def test_an_operator_is_started_again_while_that_helps(steps: list[int], restarts: int, tmp_path: Path) -> None:
    """Three times without a new step; then the run ends."""
    watched = Watched(tmp_path, [(step, OPERATOR_DIES) for step in steps])
    gave_up = restarts < len(steps)
    assert watched.did == ["start the operator"] * restarts + ["stop the world"] * gave_up
    assert watched.ending.operator_restarts == restarts
    assert set(watched.ending.logs) == ({"operator"} if gave_up else set())


def test_an_operator_without_room_is_not_started_again(tmp_path: Path) -> None:
    """It would find none either."""
    watched = Watched(tmp_path, [(7, [(OPERATOR, 0, NO_ROOM)])])
    assert (watched.did, watched.ending.operator_restarts) == (["stop the world"], 0)
    assert watched.why == [f"operator could not write into {tmp_path}"]
    assert watched.ending.logs == {}


@pytest.mark.parametrize(("deaths", "gives_up"), [(1, False), (5, False), (6, True)])
def test_a_station_is_started_again_five_times(deaths: int, gives_up: bool, tmp_path: Path) -> None:
    """Then the run goes on without it."""
    watched = Watched(tmp_path, [(step, [(STATION, 0, 1)]) for step in range(deaths)])
    assert watched.did == ["start the station"] * min(deaths, 5) + ["give up the station"] * gives_up
    assert watched.why[deaths:] == ["the station is not started again after 5 times"] * gives_up


STEP_TAKES_S = 0.01
STOPPED_AT = 20


class SlowSink:
    """A recorder to which the world is always far ahead; the run is asked to end in one of its steps."""

    def __init__(self, stop: Stop) -> None:
        self._stop = stop
        self.steps: list[int] = []

    def step(self, truth: Truth, reports: Sequence[Report]) -> None:
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
        a_watch(swarm, observer, stop)[0].watch_to_the_end()
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
