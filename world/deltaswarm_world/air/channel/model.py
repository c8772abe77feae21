"""What a model of the air is, and what it is built from."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from deltaswarm_wire.settings import Scenario
from deltaswarm_world.air.channel.links import Piece
from deltaswarm_world.air.channel.reach import Reach
from deltaswarm_world.environment import generator


@dataclass(frozen=True)
class Context:
    """What a model may build itself from."""

    scenario: Scenario
    reach: Reach
    """Who is in reach at all, before any model cuts a link."""

    @property
    def ends(self) -> int:
        """Number of agents; their ids are the ends of links."""
        return self.scenario.agents.count

    @property
    def step_s(self) -> float:
        """Length of a step [s]."""
        return self.scenario.run.step_s

    def rng(self, stream: int) -> np.random.Generator:
        """A model's own generator, so that switching one model on changes nothing of another's draws."""
        return generator(self.scenario.seed, stream)


class Model(Piece, Protocol):
    """A model that a scenario switches on. One that draws has a `stream` of its own: a number used nowhere else."""

    @classmethod
    def of(cls, context: Context) -> Self | None:
        """Build the model that the scenario asks for; None if it is off."""
