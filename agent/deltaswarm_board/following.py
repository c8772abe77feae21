"""A robot that follows the body which the world simulates for its agent: hardware in the loop with a real robot.

The agent decides by the simulated body alone, as in any run. The robot gets the same velocity, plus a part of its
distance to the simulated body, so that neither a late start nor drift adds up.
"""

import logging
import math

from deltaswarm_agent.body import Body
from deltaswarm_board.driver import checked_sensed
from deltaswarm_wire.messages import Act, Frame

log = logging.getLogger("deltaswarm.follower")

GAIN_PER_S = 0.5
"""Part of the distance to the simulated body that is made up per second, where steps are short."""

GAIN_PER_STEP = 0.5
"""The same per step at most: with more, the robot would swing about a body that stands."""

BESIDE_M, APART_M = 1.0, 2.0
"""Distances to the simulated body at which a robot has caught up with it, and has lost it."""


class Follower:
    """One robot, which may be anything that a board drives. Its faults do not stop the agent; they are logged."""

    def __init__(self, body: Body, step_s: float) -> None:
        self.fault = ""
        """Why the robot does not follow, in a few words; "" if it does."""
        self._body = body
        self._gain_per_s = min(GAIN_PER_S, GAIN_PER_STEP / step_s)
        self._is_beside = True

    def follow(self, frame: Frame, act: Act) -> None:
        """Move the robot with its simulated body; call once a step."""
        before, self.fault = self.fault, ""
        try:
            self._follow(frame, act)
        except Exception as error:  # a plug-in may raise anything
            self.fault = f"body failed: {type(error).__name__}: {error}"
        if self.fault != before:
            log.warning("the robot is %s", f"not well: {self.fault}" if self.fault else "well")

    def _follow(self, frame: Frame, act: Act) -> None:
        sensed = checked_sensed(self._body.sense(frame.time_s))
        self.fault = sensed.fault
        if sensed.fault:
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
        """Stop and release the robot."""
        self._body.close()
