"""The MAVLink body against MAVSDK: its servers are the vehicle, its client is a person with a ground station."""

from contextlib import AbstractContextManager

import pytest

from deltaswarm_board.bodies.mavlink import MavlinkBody
from tests.support.flights import Flight, a_body, go
from tests.support.swarms import wait_until

pytest.importorskip("mavsdk", reason="needs MAVSDK: pip install -e '.[peers]'")
pytestmark = [pytest.mark.processes, pytest.mark.slow]

OFFBOARD = "mode(393216)"
"""What MAVSDK's server says for it: an autopilot of no kind, with PX4's number."""


def flown(**options: object) -> AbstractContextManager[tuple[MavlinkBody, Flight]]:
    return a_body(module="tests.peers.mavsdk_vehicle", modes=[OFFBOARD], **options)


def wait_for_fault(body: MavlinkBody, text: str) -> None:
    go(body, 1.0, 0.0, lambda: text in body.sense(0.0).fault, f"the fault {text!r}")


def flies_again(body: MavlinkBody, flight: Flight) -> None:
    go(body, 1.0, 0.0, lambda: flight.speed_mps > 0.9, "speed again")
    assert body.sense(0.0).fault == ""


def test_a_vehicle_goes_where_the_agent_wants() -> None:
    with flown(origin_north_m=-2.0, origin_east_m=-5.0) as (body, flight):
        assert body.sense(0.0)[:2] == pytest.approx((5.0, 2.0))
        go(body, 30.0, 0.0, lambda: flight.at[0] > 1.0, "a metre to the east")
        assert flight.speed_mps == pytest.approx(2.0)
        go(body, 0.0, 1.0, lambda: flight.at[1] > 0.5, "half a metre to the north")
        wait_until(lambda: flight.speed_mps == 0.0, "a stand, as the agent says nothing more")


@pytest.mark.parametrize(
    ("word", "fault", "back"),
    [
        ("disarm", "not armed", "arm"),
        ("manual", "mode Mode(65536)", "offboard"),
        ("land", "not in the air", "fly"),
        ("lose", "no position", "link"),
    ],
)
def test_a_person_takes_it_over_and_gives_it_back(word: str, fault: str, back: str) -> None:
    """By MAVSDK's client, in two cases; a lost link comes back from another address."""
    with flown() as (body, flight):
        flies_again(body, flight)
        flight.tell(word)
        wait_for_fault(body, fault)
        go(body, 1.0, 0.0, lambda: flight.speed_mps == 0.0, "a stand")
        flight.tell(back)
        flies_again(body, flight)


def test_a_vehicle_that_refuses_to_be_armed_is_not_flown() -> None:
    with flown() as (body, flight):
        for word in ("disarm", "unarmable", "arm"):
            flight.tell(word)
        wait_for_fault(body, "not armed")
        sent = flight.track[-1][5]
        go(body, 1.0, 0.0, lambda: flight.track[-1][5] > sent + 20, "set-points")
        assert flight.speed_mps == 0.0
        assert "not armed" in body.sense(0.0).fault
