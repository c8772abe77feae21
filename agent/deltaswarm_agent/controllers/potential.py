"""Virtual-force coverage: agents spread until they are far enough from each other, and observe what they sense.

After Howard, Mataric and Sukhatme 2002 (Mobile sensor network deployment using potential fields): neighbours and walls
push an agent away, the less the farther they are. Each agent broadcasts its position and knows others only from
recent frames. An agent that senses events stands, observes the nearest, and reports it to the operator.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import msgpack

from deltaswarm_agent.controller import STAND, ControllerContext, Decision, OperatorReport, Percept, Velocity
from deltaswarm_agent.recurring import Recurring
from deltaswarm_wire.checked import key
from deltaswarm_wire.codec import MAX_ABS_CM, WireError, array, integer, unpack
from deltaswarm_wire.messages import Event, Pose

SPREADING, ATTENDING = "spreading", "attending"

BEACON_BYTES = 16
"""A longer payload is no beacon."""


@dataclass(frozen=True)
class PotentialSettings:
    spacing_m: float = key(9.0, "distance below which neighbours and walls repel [m]", above=0)
    wall_share: float = key(0.5, "share of spacing_m below which a wall repels", low=0, high=1)
    gain_per_s: float = key(0.5, "velocity per metre by which a neighbour is nearer than spacing_m [1/s]", above=0)
    rest_mps: float = key(0.05, "velocity below which an agent stands still [m/s]", low=0)
    report_every_s: float = key(1.0, "interval of reports of an agent at an event, at least one step [s]", above=0)
    beacon_s: float = key(2.0, "interval at which an agent broadcasts its position [s]", above=0)
    memory_s: float = key(6.0, "time after which a silent neighbour is forgotten [s]", above=0)


class PotentialController:
    Settings: ClassVar[type[PotentialSettings]] = PotentialSettings

    def __init__(self, context: ControllerContext) -> None:
        self._settings: PotentialSettings = context.settings
        self._shared = context.shared
        self._neighbours: dict[int, tuple[Pose, float]] = {}
        """Position of each neighbour, and the time of its frame [s]."""
        self._reporting = Recurring(self._settings.report_every_s)
        self._beaconing = Recurring(self._settings.beacon_s, context.rng.uniform(0.0, self._settings.beacon_s))

    def step(self, percept: Percept) -> Decision:
        now_s = percept.time_s
        for sender, payload in percept.heard:
            place = _decode_beacon(payload)
            if place is not None:
                self._neighbours[sender] = place, now_s
        oldest_s = now_s - self._settings.memory_s
        self._neighbours = {agent: known for agent, known in self._neighbours.items() if known[1] >= oldest_s}
        beacon = self._beacon(percept.pose) if self._beaconing.is_due(now_s) else None
        if percept.events:
            nearest = min(percept.events, key=lambda event: _distance_m(percept.pose, event))
            report = OperatorReport((nearest,)) if self._reporting.is_due(now_s) else None
            return Decision(STAND, (nearest.event,), beacon, report, ATTENDING)
        velocity = self._velocity(percept.pose)
        return Decision(velocity, payload=beacon, role=SPREADING)

    def _beacon(self, pose: Pose) -> bytes:
        payload: bytes = msgpack.packb([round(100 * pose[0]), round(100 * pose[1])])
        return payload

    def _velocity(self, pose: Pose) -> Velocity:
        settings, (x_m, y_m) = self._settings, pose
        from_walls_m = settings.spacing_m * settings.wall_share
        vx = _push(x_m, from_walls_m) - _push(self._shared.width_m - x_m, from_walls_m)
        vy = _push(y_m, from_walls_m) - _push(self._shared.height_m - y_m, from_walls_m)
        for (other_x_m, other_y_m), _ in self._neighbours.values():
            dx, dy = x_m - other_x_m, y_m - other_y_m
            distance_m = math.hypot(dx, dy)
            if distance_m > 0.0:
                push = _push(distance_m, settings.spacing_m) / distance_m
                vx, vy = vx + push * dx, vy + push * dy
        vx, vy = settings.gain_per_s * vx, settings.gain_per_s * vy
        speed_mps = math.hypot(vx, vy)
        if speed_mps < settings.rest_mps:
            return STAND
        factor = min(1.0, self._shared.speed_mps / speed_mps)
        return vx * factor, vy * factor


def _push(distance_m: float, reach_m: float) -> float:
    """How much nearer than `reach_m` something is [m]."""
    return max(0.0, reach_m - distance_m)


def _distance_m(pose: Pose, event: Event) -> tuple[float, int]:
    return math.hypot(event.x_m - pose[0], event.y_m - pose[1]), event.event


def _decode_beacon(payload: bytes) -> Pose | None:
    """Return a neighbour's position [m]; None if this is no beacon."""
    try:
        x_cm, y_cm = array(unpack(payload, BEACON_BYTES), 2, "beacon")
        low, high = -MAX_ABS_CM, MAX_ABS_CM
        return integer(x_cm, low, high, "beacon.x_cm") / 100, integer(y_cm, low, high, "beacon.y_cm") / 100
    except WireError:
        return None
