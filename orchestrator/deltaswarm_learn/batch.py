"""Many swarms as one Gymnasium environment of vectors, by the dense engine: arrays of shape (runs, agents, numbers)."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from deltaswarm_dense.acted_run import ActedRun, why_not
from deltaswarm_dense.compiled import compile_once
from deltaswarm_learn.environment import checked_cycles, scenario_of
from deltaswarm_learn.rewards import REWARDS, signed_weights
from deltaswarm_learn.vectors import Vector, VectorSettings, action_size, observation_shapes
from deltaswarm_scenario.scenario import MAX_SEED, Scenario
from deltaswarm_wire.checked import Problem, SettingsError

Numbers = np.ndarray[Any, np.dtype[np.float64]]


class SwarmVectorEnv(VectorEnv[Vector, Vector, Any]):
    """Runs of one scenario with different seeds, all in one step; observations and rewards are those of `SwarmEnv`.

    Every agent of a run has the run's reward. All runs end in the same step; `reset` begins new ones.

    Args:
        runs: their number.
        scenario, keys, max_cycles, event_slots, frame_slots, message_size: as for `SwarmEnv`. Of the radio only range
            and loss can be other than perfect; there are no faults, obstacles, uplink, nor anybody at the console.
        reward: a name of `REWARDS`, or weights by name.

    Raises:
        SettingsError: arguments are wrong; the text says what must hold.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.DISABLED}  # noqa: RUF012

    def __init__(
        self,
        runs: int,
        scenario: str | Path | Scenario = "smoke",
        keys: Mapping[str, Any] | None = None,
        *,
        reward: str | Mapping[str, float] = "told",
        max_cycles: int | None = None,
        event_slots: int = 4,
        frame_slots: int = 8,
        message_size: int = 4,
    ) -> None:
        if isinstance(runs, bool) or not isinstance(runs, int) or runs < 1:
            raise SettingsError([Problem("runs", repr(runs), "must be a whole number from 1 on")])
        self._sizes = event_slots, frame_slots, message_size
        names = ("event_slots", "frame_slots", "message_size")
        self.scenario = scenario_of(scenario, keys or {}, dict(zip(names, self._sizes, strict=True)))
        if because := why_not(self.scenario):
            raise SettingsError([Problem("scenario", because, "must be one that the dense engine covers")])
        self.max_cycles = checked_cycles(max_cycles, self.scenario.run.steps) or self.scenario.run.steps
        weights = dict(signed_weights(reward))
        self._weights = np.array([weights.get(name, 0.0) for name in REWARDS])
        coded, agents = VectorSettings(*self._sizes), self.scenario.agents.count
        size = sum(map(math.prod, observation_shapes(coded).values()))
        self.num_envs = runs
        self.single_observation_space = Box(-1.0, 1.0, (agents, size), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (agents, action_size(coded)), np.float32)
        self.observation_space = batch_space(self.single_observation_space, runs)
        self.action_space = batch_space(self.single_action_space, runs)
        self._observations = np.zeros((runs, agents, size), np.float32)
        self._numbers: Numbers = np.zeros((runs, len(REWARDS)))
        compile_once("dense environment", lambda: self.reset(seed=0))
        self._runs: list[ActedRun] = []
        self._seeds = np.random.default_rng(self.scenario.seed)
        self._done = 0

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin all runs; return observations (runs, agents, numbers) and an empty dict.

        Args:
            seed: that of the first run, with the next ones for the others, or one for each; without it, the next of a
                sequence that the scenario's seed determines.
            options: not used.
        """
        seeds = self._seeds.integers(MAX_SEED, size=self.num_envs).tolist() if seed is None else seed
        if isinstance(seeds, int | np.integer):
            seeds = [int(seeds) + number for number in range(self.num_envs)]
        seeds = list(seeds)
        whole = [one for one in seeds if isinstance(one, int | np.integer) and 0 <= one <= MAX_SEED]
        if len(whole) != self.num_envs:
            must = f"seed must be a whole number from 0 to {MAX_SEED}, or {self.num_envs} of them"
            raise ValueError(f"{must} (got {seed!r:.80})")
        run = dataclasses.replace(self.scenario.run, duration_s=self.max_cycles * self.scenario.run.step_s)
        scenarios = [dataclasses.replace(self.scenario, seed=int(one), run=run) for one in whole]
        self._runs, self._done = [ActedRun(scenario, self._sizes) for scenario in scenarios], 0
        self._advance(np.zeros(self.action_space.shape or (), np.float32))
        return self._observations.copy(), {}

    def step(self, actions: Vector) -> tuple[Vector, Numbers, np.ndarray, np.ndarray, dict[str, Any]]:
        """Run one step of all runs; `actions` (runs, agents, numbers) are cut to -1 and 1.

        Returns:
            Observations, rewards (runs,), terminations and truncations (runs,), and a dict; with the last step it has
            each run's `digest`.

        Raises:
            TypeError, ValueError: actions have another shape or type, or are not finite.
            RuntimeError: the runs are over, or there are none.
        """
        if not self._runs or self._done == self.max_cycles:
            raise RuntimeError("step must follow reset, and end with the runs: call reset for others")
        given = np.asarray(actions)
        if given.dtype.kind != "f" or given.shape != self.action_space.shape or not np.isfinite(given).all():
            must = f"actions must be finite floats of shape {self.action_space.shape}"
            raise ValueError(f"{must} (got {given.dtype} of shape {given.shape})")
        self._advance(given.clip(-1.0, 1.0).astype(np.float32))
        self._done += 1
        is_over = self._done == self.max_cycles
        digests = {"digest": np.array([run.digest for run in self._runs])} if is_over else {}
        rewards: Numbers = np.array([math.fsum(row) for row in (self._numbers * self._weights).tolist()])
        ended, cut = np.zeros(self.num_envs, np.bool_), np.full(self.num_envs, is_over)
        return self._observations.copy(), rewards, ended, cut, digests

    def _advance(self, actions: Vector) -> None:
        for number, run in enumerate(self._runs):
            run.advance(actions[number], self._observations[number], self._numbers[number])
