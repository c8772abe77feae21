"""Learning environments for tests: a policy without learning, episodes as digests, and everything on at once.

`python -m tests.support.learning` prints the digest of an episode.
"""

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from deltaswarm_learn.controller import PolicyController
from deltaswarm_learn.environment import SwarmEnv
from deltaswarm_learn.vectors import Vector
from tests.support.airs import EVERYTHING

SIZE = 9
"""Numbers in an action."""

KILLED = 2

FAULTS: list[dict[str, Any]] = [
    {"kind": "kill", "at_s": 6.0, "agents": [KILLED]},
    {"kind": "freeze", "at_s": 4.0, "duration_s": 6.0, "agents": [1]},
    {"kind": "restart", "at_s": 8.0, "duration_s": 6.0, "agents": [3]},
    {"kind": "sensor-noisy", "at_s": 2.0, "noise_m": 40.0, "agents": [0]},
    {"kind": "radio-dead", "at_s": 10.0, "duration_s": 4.0, "agents": [4]},
]

BUSY = {"events.rate_hz": 1.0, "fault": FAULTS, "uplink.loss": 0.2, "radio.duplication": 0.1, "radio.jitter_s": 2.0}


def wandering(observation: Vector) -> Vector:
    """An action that depends on everything observed, and does everything now and then."""
    total = np.cumsum(observation, dtype=np.float64)
    return np.sin(7.0 * total[-1] + np.arange(SIZE) * (1.3 + total[len(total) // 2])).astype(np.float32)


def flat(observation: Any) -> Vector:
    """An observation of either kind as one array."""
    if isinstance(observation, dict):
        return np.concatenate([part.ravel() for part in observation.values()])
    return np.asarray(observation)


class Wanderer(PolicyController):
    """The same on an agent."""

    def act(self, observation: Vector) -> Vector:
        """As `wandering`."""
        return wandering(observation)


class Lost(Wanderer):
    """One that does not know where to."""

    def act(self, observation: Vector) -> Vector:
        """NaN in each number."""
        return np.full(SIZE, np.nan, dtype=np.float32)


def episode(env: SwarmEnv, seed: int | None = 1) -> Iterator[tuple[Any, ...]]:
    """Yield what `reset` and each `step` return, of one episode of wandering agents."""
    observations, infos = env.reset(seed=seed)
    yield observations, {}, {}, {}, infos
    while env.agents:
        step = env.step({agent: wandering(flat(observations[agent])) for agent in env.agents})
        yield step
        observations = step[0]


def digest_of_episode(env: SwarmEnv, seed: int | None = 1) -> str:
    """A digest of all that an episode returns, of the states, and of the run."""
    digest = hashlib.sha256()
    for observations, *others in episode(env, seed):
        for agent, observation in observations.items():
            digest.update(agent.encode() + observation.tobytes())
        digest.update(repr(others).encode() + env.state().tobytes())
    return digest.hexdigest() + env.summary()["digest"]


def busy_env(**named: Any) -> SwarmEnv:
    """Many events, all kinds of faults and a lossy air, with steps of 2 s."""
    settings = {"run.duration_s": 60.0, "run.step_s": 2.0, **BUSY}
    return SwarmEnv("smoke", settings, reward={"untold": 1.0, "messages": 0.1}, **named)


def table_of(overrides: tuple[str, ...] = EVERYTHING) -> dict[str, Any]:
    """Overrides as `--set` has them, as settings by dotted key."""
    import tomllib

    return {
        key: tomllib.loads(f"value = {text}")["value"] for key, _, text in (one.partition("=") for one in overrides)
    }


if __name__ == "__main__":
    print(digest_of_episode(busy_env()))
