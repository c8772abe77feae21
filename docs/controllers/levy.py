"""A Levy walk: many short legs and a few long ones. An agent that senses events stands and observes the nearest."""

import math
from dataclasses import dataclass

from deltaswarm_agent.controller import STAND, ControllerContext, Decision, OperatorReport, Percept
from deltaswarm_wire.checked import key


@dataclass(frozen=True)
class LevySettings:
    """The options in `[control]`."""

    exponent: float = key(2.0, "of the legs' lengths: 1 is mostly long legs, 3 mostly short ones", above=1, high=3)
    shortest_m: float = key(2.0, "shortest leg [m]", above=0)


class Levy:
    """One agent."""

    Settings = LevySettings

    def __init__(self, context: ControllerContext) -> None:
        self.settings, self.arena, self.rng = context.settings, context.shared, context.rng
        self.goal: tuple[float, float] | None = None

    def step(self, percept: Percept) -> Decision:
        """Observe what is sensed; else go on to the end of the leg."""
        here = percept.pose
        if percept.events:
            self.goal = None
            nearest = min(percept.events, key=lambda event: math.dist(here, (event.x_m, event.y_m)))
            return Decision(STAND, observed=(nearest.event,), report=OperatorReport((nearest,)), role="attending")
        if self.goal is None or math.dist(here, self.goal) < 0.01:
            self.goal = self.next_goal(here)
        time_s = max(math.dist(here, self.goal) / self.arena.speed_mps, self.arena.step_s)
        velocity = ((self.goal[0] - here[0]) / time_s, (self.goal[1] - here[1]) / time_s)
        return Decision(velocity, until=percept.step + max(1, int(time_s / self.arena.step_s)))

    def next_goal(self, here: tuple[float, float]) -> tuple[float, float]:
        """The end of the next leg, within the arena."""
        length_m = self.settings.shortest_m * (1 - self.rng.random()) ** (1 / (1 - self.settings.exponent))
        heading = self.rng.uniform(0, math.tau)
        x_m, y_m = here[0] + length_m * math.cos(heading), here[1] + length_m * math.sin(heading)
        return min(max(x_m, 0.0), self.arena.width_m), min(max(y_m, 0.0), self.arena.height_m)
