"""The pace of clock `realtime`, driven by a clock of the test's own."""

from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_world.core.pace import RealTimePace

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
        """Let the rest of the tick pass."""
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
    """It is what the step's participants have time until."""
    wall = Wall(began_s=10.0)
    assert wall.pace.next_tick() == 10.0 + TICK_S
    wall.now_s += 0.125
    wall.wait()
    assert wall.pace.next_tick() == 10.0 + 2 * TICK_S


def test_a_delay_of_less_than_a_tick_is_made_up_for() -> None:
    """The next step is shorter by it, and that is no overrun."""
    wall = Wall(began_s=0.0)
    assert [wall.step(0.375), wall.step(), wall.step()] == [0.375, 0.5, 0.75]
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
    """After it the tick goes on where it stood."""
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
