"""When steps begin and end: by `realtime`, the operator's pace and late agents, on a clock of the test's own."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire.commands import Pace, Turn
from deltaswarm_world.core.pace import FORGIVEN_STEPS, RealTimePace, StepGate, TimeoutBackoff
from deltaswarm_world.core.turns import AWAITED, OFF, Turns
from tests.support.tiers import in_one_test

TICK_S = 0.25
"""A sum of powers of two, as all times here are: no rounding."""

durations = st.integers(0, 64).map(lambda sixteenths: sixteenths / 16)


class Wall:
    """A wall clock that goes only when a test lets it, and a pace that lives by it."""

    def __init__(self, began_s: float = 1000.0) -> None:
        self.now_s = began_s
        self.slept: list[float] = []
        self.said: list[str] = []
        self.pace = RealTimePace(TICK_S, lambda: self.now_s, self.said.append)

    def wait(self) -> None:
        self.slept.append(max(0.0, self.pace.tick_ends_s - self.now_s))
        self.now_s += self.slept[-1]

    def step(self, busy_s: float = 0.0) -> float:
        """Do one step with some work in it; when it was over."""
        self.pace.next_tick()
        self.now_s += busy_s
        self.wait()
        return self.now_s


def test_a_step_lasts_one_tick_whatever_its_work() -> None:
    """The rest of the tick is slept, and small differences do not add up."""
    wall = Wall(began_s=0.0)
    works = [0.0, 0.125, 0.0625, 0.25] * 25
    assert [wall.step(work) for work in works] == [TICK_S * (step + 1) for step in range(100)]
    assert wall.slept == [TICK_S - work for work in works]
    assert (wall.pace.overruns, wall.said) == (0, [])


def test_the_end_of_a_step_is_known_as_it_begins() -> None:
    wall = Wall(began_s=10.0)
    assert wall.pace.next_tick() == 10.0 + TICK_S
    wall.now_s += 0.125
    wall.wait()
    assert wall.pace.next_tick() == 10.0 + 2 * TICK_S


def test_a_delay_of_less_than_a_tick_is_made_up_for() -> None:
    """The next step is shorter by it, and that is no overrun."""
    wall = Wall(began_s=0.0)
    assert [wall.step(0.375), wall.step(), wall.step()] == [0.375, 0.5, 0.75]
    assert [wall.step(2 * TICK_S), wall.step(), wall.step()] == [1.25, 1.25, 1.5], "a whole tick as well"
    assert wall.pace.overruns == 0


def test_no_burst_follows_a_delay() -> None:
    """However many ticks it took, the next step has a whole one, and so have those after it."""
    wall = Wall(began_s=0.0)
    assert wall.step(10 * TICK_S) == 2.5
    assert [wall.step() for _ in range(3)] == [2.75, 3.0, 3.25]
    assert wall.pace.overruns == 1


def test_overruns_are_counted_and_said_once() -> None:
    """A machine on which each step takes three ticks: the complaint names the tick."""
    wall = Wall()
    for _ in range(10):
        wall.step(3 * TICK_S)
    assert wall.pace.overruns == 9, "those that began late"
    [said] = wall.said
    assert f"{TICK_S:g} s" in said


def test_a_pause_makes_nobody_late() -> None:
    wall = Wall(began_s=0.0)
    wall.step()
    wall.now_s += 7.0
    wall.pace.pause(7.0)
    assert wall.step() == 2 * TICK_S + 7.0
    assert wall.pace.overruns == 0


@given(st.lists(durations, min_size=1, max_size=40))
def test_it_is_never_faster_than_the_wall_clock(works: list[float]) -> None:
    """Whatever the steps take: n of them need at least n ticks, any two in a row at least one."""
    wall = Wall(began_s=0.0)
    ends = [wall.step(work) for work in works]
    assert all(end >= TICK_S * (number + 1) for number, end in enumerate(ends))
    assert all(later - began >= TICK_S for began, later in zip([0.0, *ends], ends[1:], strict=False))
    assert ends[-1] <= TICK_S * len(works) + sum(works)


class Gate:
    """A step gate at speed 2 with steps of 1 s, so a tick is 0.5 s of wall time; the first step begins at 100 s."""

    def __init__(self, speed: float = 2.0, mode: str = OFF) -> None:
        self.now_s = 100.0
        self.turns = Turns(mode)
        self.gate = StepGate(self.turns, 1.0, lambda: self.now_s)
        self.gate.set_pace(Pace(speed, -1))
        self.begin_at(100.0)

    def begin_at(self, now_s: float) -> None:
        self.now_s = now_s
        self.gate.begin_step()


@in_one_test(
    ("begins_s", "next_s"),
    [
        (100.5, 101.0),
        (100.75, 101.0),  # half a tick late: the next step is due as if this one had been in time
        (101.0, 101.0),  # a whole tick late is still made up for, at once
        (101.0625, 101.5625),  # more is not: no burst of steps
        (107.0, 107.5),
    ],
)
def test_a_step_that_begins_late_is_made_up_for_up_to_a_tick(begins_s: float, next_s: float) -> None:
    """The pace holds on average, without a burst after a long wait."""
    stage = Gate()
    stage.begin_at(begins_s)
    assert stage.gate.wait_s(2) == next_s - begins_s
    if next_s > begins_s:
        stage.now_s = next_s - 0.0625
        assert not stage.gate.may_begin(2)
    stage.now_s = next_s
    assert stage.gate.may_begin(2)
    assert stage.gate.wait_s(2) == 0.0


def test_the_first_step_waits_for_no_pace() -> None:
    gate = StepGate(Turns(OFF), 1.0, lambda: 0.0)
    gate.set_pace(Pace(2.0, -1))
    assert gate.may_begin(0)


def test_late_steps_in_a_row_do_not_slow_the_pace() -> None:
    """Each begins a quarter of a tick late; ten of them take ten ticks."""
    stage = Gate()
    for step in range(1, 11):
        stage.begin_at(100.0 + 0.5 * step + 0.125)
    stage.now_s = 105.5
    assert stage.gate.may_begin(11)


def test_without_a_pace_every_step_may_begin_at_once() -> None:
    """The step that begins without one is where a later pace starts from."""
    stage = Gate(speed=0.0)
    stage.begin_at(103.0)
    assert stage.gate.may_begin(2)
    stage.gate.set_pace(Pace(4.0, -1))
    assert stage.gate.wait_s(2) == 0.25


@in_one_test("speed", [0.5, 1, 7, 40])
def test_steps_come_at_the_speed_that_was_asked_for(speed: float) -> None:
    """In 20 s of the wall clock, if each step of 1 s begins as soon as it may."""
    stage, step = Gate(speed=speed), 1
    while stage.now_s < 120.0:
        left_s = stage.gate.wait_s(step)
        assert left_s is not None
        if left_s:
            stage.now_s += left_s
        else:
            stage.gate.begin_step()
            step += 1
    assert step == pytest.approx(20 * speed, abs=2)


def test_another_speed_holds_from_the_next_step_on() -> None:
    stage = Gate(speed=1e-9)
    assert not stage.gate.may_begin(1)
    stage.gate.set_pace(Pace(0.0, -1))
    assert stage.gate.may_begin(1)


def test_the_operator_holds_a_step_and_all_after_it() -> None:
    """Until it says otherwise; the world has nothing to wait for but that."""
    stage = Gate()
    stage.now_s = 200.0
    stage.gate.set_pace(Pace(2.0, 3))
    assert [stage.gate.may_begin(step) for step in (2, 3, 4)] == [True, False, False]
    assert [stage.gate.wait_s(step) for step in (2, 3, 4)] == [0.0, math.inf, math.inf]
    stage.gate.set_pace(Pace(2.0, 0))
    assert not stage.gate.may_begin(0)
    stage.gate.set_pace(Pace(2.0, -1))
    assert stage.gate.may_begin(3)


def test_a_step_waits_for_the_turn_of_the_step_before_the_last() -> None:
    """How long, nobody knows; and a step that is due for its turn still keeps the pace."""
    stage = Gate(mode=AWAITED)
    assert stage.gate.wait_s(2) is None
    stage.now_s = 100.75
    assert not stage.gate.may_begin(2)
    assert stage.turns.accept(Turn(0, ())) is None
    assert stage.gate.may_begin(2)
    assert not stage.gate.may_begin(3)
    stage.now_s = 100.25
    assert (stage.gate.may_begin(2), stage.gate.wait_s(2)) == (False, 0.25)


def test_an_agent_that_is_late_again_and_again_costs_little() -> None:
    """Nine thousand steps in which it misses each: less than a minute; and a single miss is forgotten."""
    backoff = TimeoutBackoff(5.0)
    waited_s = 0.0
    for step in range(9000):
        waited_s += backoff.left_s(0, step)
        backoff.missed(0, step)
    assert 10.0 <= waited_s < 60.0
    assert backoff.left_s(1, 9000) == 5.0
    once = TimeoutBackoff(5.0)
    once.missed(0, 10)
    assert [once.left_s(0, step) for step in (11, 10 + FORGIVEN_STEPS)] == [2.5, 5.0]


def test_each_miss_is_forgiven_after_its_time() -> None:
    """One after so many steps from the first, the next after as many more; later misses put it off no longer."""
    backoff = TimeoutBackoff(8.0)
    for step in (100, 200, 300):
        backoff.missed(0, step)
    first = 100 + FORGIVEN_STEPS
    due = [first - 1, first, first + FORGIVEN_STEPS - 1, first + FORGIVEN_STEPS]
    assert [backoff.left_s(0, step) for step in due] == [1.0, 2.0, 2.0, 4.0]
    assert backoff.left_s(0, first + 2 * FORGIVEN_STEPS) == 8.0
    backoff.missed(0, first + 2 * FORGIVEN_STEPS)
    assert backoff.left_s(0, first + 3 * FORGIVEN_STEPS - 1) == 4.0, "it counts from the new miss"
    for step in (0, 10):
        backoff.missed(1, step)
    assert backoff.left_s(1, 2 * FORGIVEN_STEPS) == 8.0, "all that are due, though nobody asked meanwhile"


def test_a_step_waits_by_the_agents_that_it_waits_for() -> None:
    """From the shortest to the longest time of those; the misses of others are no matter."""
    backoff = TimeoutBackoff(8.0)
    assert backoff.with_any([0, 1], 0) == (8.0, 8.0)
    backoff.missed(0, 0)
    backoff.missed(0, 1)
    backoff.missed(2, 1)
    assert backoff.with_any([0, 1], 2) == (2.0, 8.0)
    assert backoff.with_any([0, 2], 2) == (2.0, 4.0)
    assert backoff.with_any([1], 2) == (8.0, 8.0)
    assert backoff.with_any([], 2) == (8.0, 8.0)
