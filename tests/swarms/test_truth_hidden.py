"""Nobody computes the truth: what an agent is told in a run leads to nothing else of it."""

import math
from dataclasses import replace
from itertools import product
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controller import agent_rng
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire import seeds
from deltaswarm_wire.seeds import agent_seed
from deltaswarm_world.core.arrivals import PLACES_STREAM, TIMES_STREAM, EventIds
from deltaswarm_world.core.environment import START_STREAM, Environment

RUN_SEED = 1
"""The most likely one, and the first that a searcher would try."""

ME = 3


def world(seed: int = RUN_SEED) -> Environment:
    return Environment(load_scenario("paper-25", ["events.rate_hz=0.5"], seed))


def told_seeds() -> list[int]:
    """What an agent might take for the run's seed: small numbers, and whatever follows from its own."""
    own = agent_seed(RUN_SEED, ME)
    mixed = [own, own ^ ME, own - ME, own >> 32, own & 0xFFFF_FFFF, own * 2, own * 2 + 1]
    drawn = [draw for rng in (Random(own), agent_rng(own, ME)) for draw in (rng.getrandbits(32), rng.getrandbits(63))]
    return [*range(2000), *mixed, *drawn]


def test_no_start_place_follows_from_what_an_agent_knows() -> None:
    """A searcher with the source, its own place and its own seed builds every generator that it can think of."""
    scenario = load_scenario("paper-25", [], RUN_SEED)
    places = world().positions_m
    size = np.array([scenario.arena.width_m, scenario.arena.height_m])
    for seed in told_seeds():
        for words in ([seed, START_STREAM], [seed], [START_STREAM, seed]):
            guess = np.random.default_rng(words).random((len(places), 2)) * size
            assert math.dist(guess[ME], places[ME]) > 1e-6, words


def test_no_arrival_follows_either() -> None:
    """Neither time nor place of the first event is in a generator that can be built from what an agent is told."""
    environment = world()
    environment.arrive(100.0)
    first = environment.arrived[0]
    for seed, words in product(told_seeds()[-20:], ([TIMES_STREAM], [PLACES_STREAM], [PLACES_STREAM, 0], [])):
        places, times = (np.random.default_rng([seed, *words]) for _ in range(2))
        assert not np.isclose(first.x_m, 50 + 50**0.5 * places.standard_normal(40)).any()
        assert not np.isclose(first.arrived_s * 0.5, times.standard_exponential(40)).any()


def test_what_an_agent_is_told_does_not_fix_the_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs in which each agent is told the very same have other places, other arrivals and other ids."""
    monkeypatch.setattr(seeds, "agent_seed", lambda seed, agent: agent)
    runs = [InProcess(load_scenario("smoke", ["events.rate_hz=0.5"], seed)) for seed in (1, 2)]
    assert runs[0].scenario.for_agent(ME) == runs[1].scenario.for_agent(ME)
    for step in range(50):
        for run in runs:
            run.step(step, last=False)
    one, other = (run.world.environment for run in runs)
    assert not np.isclose(one.positions_m, other.positions_m).any()
    assert not {event.event for event in one.arrived} & {event.event for event in other.arrived}


def test_no_agents_seed_follows_from_anothers() -> None:
    """Nor from a restart's: each is a keyed hash of its number."""
    told = [agent_seed(RUN_SEED, agent) for agent in range(200)]
    assert len(set(told)) == len(set(np.diff(told).tolist())) + 1 == 200
    ones = [sum(seed >> bit & 1 for seed in told) for bit in range(63)]
    assert all(60 < count < 140 for count in ones)
    settings = load_scenario("paper-25", [], RUN_SEED).for_agent(ME)
    assert replace(settings, seed=0) == replace(load_scenario("paper-25", [], 2).for_agent(4), seed=0)


@given(st.integers(0, 2**63 - 1), st.lists(st.integers(0, 2**32 - 1), min_size=2, max_size=20, unique=True))
def test_ids_of_events_are_a_permutation(seed: int, numbers: list[int]) -> None:
    of = EventIds(seed % 3)
    ids = [of.of(number) for number in numbers]
    assert len(set(ids)) == len(ids)
    assert all(0 <= one < 2**32 for one in ids)


def test_ids_do_not_count() -> None:
    """The first thousand spread over all that there are, in no order, and other runs have others."""
    ids = [EventIds(RUN_SEED).of(number) for number in range(1000)]
    assert abs(np.corrcoef(range(1000), ids)[0, 1]) < 0.1
    assert np.mean(ids) == pytest.approx(2**31, rel=0.1)
    assert not {EventIds(2).of(number) for number in range(1000)} & set(ids)
