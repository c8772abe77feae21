"""The area that trees cover."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_world.core.environment import COVERAGE_EVERY_S, Coverage

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


@pytest.mark.parametrize("range_m", [3.0, 7.5, 20.0])
def test_the_disc_grows_with_the_sensing_range(range_m: float) -> None:
    """To within a third of a cell along its edge."""
    found = area_m2((50.0, 30.0), agents={"sensing_range_m": range_m})
    assert found == pytest.approx(math.pi * range_m**2, abs=math.tau * range_m / 3)


@given(st.lists(places, max_size=6))
def test_the_area_is_the_union_within_the_arena(members: list[tuple[float, float]]) -> None:
    """What two members cover counts once, what is beyond the walls not at all."""
    assert area_m2(*members) == by_hand_m2(members)


@pytest.mark.parametrize("step_s", [0.5, 1.0, 4.0, 60.0])
def test_coverage_is_measured_each_10_s(step_s: float) -> None:
    """From the first step on, as nearly as whole steps allow."""
    measure = coverage(run={"step_s": step_s})
    due = [step for step in range(100) if measure.is_due(step)]
    assert due == list(range(0, 100, max(1, round(COVERAGE_EVERY_S / step_s))))
