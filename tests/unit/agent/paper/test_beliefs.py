"""Beliefs about events: the freshest word wins, by whatever way it comes, and nothing is believed for long."""

import random
from collections.abc import Iterable

from hypothesis import example, given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.beliefs import Beliefs, to_cm
from deltaswarm_agent.controllers.paper.frames import MAX_AGE, MAX_EVENTS, MAX_GONE, Gone, Sighting
from deltaswarm_wire.messages import Event
from tests.support.cores import STEPS, event
from tests.support.tiers import in_one_test

NOW = 1000

Words = dict[tuple[int, int], bool]
words: st.SearchStrategy[Words] = st.dictionaries(
    st.tuples(st.integers(0, 7), st.integers(0, 40)), st.booleans(), max_size=30
)
"""By event and age: whether it was seen then, or found gone."""


def some(sensing_range_m: float = 5.0) -> Beliefs:
    return Beliefs(sensing_range_m, STEPS)


def place_cm(number: int) -> int:
    return 1000 * number


def hear(beliefs: Beliefs, told: Iterable[tuple[tuple[int, int], bool]], now: int = NOW) -> None:
    for (number, age), seen in told:
        if seen:
            beliefs.hear([Sighting(number, place_cm(number), 0, age)], [], now)
        else:
            beliefs.hear([], [Gone(number, age)], now)


def freshest(told: Words) -> dict[int, tuple[int, bool]]:
    """By event the least age, and what was said of it then."""
    return {number: (age, told[number, age]) for number, age in sorted(told, reverse=True)}


@given(words)
@example({(1, STEPS.memory - 1): True, (2, STEPS.memory): True, (3, STEPS.gone - 1): False, (4, STEPS.gone): False})
def test_the_freshest_word_wins(told: Words) -> None:
    """That it is there or that it is gone: per event what was found last, so far as it is not too old."""
    beliefs = some()
    hear(beliefs, told.items())
    beliefs.forget(NOW)
    last = {number: (age + 1, seen) for number, (age, seen) in freshest(told).items()}
    there = [number for number, (age, seen) in sorted(last.items()) if seen and age <= STEPS.memory]
    gone = {number: age for number, (age, seen) in last.items() if not seen and age <= STEPS.gone}
    assert beliefs.active() == [Event(number, 10.0 * number, 0.0) for number in there]
    assert bool(beliefs) == bool(there)
    assert {sighting.event: sighting.age for sighting in beliefs.sightings(NOW)} == {n: last[n][0] for n in there}
    assert {row.event: row.age for row in beliefs.departures(NOW)} == gone


@given(words, st.randoms(use_true_random=False))
def test_words_may_come_in_any_order_and_twice(told: Words, order: random.Random) -> None:
    one, other = some(), some()
    hear(one, told.items())
    hear(other, order.sample([*told.items()] * 2, 2 * len(told)))
    assert one.active() == other.active()
    assert sorted(one.sightings(NOW)) == sorted(other.sightings(NOW))
    assert sorted(one.departures(NOW)) == sorted(other.departures(NOW))


@given(words, st.sets(st.integers(0, 7)))
def test_the_own_sensor_is_fresher_than_any_word(told: Words, sensed: set[int]) -> None:
    """What it shows is there, with age 0; what it fails to show close by is gone."""
    beliefs = some()
    hear(beliefs, told.items())
    beliefs.sense([event(number, 10 * number, 0) for number in sensed], 0.0, 0.0, NOW)
    beliefs.forget(NOW)
    assert {sighting.event for sighting in beliefs.sightings(NOW) if sighting.age == 0} == sensed
    assert (0 in {row.event for row in beliefs.active()}) == (0 in sensed)


@in_one_test(("distance_m", "is_gone"), [(0.0, True), (4.94, True), (4.96, False), (8.0, False)])
def test_an_event_that_should_be_sensed_and_is_not_is_gone(distance_m: float, is_gone: bool) -> None:
    """Within sensing range less 5 cm; beyond that the sensor cannot tell."""
    beliefs = some()
    beliefs.sense([event(3, 50, 50)], 50.0, 50.0, NOW)
    beliefs.sense([], 50.0 + distance_m, 50.0, NOW + 1)
    assert bool(beliefs) == (not is_gone)
    assert beliefs.departures(NOW + 3) == ((Gone(3, 2),) if is_gone else ())


def test_a_sensing_range_below_the_margin_finds_nothing_gone() -> None:
    beliefs = some(0.02)
    beliefs.sense([event(3, 50, 50)], 50.0, 50.0, NOW)
    beliefs.sense([], 50.0, 50.0, NOW + 1)
    assert beliefs


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_places_are_told_to_the_nearest_centimetre(x_m: float, y_m: float) -> None:
    beliefs = some()
    beliefs.sense([event(1, x_m, y_m)], x_m, y_m, NOW)
    (sighting,) = beliefs.sightings(NOW)
    assert abs(sighting.x_cm - 100 * x_m) <= 0.5 + 1e-6
    other = some()
    other.hear([sighting], [], NOW + 1)
    assert other.active() == beliefs.active()
    assert [to_cm(found.x_m) for found in other.active()] == [sighting.x_cm]


@given(st.integers(2, 6), st.lists(st.booleans(), min_size=20, max_size=60))
def test_echoes_keep_no_event_alive(agents: int, chatter: list[bool]) -> None:
    """Members that tell one another of what nobody senses any more: none believes it after 12 steps."""
    crowd = [some() for _ in range(agents)]
    crowd[0].sense([event(1, 50, 50)], 46.0, 50.0, 0)
    for now, speaks in enumerate(chatter, 1):
        said = [(one.sightings(now - 1), one.departures(now - 1)) for one in crowd]
        for listener in crowd:
            for sightings, departures in said if speaks else said[:1]:
                listener.hear(sightings, departures, now)
            listener.forget(now)
        assert any(crowd) == (now <= STEPS.memory)


@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 11)), min_size=20, max_size=60, unique_by=lambda w: w[0]))
def test_of_many_events_the_freshest_are_told(told: list[tuple[int, int]]) -> None:
    """16 at most, by id among equals; all of them are believed."""
    beliefs = some()
    hear(beliefs, (((number, age), True) for number, age in told))
    expected = sorted((age + 1, number) for number, age in told)[:MAX_EVENTS]
    assert [(sighting.age, sighting.event) for sighting in beliefs.sightings(NOW)] == expected
    assert len(beliefs.active()) == len(told)


@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 29)), min_size=9, max_size=40, unique_by=lambda w: w[0]))
def test_of_many_departures_the_freshest_are_told(told: list[tuple[int, int]]) -> None:
    beliefs = some()
    hear(beliefs, (((number, age), False) for number, age in told))
    expected = sorted((age + 1, number) for number, age in told)[:MAX_GONE]
    assert [(row.age, row.event) for row in beliefs.departures(NOW)] == expected


@given(words, st.integers(0, 300))
def test_no_age_is_too_great_for_the_air(told: Words, later: int) -> None:
    """After forgetting, whatever is told fits its field."""
    beliefs = some()
    hear(beliefs, told.items())
    beliefs.forget(NOW + later)
    rows = (*beliefs.sightings(NOW + later), *beliefs.departures(NOW + later))
    assert all(0 <= row.age <= max(STEPS.memory, STEPS.gone) <= MAX_AGE for row in rows)
