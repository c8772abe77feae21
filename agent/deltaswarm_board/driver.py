"""One step of an agent on a board: body and air provide the frame, the controller decides, the body moves.

The controller is the same as in a simulation. It is called in every step.
"""

import logging
import math
import threading
from collections.abc import Callable
from typing import Any

from deltaswarm_agent.body import NOWHERE, Body, Sensed
from deltaswarm_agent.core.agent_core import AgentCore, StepOutput
from deltaswarm_wire.codec import MAX_ABS_M, MAX_ID
from deltaswarm_wire.messages import FREE, MAX_SENSED, Act, Event, Frame, Heard
from deltaswarm_wire.plugin_errors import PluginError, described

Place = tuple[float, float]

MAX_FAILURES = 10
"""The agent fails after this many consecutive steps in which calls of the body failed."""


def checked_sensed(sensed: Any) -> Sensed:
    """Convert a body's result to plain numbers; a body may be third-party code."""
    if not isinstance(sensed, Sensed):
        raise TypeError(f"sense must return a Sensed (got {type(sensed).__name__})")
    if sensed.fault:
        return NOWHERE._replace(fault=str(sensed.fault))
    if len(sensed.events) > MAX_SENSED:
        raise ValueError(f"events must be at most {MAX_SENSED} (got {len(sensed.events)})")
    events = tuple([Event(int(event), float(x_m), float(y_m)) for event, x_m, y_m in sensed.events])
    for event in events:
        if not (0 <= event.event <= MAX_ID and abs(event.x_m) <= MAX_ABS_M and abs(event.y_m) <= MAX_ABS_M):
            raise ValueError(f"events must have valid ids and positions (got {event})")
    return Sensed(float(sensed.x_m), float(sensed.y_m), float(sensed.std_m), events)


def _failure(error: Exception) -> str:
    return f"body failed: {error if isinstance(error, PluginError) else described(error)}"


class SetPoint:
    """The last target of the body, which counts as reached within a tolerance.

    A controller plans to the centimetre, but a robot's position is less certain. Without a tolerance an agent would
    circle around a target, and a member that stands would seem to move.
    """

    def __init__(self, arrive_m: float) -> None:
        self._arrive_m = arrive_m
        self._at: Place | None = None

    def settled(self, x_m: float, y_m: float) -> Place:
        """Return the position to plan from: the set point if the body is near it, else the body's own [m]."""
        if self._at is not None and math.dist(self._at, (x_m, y_m)) <= self._arrive_m:
            return self._at
        return x_m, y_m

    def advance(self, at: Place, vx_mps: float, vy_mps: float, step_s: float) -> None:
        """Move the set point one step on from the planning position."""
        self._at = (at[0] + vx_mps * step_s, at[1] + vy_mps * step_s)


class Driver:
    def __init__(self, core: AgentCore, body: Body, *, step_s: float, arrive_m: float, max_std_m: float) -> None:
        self.role = FREE
        """The agent's role by its own account."""
        self.faulty_steps = 0
        """Steps with a fault of the body."""
        self.fault = ""
        """The body's present fault in a few words; "" if none."""
        self.place_m = (math.nan, math.nan)
        """The agent's estimate of its position."""
        self._core = core
        self._step_s = step_s
        self._body = body
        self._set_point = SetPoint(arrive_m)
        self._max_std_m = max_std_m
        self._failures = 0

    @property
    def refused_commands(self) -> int:
        """Number of relayed commands that are malformed, not the operator's, or over."""
        return self._core.commands.rejected

    def step(self, step: int, time_s: float, hear: Callable[[Place], tuple[Heard, ...]]) -> StepOutput | None:
        """Sense, decide, move. With a fault of the body, stand, send nothing, and return None.

        `hear` returns the frames received at a position [m].
        """
        before, self.fault = self._failures, ""
        output = self._step(step, time_s, hear)
        if self._failures == before:
            self._failures = 0
        return output

    def _step(self, step: int, time_s: float, hear: Callable[[Place], tuple[Heard, ...]]) -> StepOutput | None:
        sensed = self._sense(time_s)
        self.fault = self.fault or sensed.fault or doubt_of(sensed, self._max_std_m)
        if self.fault:
            self.faulty_steps += 1
            self.place_m = (math.nan, math.nan)
            hear(self.place_m)
            self._move(0.0, 0.0, ())
            return None
        self.place_m = self._set_point.settled(sensed.x_m, sensed.y_m)
        heard = hear(self.place_m)
        output = self._core.step(Frame(step, time_s, False, *self.place_m, (), sensed.events, heard))
        act = output.act
        self.role = act.tree_status.role
        if self._move(act.vx_mps, act.vy_mps, act.observed):
            self._set_point.advance(self.place_m, act.vx_mps, act.vy_mps, self._step_s)
        return output

    def _sense(self, time_s: float) -> Sensed:
        try:
            return checked_sensed(self._body.sense(time_s))
        except Exception as error:  # a plug-in may raise anything
            self._fails(error)
            return NOWHERE

    def _move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> bool:
        try:
            self._body.move(vx_mps, vy_mps, observed)
        except Exception as error:
            self._fails(error)
            return False
        return True

    def _fails(self, error: Exception) -> None:
        if not self.fault:
            self._failures += 1
            if self._failures >= MAX_FAILURES:
                raise error
            self.fault = _failure(error)


def doubt_of(sensed: Sensed, max_std_m: float) -> str:
    """Return why a position cannot be relied on; empty if it can."""
    if not (math.isfinite(sensed.x_m) and math.isfinite(sensed.y_m)):
        return "position is not a number"
    if max(abs(sensed.x_m), abs(sensed.y_m)) > MAX_ABS_M:
        return "position is off the Earth"
    if not 0.0 <= sensed.std_m <= max_std_m:
        return f"position has a standard deviation of {sensed.std_m:g} m"
    return ""


log = logging.getLogger("deltaswarm.follower")

GAIN_PER_S = 0.5
"""Part of the distance to the simulated body that is made up per second, where steps are short."""

GAIN_PER_STEP = 0.5
"""The same per step at most: with more, the robot would swing about a body that stands."""

CLOSE_WITHIN_S = 1.0
"""What a step of the robot's has to end in, before the robot is told to stand all the same."""

BESIDE_M, APART_M = 1.0, 2.0
"""Distances to the simulated body at which a robot has caught up with it, and has lost it."""


class Follower:
    """One robot, which may be anything that a board drives. Its faults do not stop the agent; they are logged."""

    def __init__(self, body: Body, step_s: float, max_std_m: float) -> None:
        self.fault = ""
        """Why the robot does not follow, in a few words; "" if it does."""
        self._body = body
        self._max_std_m = max_std_m
        self._lock = threading.Lock()
        self._is_closed = False
        self._gain_per_s = min(GAIN_PER_S, GAIN_PER_STEP / step_s)
        self._is_beside = True

    def follow(self, frame: Frame, act: Act) -> None:
        """Move the robot with its simulated body; call once a step."""
        before, self.fault = self.fault, ""
        try:
            with self._lock:
                if not self._is_closed:
                    self._follow(frame, act)
        except Exception as error:  # a plug-in may raise anything
            self.fault = _failure(error)
        if self.fault != before:
            log.warning("the robot is %s", f"not well: {self.fault}" if self.fault else "well")

    def _follow(self, frame: Frame, act: Act) -> None:
        sensed = checked_sensed(self._body.sense(frame.time_s))
        self.fault = sensed.fault or doubt_of(sensed, self._max_std_m)
        if self.fault:
            self._body.move(0.0, 0.0, ())
            return
        ahead_m = (frame.x_m - sensed.x_m, frame.y_m - sensed.y_m)
        vx_mps, vy_mps = (
            velocity_mps + self._gain_per_s * left_m
            for velocity_mps, left_m in zip((act.vx_mps, act.vy_mps), ahead_m, strict=True)
        )
        self._body.move(vx_mps, vy_mps, ())
        apart_m = math.hypot(*ahead_m)
        if apart_m > APART_M if self._is_beside else apart_m <= BESIDE_M:
            self._is_beside = not self._is_beside
            what = "beside its simulated body" if self._is_beside else f"{apart_m:.1f} m from its simulated body"
            log.info("the robot is %s", what)

    def close(self) -> None:
        """Have the robot stand, from any thread; it is not moved after that. A second call does nothing."""
        is_free = self._lock.acquire(timeout=CLOSE_WITHIN_S)  # a body that hangs must not keep the robot moving
        was_closed, self._is_closed = self._is_closed, True
        if is_free:
            self._lock.release()
        if not was_closed:
            self._body.close()
