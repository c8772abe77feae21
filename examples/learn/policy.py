"""A policy of one matrix: which actions follow from what an agent senses and hears now, and from what has changed.

`Policy` runs it as a controller: `--set control.mode=policy:Policy`, with this folder in PYTHONPATH. `train.py` trains
it.
"""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from deltaswarm_agent.controller import ControllerContext
from deltaswarm_learn.controller import PolicyController

Observation = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]

WEIGHTS = Path(__file__).with_name("weights.npy")

SHAPE = (18, 9)
"""Rows of the matrix: nine features now and their change since the step before; columns: the numbers of an action."""


def features(observation: Observation) -> Floats:
    """Return one, the place, the nearest event (mask, place), the share of full slots, and the mean of what is heard.

    Of a broadcast the first two numbers count; what they say is learned. Observations may be stacked.
    """
    numbers = observation.astype(np.float64)
    events = numbers[..., 5:17]
    masks, x, y = numbers[..., 17::5], numbers[..., 18::5], numbers[..., 19::5]
    others = np.maximum(masks.sum(axis=-1), 1.0)
    found = np.empty((*numbers.shape[:-1], 9))
    found[..., 0] = 1.0
    found[..., 1:3] = numbers[..., 3:5]
    found[..., 3:6] = events[..., :3]
    found[..., 6] = events[..., ::3].mean(axis=-1)
    found[..., 7] = x.sum(axis=-1) / others
    found[..., 8] = y.sum(axis=-1) / others
    return found


class MatrixPolicy:
    """The policy of one agent, or of several at once; it remembers the features of the step before."""

    def __init__(self, weights: Floats) -> None:
        self.weights = weights
        self.before: Floats | None = None

    def act(self, observation: Observation) -> Floats:
        """Return the action for an observation, or a row for each of stacked ones."""
        now = features(observation)
        change = now - (now if self.before is None else self.before)
        self.before = now
        action: Floats = np.tanh(np.concatenate([now, change], axis=-1) @ self.weights)
        return action


class Policy(PolicyController):
    """One agent with the trained weights."""

    data_files = ("weights.npy",)

    def __init__(self, context: ControllerContext) -> None:
        super().__init__(context)
        self.act = MatrixPolicy(np.load(WEIGHTS)).act


class Wanderer(PolicyController):
    """One agent that walks at random, works on the nearest event and reports all that it senses, without training.

    It is what a trained policy has to be compared with: the paper's agents report only the event that they attend.
    """

    def __init__(self, context: ControllerContext) -> None:
        super().__init__(context)
        self.heading = context.rng.uniform(0, math.tau)

    def act(self, observation: Observation) -> Floats:
        """Return the action for an observation."""
        rng, senses = self.context.rng, observation[5] > 0
        if rng.random() < 0.1 or max(abs(observation[3:5])) > 0.99:
            self.heading = rng.uniform(0, math.tau)
        return np.array([math.cos(self.heading), math.sin(self.heading), 1, 0, 1 if senses else 0, 0, 0, 0, 0], float)
