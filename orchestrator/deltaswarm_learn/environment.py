"""A swarm as a PettingZoo environment: one step of the engine per step, and messages that travel through its air."""

import dataclasses
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Dict, Space
from pettingzoo import ParallelEnv

from deltaswarm.keys import overrides
from deltaswarm_agent.controller import Percept
from deltaswarm_learn.controller import ActedUpon
from deltaswarm_learn.rewards import Reward, StepOutcome, Tally, reward_function
from deltaswarm_learn.state import state_of, state_size
from deltaswarm_learn.vectors import Vector, VectorSettings, action_size, checked_action, observation_shapes
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import apply, check_table, read_table
from deltaswarm_scenario.scenario import MAX_SEED, Scenario
from deltaswarm_wire.checked import Problem, SettingsError, plain

Observation = Any
"""A flat array, or a dict of arrays."""

FLAT, DICT = "flat", "dict"

CONTROLLER = f"{ActedUpon.__module__}:{ActedUpon.__qualname__}"


class SwarmEnv(ParallelEnv[str, Observation, Vector]):  # type: ignore[misc]
    """A swarm whose agents a learner moves. `deltaswarm.parallel_env` makes one; docs/LEARNING.md describes it.

    Args:
        scenario: a built-in scenario's name, a TOML file, or a scenario; its controller is replaced by the learner.
        keys: scenario keys by dotted names, such as `{"radio.loss": 0.2}` (docs/SCENARIO.md).
        reward: a name of `REWARDS`, weights by name, or a function of a step's outcome.
        observation: "flat" for one array, "dict" for its parts by name.
        leaving: whether an agent that a fault kills terminates and leaves; else all stay, with `alive` 0.
        max_cycles: number of steps after which an episode is truncated; default: the scenario's.
        event_slots, frame_slots, message_size: sizes of the vectors (`VectorSettings`).
        render_mode: "ansi" for a line of text, or None.

    Raises:
        SettingsError: arguments are wrong; the text says what must hold.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "deltaswarm_v0", "render_modes": ["ansi"], "is_parallelizable": True}

    def __init__(
        self,
        scenario: str | Path | Scenario = "smoke",
        keys: Mapping[str, Any] | None = None,
        *,
        reward: Reward = "told",
        observation: str = FLAT,
        leaving: bool = False,
        max_cycles: int | None = None,
        event_slots: int = 4,
        frame_slots: int = 8,
        message_size: int = 4,
        render_mode: str | None = None,
    ) -> None:
        sizes = {"event_slots": event_slots, "frame_slots": frame_slots, "message_size": message_size}
        self.scenario = scenario_of(scenario, keys or {}, sizes)
        self.possible_agents = [f"agent_{agent}" for agent in range(self.scenario.agents.count)]
        self._numbers = {name: agent for agent, name in enumerate(self.possible_agents)}
        self.agents: list[str] = []
        self.max_cycles = checked_cycles(max_cycles, self.scenario.run.steps)
        self.render_mode = _one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        self._is_flat = _one_of("observation", observation, (FLAT, DICT)) == FLAT
        self._leaving = leaving
        reward_function(reward, self.possible_agents)
        self._reward = reward
        coded = VectorSettings(**sizes)
        self._shapes = observation_shapes(coded)
        self._size = sum(map(math.prod, self._shapes.values()))
        self._action_size = action_size(coded)
        self.observation_spaces: dict[str, Space[Any]] = {name: self._space() for name in self.possible_agents}
        self.action_spaces: dict[str, Space[Any]] = {name: _box((self._action_size,)) for name in self.possible_agents}
        self.state_space = _box((state_size(self.scenario.agents.count),))
        self._seeds: np.random.Generator | None = None
        self._episode: _Episode | None = None

    def observation_space(self, agent: str) -> Space[Any]:
        """Return an agent's observation space, the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """Return an agent's action space, the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode; return observations and infos.

        Args:
            seed: the run's seed. Without one, the first episode has the scenario's, and each later one the next of a
                sequence that the last given seed determines.
            options: not used.
        """
        self._episode = None
        self.agents = list(self.possible_agents)
        cycles = min(self.max_cycles or MAX_SEED, self.scenario.run.steps)
        self._episode = _Episode(self._seeded(seed, cycles), self._reward, self.possible_agents)
        return self._observations(), self._infos()

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Run one step; `actions` has an array for each agent in `agents`.

        Raises:
            TypeError, ValueError: an action is missing, too many, or invalid.
            RuntimeError: there is no episode, or it is over.
        """
        episode = self._episode
        if episode is None or episode.is_over or not self.agents:
            raise RuntimeError("step must follow reset, and end with the episode: call reset for another episode")
        if not isinstance(actions, Mapping) or set(actions) != set(self.agents):
            raise ValueError(_wrong_agents(actions, self.agents))
        by_name = episode.step(
            {
                self._numbers[name]: checked_action(actions[name], self._action_size, f"the action of {name}")
                for name in self.agents
            }
        )
        rewards = {name: by_name[name] for name in self.agents}
        truncations: dict[str, bool] = dict.fromkeys(self.agents, episode.is_over)
        present = episode.present
        terminations = {
            name: self._leaving and self._numbers[name] not in present and not episode.is_over for name in self.agents
        }
        observations, infos = self._observations(), self._infos()
        self.agents = [name for name in self.agents if not (terminations[name] or truncations[name])]
        return observations, rewards, terminations, truncations, infos

    def state(self) -> Vector:
        """Return the truth of this step as an array (`state.py`), which no agent may get."""
        episode = self._current()
        return state_of(episode.swarm, set(episode.percepts))

    def summary(self) -> dict[str, Any]:
        """Return the metrics of a complete episode: what `summary.json` of a run has. Raises RuntimeError before.

        If all agents have left, the world goes on alone until its last step.
        """
        episode = self._current()
        while not self.agents and not episode.is_over:
            episode.step({})
        return episode.summary()

    def render(self) -> str | None:
        """Return a line about this step with `render_mode="ansi"`; else None."""
        return self._current().line() if self.render_mode == "ansi" else None

    def close(self) -> None:
        """Drop the episode. It may be called again, and so may `reset`."""
        self.agents, self._episode = [], None

    def _current(self) -> "_Episode":
        if self._episode is None:
            raise RuntimeError("there must be an episode: call reset first")
        return self._episode

    def _seeded(self, seed: int | None, cycles: int) -> Scenario:
        """Return the scenario of an episode with this seed or the next."""
        if seed is not None:
            if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed <= MAX_SEED:
                raise ValueError(f"seed must be a whole number from 0 to {MAX_SEED} (got {seed!r:.80})")
            seed = int(seed)
        elif self._seeds is None:
            seed = self.scenario.seed
        if seed is None:
            assert self._seeds is not None
            seed = int(self._seeds.integers(MAX_SEED))
        else:
            self._seeds = np.random.default_rng(seed)
        run = dataclasses.replace(self.scenario.run, duration_s=cycles * self.scenario.run.step_s)
        return dataclasses.replace(self.scenario, seed=seed, run=run)

    def _space(self) -> Space[Any]:
        if self._is_flat:
            return _box((self._size,))
        return Dict({name: _box(shape) for name, shape in self._shapes.items()})

    def _observations(self) -> dict[str, Observation]:
        episode, observations = self._current(), {}
        present = episode.present
        for name in self.agents:
            agent = self._numbers[name]
            vector = episode.observation(agent)
            if vector is None:
                vector = np.zeros(self._size, dtype=np.float32)
                vector[0] = agent in present
            observations[name] = vector if self._is_flat else self._parts(vector)
        return observations

    def _parts(self, vector: Vector) -> dict[str, Vector]:
        parts, begin = {}, 0
        for name, shape in self._shapes.items():
            end = begin + math.prod(shape)
            parts[name], begin = vector[begin:end].reshape(shape), end
        return parts

    def _infos(self) -> dict[str, dict[str, Any]]:
        frames, reports = self._current().losses()
        infos: dict[str, dict[str, Any]] = {name: {"lost": {}, "lost_reports": []} for name in self.agents}
        names = self.possible_agents
        for sender, receiver, reason in frames:
            if (info := infos.get(names[sender])) is not None:
                info["lost"].setdefault(reason, []).append(names[receiver])
        for sender, reason in reports:
            if (info := infos.get(names[sender])) is not None:
                info["lost_reports"].append(reason)
        return infos


class _Episode:
    """One run of the engine, of which the agents' decisions come from outside."""

    def __init__(self, scenario: Scenario, reward: Reward, names: list[str]) -> None:
        self.swarm = InProcess(scenario)
        self.percepts: dict[int, Percept] = {}
        """What each agent that is asked in this step senses and hears."""
        self.is_over = False
        self._began = time.monotonic()
        self._step = 0
        self._reward = reward_function(reward, names)
        self._tally = Tally(scenario)
        self._begin()

    @property
    def present(self) -> set[int]:
        """The agents that have a process."""
        return self.swarm.world.participants.present

    def observation(self, agent: int) -> Vector | None:
        """Return what an agent senses and hears; None if it is not asked."""
        percept = self.percepts.get(agent)
        return None if percept is None else self._controller(agent).coding.observation(percept)

    def step(self, actions: Mapping[int, Vector]) -> dict[str, float]:
        """Let the agents decide, and end the step; return the reward of each."""
        swarm, step = self.swarm, self._step
        answers = []
        for agent, frame in self._frames:
            if agent in actions:
                self._controller(agent).action = actions[agent]
            answers.append((agent, frame, swarm.agents[agent].decide(self.percepts[agent])))
        record = swarm.end(step, answers)
        self.is_over = swarm.world.is_last
        workload = swarm.close_step(record)
        numbers = self._tally.count(swarm, record, workload)
        outcome = StepOutcome(record, workload, swarm.operator.reports_of_closed_step, numbers)
        if self.is_over:
            swarm.finish(time.monotonic() - self._began)
        self._step += 1
        self._begin()
        return self._reward(outcome)  # last, since a function of a user's may raise

    def losses(self) -> tuple[list[tuple[int, int, str]], list[tuple[int, str]]]:
        """Return why frames and reports of the last actions were lost, as `WorldCore.losses`."""
        return self.swarm.world.losses()

    def summary(self) -> dict[str, Any]:
        """Return the run's summary."""
        if not self.is_over:
            raise RuntimeError("the episode must have ended: its metrics are known after its last step")
        return summarise(self.swarm.outcome, self.swarm.scenario)

    def line(self) -> str:
        """Return a line about this step."""
        world = self.swarm.world
        return (
            f"step {self._step}: {len(self.present)} agents, {len(world.environment.active)} events open, "
            f"{world.environment.completed} completed, {len(self.swarm.operator.told_s)} told"
        )

    def _begin(self) -> None:
        """Begin the next step; after the last, only to have the observations that the last actions lead to."""
        last = self._step >= self.swarm.scenario.run.steps - 1
        self._frames = self.swarm.begin(self._step, last)
        self.percepts = {agent: self.swarm.agents[agent].perceive(frame) for agent, frame in self._frames}

    def _controller(self, agent: int) -> ActedUpon:
        controller = self.swarm.agents[agent].controller
        assert isinstance(controller, ActedUpon)
        return controller


def scenario_of(given: str | Path | Scenario, keys: Mapping[str, Any], sizes: Mapping[str, int]) -> Scenario:
    """Return the checked scenario of an environment. Raises SettingsError with every mistake."""
    table = plain(given) if isinstance(given, Scenario) else read_table(str(given))
    settings = overrides(keys)
    problems = [problem for setting in settings for problem in apply(table, setting)]
    must = "must not be given: the learner is the controller"
    given_keys = (setting.partition("=") for setting in settings)
    problems += [Problem(path, value, must) for path, _, value in given_keys if path.startswith("control")]
    table["control"] = {"mode": CONTROLLER, **sizes}
    scenario, more = check_table(table)
    if scenario is not None and scenario.run.bound != "none":
        more.append(Problem("run.bound", repr(scenario.run.bound), "must be none: the learner replaces the controller"))
    if scenario is None or problems + more:
        raise SettingsError(problems + more)
    return scenario


def checked_cycles(max_cycles: Any, steps: int) -> int | None:
    if max_cycles is None:
        return None
    if isinstance(max_cycles, int | np.integer) and not isinstance(max_cycles, bool) and 1 <= max_cycles <= steps:
        return int(max_cycles)
    must = f"must be a whole number from 1 to {steps}, the scenario's steps; run.duration_s allows more"
    raise SettingsError([Problem("max_cycles", repr(max_cycles), must)])


def _one_of(name: str, value: Any, allowed: tuple[Any, ...]) -> Any:
    if value not in allowed:
        raise SettingsError([Problem(name, repr(value), f"must be one of {', '.join(map(repr, allowed))}")])
    return value


def _box(shape: tuple[int, ...]) -> Box:
    return Box(-1.0, 1.0, shape, np.float32)


def _wrong_agents(actions: Any, agents: list[str]) -> str:
    if not isinstance(actions, Mapping):
        return f"actions must be a dict with an action of each agent (got {type(actions).__name__})"
    missing = ", ".join(map(repr, [agent for agent in agents if agent not in actions]))
    others = ", ".join(repr(name) for name in actions if name not in agents)
    found = "; ".join(filter(None, (missing and f"missing: {missing}", others and f"not there: {others}")))
    return f"actions must have an action of each agent in env.agents, and no others ({found:.200})"
