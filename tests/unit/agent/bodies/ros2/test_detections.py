"""Detections become events with numbers that other agents give as well."""

import pytest

from deltaswarm_ros2.detections import Detections
from deltaswarm_wire.messages import Event
from tests.support.tiers import in_one_test


def detections(cell_m: float = 1.0) -> Detections:
    return Detections(20.0, 10.0, cell_m, range_m=4.0, lost_s=1.0)


def test_an_event_has_the_number_of_its_cell() -> None:
    """Counted along x, row by row; two detections in one cell are one event, the later one."""
    found = detections()
    found.take([(2.5, 3.5), (2.6, 3.6), (4.5, 3.5)], (2.0, 3.0), 0.0)
    assert found.events(0.5) == (Event(62, 2.6, 3.6), Event(64, 4.5, 3.5))


def test_an_event_keeps_its_number_while_it_moves_a_little() -> None:
    """Across the border of its cell; a detection farther away than half a cell is another event."""
    found = detections()
    for x_m in (2.9, 3.1, 3.5):
        found.take([(x_m, 3.5)], (2.0, 3.0), 0.0)
    assert [event.event for event in found.events(0.0)] == [62]
    found.take([(4.2, 3.5)], (2.0, 3.0), 0.0)
    assert [event.event for event in found.events(0.0)] == [62, 64]


def test_what_is_not_detected_again_ends() -> None:
    found = detections()
    found.take([(2.5, 3.5)], (2.0, 3.0), 0.0)
    assert found.events(1.0)
    assert not found.events(1.1)
    found.take([], (2.0, 3.0), 1.2)
    assert not found.events(0.0)


@in_one_test("place", [(-0.1, 3.0), (2.0, 10.0), (7.0, 3.0), (float("nan"), 3.0)])
def test_what_no_sensor_of_the_swarm_would_sense_is_ignored(place: tuple[float, float]) -> None:
    found = detections()
    found.take([place], (2.0, 3.0), 0.0)
    assert not found.events(0.0)


def test_cells_must_not_be_too_many_for_their_numbers() -> None:
    with pytest.raises(ValueError, match=r"at most 4294967295 cells .got 0\.0001"):
        detections(0.0001)
