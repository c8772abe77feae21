"""The way of an agent to the goal that a plan gives it."""

import math

from deltaswarm_agent.controller import STAND, Velocity
from deltaswarm_wire.messages import Pose
from deltaswarm_wire.settings import AgentSettings

ATTENDING = "attending"

STANDS_M = 0.02
"""An agent this near to its goal stands; positions on the air are rounded to centimetres."""


def way(at_m: Pose, goal_m: Pose, task: AgentSettings) -> tuple[Velocity, bool]:
    """Return the velocity towards a goal, and whether the agent stands there."""
    way_m = math.dist(at_m, goal_m)
    if way_m <= STANDS_M:
        return STAND, True
    time_s = max(way_m / task.speed_mps, task.step_s)
    return ((goal_m[0] - at_m[0]) / time_s, (goal_m[1] - at_m[1]) / time_s), False
