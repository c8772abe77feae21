"""One step of an agent on a board: body and air make the frame, the core decides, the body moves.

The core is the same as in a simulation and does not know the difference.
"""

import math
from collections.abc import Callable

from deltaswarm_agent.body import Body, Sensed
from deltaswarm_agent.core import AgentCore, Decision
from deltaswarm_wire.codec import MAX_ABS_M
from deltaswarm_wire.messages import Frame

Place = tuple[float, float]


class SetPoint:
    """Where the body was last sent; near enough to it is there.

    A core plans to the centimetre, and a robot's place is never that certain. Without this an agent would circle
    round a place that it has reached, and a member that stands would seem to move.
    """

    def __init__(self, arrive_m: float) -> None:
        self._arrive_m = arrive_m
        self._at: Place | None = None

    def settled(self, x_m: float, y_m: float) -> Place:
        """The place to plan from: the set point if the body is near it, else the body's own [m]."""
        if self._at is not None and math.dist(self._at, (x_m, y_m)) <= self._arrive_m:
            return self._at
        return x_m, y_m

    def advance(self, at: Place, vx_mps: float, vy_mps: float, step_s: float) -> None:
        """The next set point: a step from where the agent planned."""
        self._at = (at[0] + vx_mps * step_s, at[1] + vy_mps * step_s)


class Driver:
    """Body, core and set point of one agent."""

    def __init__(self, core: AgentCore, body: Body, *, arrive_m: float, max_std_m: float) -> None:
        self.core = core
        self.faulty_steps = 0
        """Steps in which the body could not be relied on."""
        self.fault = ""
        """What is wrong with the body now, in a few words."""
        self.place_m = (math.nan, math.nan)
        """Where the agent takes itself to be."""
        self._body = body
        self._set_point = SetPoint(arrive_m)
        self._max_std_m = max_std_m

    def step(self, step: int, time_s: float, hear: Callable[[Place], tuple[bytes, ...]]) -> Decision | None:
        """Sense, decide, move. None where the body is not well: then it stands, and the agent says nothing.

        `hear` gives the frames that were heard at a place [m].
        """
        sensed = self._body.sense(time_s)
        self.fault = sensed.fault or self._doubt(sensed)
        if self.fault:
            self.faulty_steps += 1
            self.place_m = (math.nan, math.nan)
            hear(self.place_m)
            self._body.move(0.0, 0.0, ())
            return None
        self.place_m = self._set_point.settled(sensed.x_m, sensed.y_m)
        decision = self.core.step(Frame(step, time_s, False, *self.place_m, sensed.events, hear(self.place_m)))
        act = decision.act
        self._body.move(act.vx_mps, act.vy_mps, act.observed)
        self._set_point.advance(self.place_m, act.vx_mps, act.vy_mps, self.core.settings.step_s)
        return decision

    def _doubt(self, sensed: Sensed) -> str:
        if not (math.isfinite(sensed.x_m) and math.isfinite(sensed.y_m)):
            return "the place is no number"
        if max(abs(sensed.x_m), abs(sensed.y_m)) > MAX_ABS_M:
            return "the place is not on this Earth"
        if not sensed.std_m <= self._max_std_m:
            return f"the place is uncertain by {sensed.std_m:g} m"
        return ""
