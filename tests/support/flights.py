"""A vehicle with MAVLink in a process of its own, and a body that flies it."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from typing import Any

from deltaswarm_agent.body import BodyContext
from deltaswarm_board.bodies.mavlink import MavlinkBody
from deltaswarm_board.bodies.mavlink_settings import MavlinkSettings
from deltaswarm_wire.checked import load
from deltaswarm_wire.settings import AgentSettings
from tests.support.fields import free_port
from tests.support.scripted import Scripted, scripted
from tests.support.swarms import wait_until

STEP_S = 0.2
TASK = {
    "step_s": STEP_S,
    "width_m": 20.0,
    "height_m": 20.0,
    "speed_mps": 2.0,
    "range_m": 9.0,
    "control": {"d_min_m": 3.0, "mode": "hierarchical", "rho": 1, "gamma_max": 100_000},
}


class Flight(Scripted):
    """A vehicle whose rows are those of `vehicle.py`."""

    port: int
    """Where the body listens."""

    @property
    def at(self) -> tuple[float, float]:
        """Where it is: (east, north) [m], which is (x, y) of an arena that is not turned."""
        return (self.track[-1][2], self.track[-1][1]) if self.track else (math.nan, math.nan)

    @property
    def speed_mps(self) -> float:
        return math.hypot(*self.track[-1][3:5]) if self.track else math.nan


@contextmanager
def flying(port: int, *kind: str, module: str = "tests.support.vehicle") -> Iterator[Flight]:
    """A vehicle that speaks to a port, with nothing left of it afterwards."""
    with scripted(Flight, module, port, *kind) as flight:
        flight.port = port
        yield flight


@contextmanager
def a_body(*kind: str, module: str = "tests.support.vehicle", **options: Any) -> Iterator[tuple[MavlinkBody, Flight]]:
    """A body with its vehicle, once it is well."""
    port = free_port()
    table = {"device": f"udpin:127.0.0.1:{port}", "stall_s": 0.3, "max_speed_mps": 2.0, **options}
    context = BodyContext(1, load(AgentSettings, TASK), Random(1))
    body = MavlinkBody(load(MavlinkSettings, table), context)
    try:
        with flying(port, *kind, module=module) as flight:
            wait_until(lambda: not body.sense(0.0).fault, "a vehicle that is well")
            yield body, flight
    finally:
        body.close()


def go(body: MavlinkBody, vx_mps: float, vy_mps: float, until: Any, what: str) -> None:
    def commanded() -> bool:
        body.move(vx_mps, vy_mps, ())
        return bool(until())

    wait_until(commanded, what)
