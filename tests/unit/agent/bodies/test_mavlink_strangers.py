"""What comes from others than the vehicle: strangers' datagrams, a second vehicle, another autopilot."""

import socket
import time
from random import Random

import pytest

from deltaswarm_agent.body import BodyContext
from deltaswarm_board.bodies.mavlink import MavlinkBody
from deltaswarm_board.bodies.mavlink_settings import MavlinkSettings
from deltaswarm_wire.checked import load
from deltaswarm_wire.settings import AgentSettings
from tests.support.fields import free_port
from tests.support.flights import TASK, a_body, flying, go
from tests.support.swarms import wait_until


def test_datagrams_of_strangers_take_nothing_away() -> None:
    """Single bytes, which look like the beginning of a message, and rubbish: the vehicle gets its set-points."""
    with a_body() as (body, flight), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:

        def is_there() -> bool:
            for data in (b"\xfd", b"\xfd\xff", b"x" * 300):
                stranger.sendto(data, ("127.0.0.1", flight.port))
            assert not body.sense(0.0).fault
            return flight.at[0] > 3.0

        began = time.monotonic()
        go(body, 2.0, 0.0, is_there, "three metres to the east")
        assert time.monotonic() - began < 30.0, "1.5 s of flight, on a busy machine"
        stranger.settimeout(0.0)
        with pytest.raises(BlockingIOError):
            stranger.recv(100)


def test_a_second_vehicle_with_its_number_makes_it_stand(caplog: pytest.LogCaptureFixture) -> None:
    with a_body() as (body, flight), flying(flight.port):
        wait_until(lambda: "two vehicles" in body.sense(0.0).fault, "a fault")
        go(body, 2.0, 0.0, lambda: flight.speed_mps == 0.0, "standing")
    assert "is heard, too" not in caplog.text


def test_the_vehicle_that_is_named_is_flown(caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()
    options = load(MavlinkSettings, {"device": f"udpin:127.0.0.1:{port}", "vehicle": 77})
    body = MavlinkBody(options, BodyContext(1, load(AgentSettings, TASK), Random(1)))
    try:
        with flying(port):
            wait_until(lambda: "autopilot 1 is heard, too; the vehicle is 77" in caplog.text, "a warning")
            assert body.sense(0.0).fault == "no heartbeat from the vehicle"
    finally:
        body.close()
