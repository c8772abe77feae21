"""Where an agent is and was: newly in range, legal distances, arrival."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_agent.controllers.paper.whereabouts import AT_PLACE_M, RANGE_MARGIN_M, Whereabouts
from tests.support.cores import OUTSIDE, PARENT, PARENT_AT, Lone, Place, agent_settings, attending, member

TRAIL, RANGE_M, D_MIN_M = 4, 10.0, 6.0
near = st.integers(3000, 7000).map(lambda centimetres: centimetres / 100)
places = st.tuples(near, near)


def after(*way: Place) -> Whereabouts:
    """An agent that was asked at each place of a way, and is at the last."""
    here = Whereabouts(agent_settings(range_m=RANGE_M), D_MIN_M, TRAIL)
    for place in way[:-1]:
        here.move_to(place, ())
        here.keep()
    here.move_to(way[-1], ())
    return here


@given(st.lists(places, min_size=1, max_size=8), places)
def test_newly_met_is_in_range_now_and_out_of_range_a_moment_ago(way: list[Place], sender: Place) -> None:
    """Both: of the last places at least one was out of range, and this one is within it."""
    distances_m = [math.dist(place, sender) for place in way]
    if all(abs(distance_m - RANGE_M) > 1e-6 for distance_m in distances_m):
        was_out = any(distance_m > RANGE_M for distance_m in distances_m[:-1][-TRAIL:])
        is_new = distances_m[-1] <= RANGE_M and was_out
        assert after(*way).is_newly_met(member((PARENT,), sender)) == is_new


def test_an_agent_that_leaves_a_neighbours_range_does_not_meet_it() -> None:
    """A frame that comes late, when its sender is out of range again, calls nobody to the sender's event."""
    lone = Lone(at=OUTSIDE)
    lone.step()
    lone.step(attending(PARENT, PARENT_AT, 4, PARENT_AT), at=(60.5, 50.0))
    assert lone.core.state is State.WALKING
    lone.step(attending(PARENT, PARENT_AT, 4, PARENT_AT), at=(59.5, 50.0))
    assert lone.core.state is State.GOING


@given(st.lists(places, min_size=1, max_size=8), places)
def test_places_between_two_steps_count_as_those_of_steps(way: list[Place], sender: Place) -> None:
    """An agent that is told of its way afterwards knows what one knows that was asked at each place."""
    asleep = Whereabouts(agent_settings(range_m=RANGE_M), D_MIN_M, TRAIL)
    asleep.move_to(way[-1], tuple(way[:-1]))
    frame = member((PARENT,), sender)
    assert asleep.is_newly_met(frame) == after(*way).is_newly_met(frame)


@given(places, places)
def test_legal_is_apart_and_within_reach(place: Place, sender: Place) -> None:
    """From d_min to the range less 2 cm."""
    here, frame, distance_m = after(place), member((PARENT,), sender), math.dist(place, sender)
    if abs(distance_m - D_MIN_M) > 1e-6 and abs(distance_m - RANGE_M + RANGE_MARGIN_M) > 1e-6:
        assert here.is_apart(frame) == (distance_m >= D_MIN_M)
        assert here.is_within_reach(frame) == (distance_m <= RANGE_M - RANGE_MARGIN_M)
        assert here.is_legal(frame) == (here.is_apart(frame) and here.is_within_reach(frame))


@pytest.mark.parametrize(("away_m", "arrived"), [(0.0, True), (AT_PLACE_M - 1e-6, True), (AT_PLACE_M + 1e-6, False)])
def test_an_agent_is_at_a_place_within_1_cm(away_m: float, arrived: bool) -> None:
    """Places on the air are rounded to centimetres."""
    assert after((50.0, 50.0 + away_m)).is_at(50.0, 50.0) == arrived
