"""The area that trees cover."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_world.core.coverage import COVERAGE_EVERY_S, Coverage

DISC_M2 = math.pi * 25
places = st.tuples(st.floats(0, 100), st.floats(0, 60))


def coverage(**tables: Any) -> Coverage:
    return Coverage(load(Scenario, {"arena": {"width_m": 100, "height_m": 60}, **tables}))


def area_m2(*members: tuple[float, float], **tables: Any) -> float:
    return coverage(**tables).area_m2(np.array(members).reshape(-1, 2))


def by_hand_m2(members: list[tuple[float, float]]) -> int:
    """Cells of 1 m whose centre is within 5 m of a member."""
    return sum(
        any((x + 0.5 - mx) ** 2 + (y + 0.5 - my) ** 2 <= 25 for mx, my in members)
        for x in range(100)
        for y in range(60)
    )


@given(st.floats(6, 94), st.floats(6, 54))
def test_one_member_covers_its_disc(x_m: float, y_m: float) -> None:
    """Area pi r^2, as near as a grid of 1 m comes."""
    assert area_m2((x_m, y_m)) == pytest.approx(DISC_M2, rel=0.1)


@pytest.mark.parametrize("range_m", [3.0, 7.5, 20.0])
def test_the_disc_grows_with_the_sensing_range(range_m: float) -> None:
    """To within a third of a cell along its edge."""
    found = area_m2((50.0, 30.0), agents={"sensing_range_m": range_m})
    assert found == pytest.approx(math.pi * range_m**2, abs=math.tau * range_m / 3)


@given(st.lists(places, max_size=6))
@settings(max_examples=40)
def test_the_area_is_the_union_within_the_arena(members: list[tuple[float, float]]) -> None:
    """What two members cover counts once, what is beyond the walls not at all."""
    assert area_m2(*members) == by_hand_m2(members)


def test_walls_cut_discs() -> None:
    """Half of one at a wall, a quarter in a corner, no wrapping around."""
    assert area_m2((50.0, 0.0)) == pytest.approx(DISC_M2 / 2, rel=0.1)
    assert area_m2((100.0, 60.0)) == pytest.approx(DISC_M2 / 4, rel=0.15)
    assert area_m2((0.0, 60.0)) == pytest.approx(DISC_M2 / 4, rel=0.15)


def test_nobody_covers_nothing() -> None:
    """No trees, no area."""
    assert area_m2() == 0.0


@pytest.mark.parametrize("step_s", [0.5, 1.0, 4.0, 60.0])
def test_coverage_is_measured_each_10_s(step_s: float) -> None:
    """From the first step on, as nearly as whole steps allow."""
    measure = coverage(run={"step_s": step_s})
    due = [step for step in range(100) if measure.is_due(step)]
    assert due == list(range(0, 100, max(1, round(COVERAGE_EVERY_S / step_s))))
