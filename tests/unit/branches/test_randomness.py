"""Replicates of a saved state: every generator is reseeded before each step, each in its own way."""

import pickle
import random

import numpy as np

from deltaswarm_orchestrator.run.randomness import Randomness, replicate_seed

STATE = {"air": np.random.default_rng(3), "agents": [random.Random(4), random.Random(4)], "count": 7}


def draws(state: dict[str, object]) -> tuple[float, float, float]:
    """What each of the three generators draws next."""
    first, second = state["agents"]  # type: ignore[misc]
    return float(state["air"].random()), first.random(), second.random()  # type: ignore[attr-defined]


def test_a_loaded_state_draws_on_until_its_first_step() -> None:
    randomness = Randomness(11)
    state = randomness.load(pickle.dumps(STATE))
    assert draws(state) == draws(pickle.loads(pickle.dumps(STATE)))
    assert state["count"] == 7


def test_in_a_step_each_generator_draws_by_seed_place_and_step_alone() -> None:
    """Whatever was drawn before; two that were equal in the state are no longer."""
    seen = {}
    for seed, step, drawn_before in ((11, 5, 0), (11, 5, 9), (11, 6, 0), (12, 5, 0)):
        randomness = Randomness(seed)
        state = randomness.load(pickle.dumps(STATE))
        for _ in range(drawn_before):
            draws(state)
        randomness.begin_step(step)
        seen[seed, step, drawn_before] = draws(state)
    assert seen[11, 5, 0] == seen[11, 5, 9]
    different = [number for key in ((11, 5, 0), (11, 6, 0), (12, 5, 0)) for number in seen[key]]
    assert len(set(different)) == 9


def test_replicates_have_seeds_of_their_own() -> None:
    """By the run's seed, the branching step and the number."""
    seeds = [replicate_seed(seed, step, number) for seed in (1, 2) for step in (5, 6) for number in (1, 2)]
    assert len(set(seeds)) == 8
    assert all(0 <= seed < 2**63 for seed in seeds)
