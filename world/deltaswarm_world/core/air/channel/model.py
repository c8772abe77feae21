"""The interface of a radio model, and its inputs."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.air.channel.links import LinkModel
from deltaswarm_world.core.air.channel.reach import Reach
from deltaswarm_world.core.chance import generator


@dataclass(frozen=True)
class Context:
    """The inputs of a new model."""

    scenario: Scenario
    reach: Reach
    """Reach by distance or power, before any model cuts a link."""

    @property
    def ends(self) -> int:
        """Number of agents; their ids are the ends of links."""
        return self.scenario.agents.count

    @property
    def step_s(self) -> float:
        """Length of a step [s]."""
        return self.scenario.run.step_s

    def rng(self, stream: int) -> np.random.Generator:
        """Make a model's own generator, so that models do not change each other's draws."""
        return generator(self.scenario.seed, stream)


class Model(LinkModel, Protocol):
    """An optional model. A model that draws has its own unique `stream` number."""

    @classmethod
    def of(cls, context: Context) -> Self | None:
        """Build the scenario's model; None if it is off."""
