"""Positions of agents and open events as the planner knows them, and an agent's way to its goal."""

import math

from deltaswarm_agent.controller import STAND, Velocity
from deltaswarm_agent.controllers.central.frames import SensedFrame
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


GONE_MARGIN_M = 0.05
"""An event this far within an agent's sensing range, and not sensed, is gone: positions on the air are rounded."""


class Overview:
    """Positions of agents and open events, from frames and, between them, from the goals that agents were given."""

    def __init__(self, task: AgentSettings, forget_s: float) -> None:
        self.agents: dict[int, Pose] = {}
        """Where each agent probably is [m]."""
        self.events: dict[int, Pose] = {}
        """Where each event is that some agent sensed and none found missing [m]."""
        self._heard_s: dict[int, float] = {}
        self._task, self._forget_s = task, forget_s

    def update(self, agent: int, frame: SensedFrame, now_s: float) -> None:
        self.agents[agent], self._heard_s[agent] = frame.pose, now_s
        within_m = self._task.sensing_range_m - GONE_MARGIN_M
        sensed = {event.event: (event.x_m, event.y_m) for event in frame.events}
        self.events = {
            event: at_m
            for event, at_m in self.events.items()
            if event in sensed or math.dist(at_m, frame.pose) >= within_m
        } | sensed

    def advance(self, goals: dict[int, Pose], now_s: float) -> None:
        """Let a step pass in which agents move towards their goals; forget agents that were not heard for long."""
        for agent in [agent for agent, heard_s in self._heard_s.items() if now_s - heard_s > self._forget_s]:
            del self._heard_s[agent], self.agents[agent]
        stride_m = self._task.speed_mps * self._task.step_s
        for agent, (x_m, y_m) in self.agents.items():
            if agent in goals:
                (to_x_m, to_y_m), way_m = goals[agent], math.dist(goals[agent], (x_m, y_m))
                share = min(1.0, stride_m / way_m) if way_m > 0.0 else 0.0
                self.agents[agent] = x_m + share * (to_x_m - x_m), y_m + share * (to_y_m - y_m)
