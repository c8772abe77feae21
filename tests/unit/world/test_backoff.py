"""The backoff with late agents: what each miss costs, and when it is forgiven."""

from deltaswarm_world.core.pace import FORGIVEN_STEPS, TimeoutBackoff


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
