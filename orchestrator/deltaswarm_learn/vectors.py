"""Code an agent's percept as a vector of numbers, and decode a vector as its decision.

Learning environments and trained policies share this file, so that both see and do the same.
"""

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from deltaswarm_agent.controller import Decision, OperatorReport, Percept
from deltaswarm_wire.checked import key
from deltaswarm_wire.codec import MAX_AGENT_ID
from deltaswarm_wire.messages import FREE, Event
from deltaswarm_wire.operator_messages import MAX_REPORTED
from deltaswarm_wire.settings import AgentSettings

Vector = npt.NDArray[np.float32]

ATTENDING = "attending"

HOUR_S = 3600.0
"""The time at which the observation of time reaches its greatest value [s]."""

FULL_SCALE = 32_767
"""The integer that stands for 1.0 in a broadcast."""

EVENT_NUMBERS = 3
"""Numbers of each slot for an event: mask, and place along x and y."""


@dataclass(frozen=True)
class VectorSettings:
    """The sizes of the vectors."""

    event_slots: int = key(4, "events in an observation: the nearest of those that the agent senses", low=0, high=64)
    frame_slots: int = key(8, "heard broadcasts in an observation, one of each sender", low=0, high=1000)
    message_size: int = key(4, "numbers in a broadcast", low=0, high=64)


class VectorCoding:
    """The coding of one agent's percepts and decisions.

    Args:
        settings: the sizes of the vectors.
        shared: the agent's task and body.
        agent: its number.
    """

    def __init__(self, settings: VectorSettings, shared: AgentSettings, agent: int) -> None:
        shapes = observation_shapes(settings)
        self.observation_size = sum(map(math.prod, shapes.values()))
        self.action_size = action_size(settings)
        self._settings, self._shared, self._agent = settings, shared, agent
        self._before_heard = self.observation_size - math.prod(shapes["heard"])
        self._body = f"<{settings.message_size}h"
        self._body_bytes = struct.calcsize(self._body)

    def observation(self, percept: Percept) -> Vector:
        """Return what the agent senses and hears as numbers from -1 to 1, in the order of `observation_shapes`."""
        shared, settings, (x_m, y_m) = self._shared, self._settings, percept.pose
        place, range_m = (2 * x_m / shared.width_m - 1, 2 * y_m / shared.height_m - 1), shared.sensing_range_m
        numbers = [1.0, 1.0, percept.time_s / HOUR_S, *place]
        for event in self._by_distance(percept)[: settings.event_slots]:
            numbers += [1.0, (event.x_m - x_m) / range_m, (event.y_m - y_m) / range_m]
        numbers += [0.0] * (self._before_heard - len(numbers))
        for message in self._heard(percept)[: settings.frame_slots]:
            numbers += [1.0, *message]
        numbers += [0.0] * (self.observation_size - len(numbers))
        vector: Vector = np.minimum(np.maximum(np.array(numbers, dtype=np.float32), -1.0), 1.0)
        return vector

    def decision(self, percept: Percept, action: Vector) -> Decision:
        """Return what a valid action means: see `ACTION`."""
        east, north, attends, speaks, reports, *message = action.tolist()
        speed_mps = self._shared.speed_mps
        near = self._by_distance(percept)
        observed = (near[0].event,) if near and attends > 0 else ()
        return Decision(
            velocity=(east * speed_mps, north * speed_mps),
            observed=observed,
            payload=struct.pack(self._body, *[round(number * FULL_SCALE) for number in message])
            if speaks > 0
            else None,
            report=OperatorReport(tuple(near[:MAX_REPORTED])) if reports > 0 else None,
            role=ATTENDING if observed else FREE,
        )

    def _by_distance(self, percept: Percept) -> list[Event]:
        if len(percept.events) < 2:
            return list(percept.events)
        x_m, y_m = percept.pose
        return sorted(percept.events, key=lambda event: (math.hypot(event.x_m - x_m, event.y_m - y_m), event.event))

    def _heard(self, percept: Percept) -> list[list[float]]:
        """Return the valid broadcasts, those of senders after the agent first: no sender is favoured by all."""
        heard = sorted([((sender - self._agent) % (MAX_AGENT_ID + 1), payload) for sender, payload in percept.heard])
        valid = [payload for _, payload in heard if len(payload) == self._body_bytes]
        return [[number / FULL_SCALE for number in struct.unpack(self._body, payload)] for payload in valid]


OWN = {"alive": (), "asked": (), "time": (), "position": (2,)}
"""The numbers about the agent itself, with their shapes: whether it has a process; whether it is asked to decide in
this step; the time in hours, at most 1; its position, from -1 to 1 within the arena."""

ACTION = ("east", "north", "attend", "speak", "report")
"""The first numbers of an action: velocity along x and y as a share of the agent's greatest speed; and, if above 0,
that it works on the nearest event, broadcasts, and reports what it senses to the operator. The broadcast follows."""


def observation_shapes(settings: VectorSettings) -> dict[str, tuple[int, ...]]:
    """Return the parts of an observation with their shapes, in order.

    Each row of `events` is a mask and the event's place relative to the agent in sensing ranges, the nearest first;
    each row of `heard` a mask and a broadcast. Rows without an event or a broadcast are 0.
    """
    events = settings.event_slots, EVENT_NUMBERS
    return {**OWN, "events": events, "heard": (settings.frame_slots, 1 + settings.message_size)}


def action_size(settings: VectorSettings) -> int:
    """Return the number of numbers in an action."""
    return len(ACTION) + settings.message_size


def checked_action(action: Any, size: int, whose: str = "an action") -> Vector:
    """Return an action as float32 numbers, cut to -1 and 1.

    Raises:
        TypeError, ValueError: the action has another shape or type, or is not finite.
    """
    try:
        array = np.asarray(action)
    except ValueError:
        raise ValueError(f"{whose} must be an array of shape ({size},) (got rows of different lengths)") from None
    if array.dtype.kind != "f":
        raise TypeError(f"{whose} must be an array of floats (got {array.dtype} from {type(action).__name__})")
    if array.shape != (size,):
        raise ValueError(f"{whose} must be an array of shape ({size},) (got {array.shape})")
    if not np.isfinite(array).all():
        raise ValueError(f"{whose} must have finite numbers (got {array.tolist()})")
    cut: Vector = np.minimum(np.maximum(array, -1.0), 1.0).astype(np.float32)
    return cut
