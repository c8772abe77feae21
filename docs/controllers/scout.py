"""A scout walks from one random place to the next. When it senses an event, it stops and observes it."""

import math
from dataclasses import dataclass

from deltaswarm_agent.controller import STAND, ControllerContext, Decision, OperatorReport, Percept
from deltaswarm_wire.checked import key


@dataclass(frozen=True)
class ScoutSettings:
    """The options in `[control]`."""

    margin_m: float = key(2.0, "distance of the places from the arena's edge [m]", low=0, high=10)


class Scout:
    """One agent."""

    Settings = ScoutSettings

    def __init__(self, context: ControllerContext) -> None:
        self.settings, self.arena, self.rng = context.settings, context.shared, context.rng
        self.goal = self.random_place()

    def step(self, percept: Percept) -> Decision:
        """Observe an event within sensing range; otherwise walk on."""
        if percept.events:
            event = percept.events[0]
            return Decision(STAND, observed=(event.event,), report=OperatorReport((event,)), role="attending")
        while (left_m := math.dist(percept.pose, self.goal)) < self.arena.speed_mps * self.arena.step_s:
            self.goal = self.random_place()
        (x_m, y_m), per_s = percept.pose, self.arena.speed_mps / left_m
        return Decision(((self.goal[0] - x_m) * per_s, (self.goal[1] - y_m) * per_s))

    def random_place(self) -> tuple[float, float]:
        """Draw a place in the arena [m]."""
        margin_m, arena = self.settings.margin_m, self.arena
        x_m = self.rng.uniform(margin_m, arena.width_m - margin_m)
        return x_m, self.rng.uniform(margin_m, arena.height_m - margin_m)
