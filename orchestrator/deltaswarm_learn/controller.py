"""Controllers that decide by vectors: the base class of trained policies, and the controller of an environment."""

from typing import Any, ClassVar

import numpy as np

from deltaswarm_agent.controller import ControllerContext, Decision, Percept
from deltaswarm_learn.vectors import Vector, VectorCoding, VectorSettings, checked_action
from deltaswarm_wire.foreign import name_of


class PolicyController:
    """One agent that decides by a policy: a subclass defines `act`, and names its weights in `data_files`.

    What decides a run must be in the file of the subclass, in what that imports, or in `data_files`, a tuple of paths
    relative to the file: then a run's identity covers it.
    """

    Settings: ClassVar[type[Any]] = VectorSettings
    """A subclass may have another frozen dataclass here, with `VectorSettings` as its base."""

    def __init__(self, context: ControllerContext) -> None:
        self.context = context
        self.coding = VectorCoding(context.settings, context.shared, context.agent)

    def act(self, observation: Vector) -> Any:
        """Return the action for an observation, both as in the environment; called once per step, in order."""
        raise NotImplementedError(f"{type(self).__name__} must have a method act(observation)")

    def step(self, percept: Percept) -> Decision:
        """Decide in every step."""
        found = self.act(self.coding.observation(percept))
        try:
            action = checked_action(found, self.coding.action_size)
        except (TypeError, ValueError) as error:
            raise type(error)(f"{name_of(type(self))}.act: {error}") from None
        return self.coding.decision(percept, action)


class ActedUpon(PolicyController):
    """One agent of a learning environment, which sets `action` before each step."""

    def __init__(self, context: ControllerContext) -> None:
        super().__init__(context)
        self.action: Vector = np.zeros(self.coding.action_size, dtype=np.float32)

    def step(self, percept: Percept) -> Decision:
        """Do what `action` says."""
        return self.coding.decision(percept, self.action)
