"""The air as a whole: its models in order, a reason for every frame that is not heard, and exact books."""

import math
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import DROP_REASONS
from deltaswarm_wire.plugins import RADIO_MODELS
from deltaswarm_world.core.air.channel.model import models_of
from deltaswarm_world.core.air.channel.reach import RangeDisc
from deltaswarm_world.core.air.radio import Reception
from deltaswarm_world.core.arrays import Floats
from tests.support.airs import EVERYTHING, Stage, radios
from tests.support.tiers import in_one_test

RANGE_M = 10.0


@st.composite
def situations(draw: st.DrawFn) -> tuple[Floats, list[int], list[bool]]:
    """Positions, who speaks, and who is there to hear."""
    count = draw(st.integers(1, 12))
    coordinate = st.floats(0, 30)
    positions = draw(st.lists(st.tuples(coordinate, coordinate), min_size=count, max_size=count))
    present = draw(st.lists(st.booleans(), min_size=count, max_size=count))
    senders = sorted(draw(st.sets(st.integers(0, count - 1))))
    return np.array(positions), senders, present


@given(situations(), st.sampled_from([0.0, 0.3, 1.0]))
def test_every_frame_is_heard_or_dropped_for_a_reason(
    situation: tuple[Floats, list[int], list[bool]], loss: float
) -> None:
    """Links and drops add up to each frame's pairs with all others, whoever is there."""
    positions, senders, present = situation
    carried = Stage(positions, loss=loss).carry(senders, present)
    assert len(carried.links) + sum(carried.dropped.values()) == len(senders) * (len(present) - 1)
    assert set(carried.dropped) <= {"range", "dead"} | ({"loss"} if loss else set())
    assert all(count > 0 for count in carried.dropped.values())


@given(situations())
def test_a_frame_is_heard_by_all_who_are_in_range_and_there(situation: tuple[Floats, list[int], list[bool]]) -> None:
    """And by nobody else, not by its sender; in order of receiver, then sender."""
    positions, senders, present = situation
    carried = Stage(positions).carry(senders, present)
    near = {
        (sender, receiver)
        for sender in senders
        for receiver in range(len(present))
        if receiver != sender and ((positions[sender] - positions[receiver]) ** 2).sum() <= RANGE_M**2
    }
    assert set(carried.links) == {(sender, receiver) for sender, receiver in near if present[receiver]}
    assert carried.links == sorted(carried.links, key=lambda link: (link[1], link[0]))
    absent = [agent for agent, there in enumerate(present) if not there]
    assert carried.dropped.get("dead", 0) == sum(agent != sender for sender in senders for agent in absent)


@pytest.mark.parametrize(("distance_m", "heard"), [(9.999, True), (10.0, True), (10.001, False)])
def test_the_range_is_a_sharp_edge(distance_m: float, heard: bool) -> None:
    carried = Stage([[0.0, 0.0], [distance_m, 0.0]]).carry([0])
    assert carried.links == ([(0, 1)] if heard else [])
    assert carried.dropped.get("range", 0) == (not heard)


def test_silence_is_nothing() -> None:
    quiet, other = (Stage(np.zeros((9, 2)), loss=0.5) for _ in range(2))
    silence = quiet.carry([])
    assert (silence.links, silence.dropped, silence.heard) == ([], {}, [[] for _ in range(9)])
    assert quiet.carry().links == other.carry().links


CROWD = np.zeros((20, 2))


def heard_in(steps: int, loss: float, seed: int) -> list[Reception]:
    stage = Stage(CROWD, seed, loss=loss)
    return [stage.carry() for _ in range(steps)]


def test_loss_is_reproducible() -> None:
    one, same, other = ([carried.links for carried in heard_in(5, 0.3, seed)] for seed in (1, 1, 2))
    assert one == same != other


@in_one_test("loss", [0.05, 0.3, 0.9, 1.0])
def test_loss_has_its_share(loss: float) -> None:
    """Of 38,000 pairs in range, within four standard errors; a loss of 1 spares none."""
    receptions = heard_in(100, loss, seed=3)
    lost = sum(carried.dropped["loss"] for carried in receptions)
    pairs = 100 * 20 * 19
    assert lost + sum(len(carried.links) for carried in receptions) == pairs
    assert lost / pairs == pytest.approx(loss, abs=4 * (loss * (1 - loss) / pairs) ** 0.5)


def test_loss_is_independent_per_receiver() -> None:
    """One frame is lost for some and heard by others; no pair is luckier than another."""
    heard = np.zeros((20, 20))
    for carried in heard_in(400, 0.5, seed=4):
        per_frame = np.bincount([sender for sender, _ in carried.links], minlength=20)
        assert per_frame.max() < 19
        for sender, receiver in carried.links:
            heard[sender, receiver] += 1
    shares = heard[~np.eye(20, dtype=bool)] / 400
    assert 0.37 < shares.min() < shares.max() < 0.63


@given(radios, st.integers(1, 7), st.integers(0, 2**32), st.integers(0, 5))
def test_no_frame_is_lost_from_the_books(table: dict[str, Any], agents: int, seed: int, silent: int) -> None:
    """Whatever is on, whoever speaks, dies and returns: in every step what was to come came, fell, or is to come."""
    rng = np.random.default_rng(seed)
    stage = Stage(rng.random((agents, 2)) * 60, **{"range_m": 30.0, **table})
    before = 0
    for step in range(25 + silent):
        stage.positions_m = np.clip(stage.positions_m + rng.normal(size=(agents, 2)), 0, 100)
        speaking = [] if step >= 25 else [agent for agent in range(agents) if rng.random() < 0.7]
        data = {agent: bytes(rng.integers(7, 30)) for agent in speaking}
        there = [bool(rng.random() < 0.8) for _ in range(agents)]
        carried = stage.carry(listening=there, data=data)
        came = len(data) * (agents - 1) + carried.duplicated
        fell = sum(carried.dropped.values())
        assert before + came == len(carried.links) + fell + stage.air.under_way
        assert set(carried.dropped) <= set(DROP_REASONS) - {"frame_full"}
        assert min(carried.dropped.values(), default=1) > 0
        lost = carried.losses(there)
        assert Counter(reason for *_, reason in lost) == carried.dropped
        assert all(sender != receiver for sender, receiver, _ in lost)
        assert [len(frames) for frames in carried.heard] == [
            sum(link[1] == agent for link in carried.links) for agent in range(agents)
        ]
        assert all(there[receiver] for _, receiver in carried.links)
        assert carried.largest_bytes >= max((len(one) for frames in carried.heard for _, one in frames), default=0)
        before = stage.air.under_way


@given(radios)
def test_same_seed_same_air(table: dict[str, Any]) -> None:
    rows = []
    for _ in range(2):
        stage = Stage(np.arange(10).reshape(5, 2) * 5.0, 7, **table)
        rows.append([(carried.links, carried.heard, carried.dropped) for carried in (stage.carry() for _ in range(20))])
    assert rows[0] == rows[1]


ONE_BY_ONE: dict[str, dict[str, Any]] = {
    "blackout": {"blackouts": [{}]},
    "partition": {"walls": [{"a_m": [1, 0], "b_m": [1, 50]}]},
    "obstacle": {"arena": {"obstacles": [{"corners_m": [[0.5, 19], [1.5, 19], [1.5, 21], [0.5, 21]]}]}},
    "jam": {"jammers": [{"center_m": [2, 20], "radius_m": 1}]},
    "asymmetry": {"asymmetry": {"dead_share": 1.0}},
    "loss": {"loss": 1.0},
    "burst": {"burst": {"loss_good": 1.0}},
    "contention": {"contention_bytes_per_s": 1.0},
}
"""What cuts the link from (0, 20) to (2, 20), in the order in which a frame meets it."""


@in_one_test("reason", ONE_BY_ONE)
def test_each_model_has_its_own_reason(reason: str) -> None:
    stage = Stage([[0, 20], [2, 20]], **ONE_BY_ONE[reason])
    assert stage.carry([0]).dropped == {reason: 1}


@in_one_test("first", range(len(ONE_BY_ONE)))
def test_the_first_reason_is_the_one_that_counts(first: int) -> None:
    """Of all that would cut a link, in the documented order; range and a dead receiver come before all."""
    reasons = list(ONE_BY_ONE)[first:]
    table: dict[str, Any] = {}
    for reason in reasons:
        table |= ONE_BY_ONE[reason]
    assert Stage([[0, 20], [2, 20]], **table).carry([0]).dropped == {reasons[0]: 1}
    assert Stage([[0, 20], [12, 20]], **table).carry([0]).dropped == {"range": 1}
    assert Stage([[0, 20], [12, 20]], **table).carry([0], [True, False]).dropped == {"dead": 1}


@in_one_test("other", [name for name in ONE_BY_ONE if name != "loss"])
def test_switching_a_model_on_changes_nothing_of_another_s_draws(other: str) -> None:
    """The same frames fall to loss, as far as no other reason comes first."""
    tables: list[dict[str, Any]] = [{}, {"blackouts": [{"from_s": 3, "until_s": 5}]}]
    tables[1] |= {} if other == "blackout" else SOME[other]
    alone, both = (Stage(CROWD, 3, loss=0.4, **table) for table in tables)
    for step in range(10):
        clear, busy = alone.carry(), both.carry()
        assert set(busy.links) <= set(clear.links)
        if step in (3, 4):
            assert busy.dropped == {"blackout": 380}


SOME: dict[str, dict[str, Any]] = {
    **ONE_BY_ONE,
    "asymmetry": {"asymmetry": {"dead_share": 0.3, "range_factor_low": 0.5}},
    "burst": {"burst": {"p_good_to_bad": 0.2, "p_bad_to_good": 0.5}},
    "contention": {"contention_bytes_per_s": 40.0},
}


@given(st.floats(0, 5), st.floats(0, 5), st.integers(0, 99), st.sampled_from([0.5, 1.0]))
def test_no_frame_is_early(latency_s: float, jitter_s: float, seed: int, step_s: float) -> None:
    """Each arrives at least the latency, and at most latency and jitter, after its time, rounded to whole steps."""
    stage = Stage([[0, 0], [1, 0]], seed, latency_s=latency_s, jitter_s=jitter_s, step_s=step_s)
    arrived = []
    for step in range(41):
        carried = stage.carry([0] if step < 20 else [])
        arrived += [(int(data.split(b":")[0]), step) for _, data in carried.heard[1]]
    assert sorted(sent for sent, _ in arrived) == list(range(20))
    assert stage.air.under_way == 0
    for sent, step in arrived:
        assert math.floor(latency_s / step_s) <= step - sent <= math.ceil((latency_s + jitter_s) / step_s + 1e-9)


def test_jitter_reorders() -> None:
    stage = Stage([[0, 0], [1, 0]], jitter_s=6.0)
    sent = [data for _ in range(40) for _, data in stage.carry([0]).heard[1]]
    numbers = [int(data.split(b":")[0]) for data in sent]
    assert numbers != sorted(numbers)


def test_every_frame_comes_twice_where_all_are_doubled() -> None:
    carried = Stage([[0, 0], [1, 0]], duplication=1.0).carry([0])
    assert carried.heard[1] == [(0, b"0:0"), (0, b"0:0")]
    assert (carried.duplicated, carried.dropped) == (1, {})


def test_a_frame_under_way_to_one_who_dies_is_dropped_as_dead() -> None:
    stage = Stage([[0, 0], [1, 0]], latency_s=2.0)
    assert (stage.carry([0]).dropped, stage.air.under_way) == ({}, 1)
    assert stage.carry([], [True, False]).dropped == {}
    assert stage.carry([], [True, False]).dropped == {"dead": 1}
    assert stage.carry([]).links == []


@pytest.mark.parametrize("gone", [0, 1])
def test_what_waits_in_a_queue_dies_with_its_agent(gone: int) -> None:
    rate = {"sender_bytes_per_s": 1.0} if gone == 0 else {"receiver_bytes_per_s": 1.0}
    stage = Stage([[0, 0], [1, 0]], bandwidth=rate)
    stage.carry([0])
    assert stage.air.under_way == 1
    assert stage.carry([], [agent != gone for agent in (0, 1)]).dropped == {"dead": 1}
    assert stage.air.under_way == 0


@pytest.mark.parametrize("step_s", [0.5, 1.0])
@pytest.mark.parametrize("end", ["sender", "receiver"])
def test_a_narrow_end_is_late_and_a_full_queue_drops(end: str, step_s: float) -> None:
    """5 bytes a step for a frame of 10 in each: every other one comes, once the queue is full."""
    bandwidth = {f"{end}_bytes_per_s": 5.0 / step_s, "queue_bytes": 30}
    stage = Stage([[0, 0], [1, 0]], bandwidth=bandwidth, step_s=step_s)
    heard = dropped = 0
    for _ in range(100):
        carried = stage.carry(data={0: bytes(10)})
        heard += len(carried.links)
        dropped += sum(carried.dropped.values())
    assert (heard, heard + dropped + stage.air.under_way) == (50, 100)
    assert stage.air.under_way == 3


def test_a_model_is_built_only_where_the_scenario_asks_for_it() -> None:
    """None by default; all of them, in the order of the table, where every model is on."""
    assert models_of(Scenario(), RangeDisc(9.0)) == []
    models = models_of(load_scenario("smoke", [*EVERYTHING]), RangeDisc(9.0))
    assert [model.reason for model in models] == list(RADIO_MODELS.shipped)


def test_no_stream_of_chance_is_used_twice() -> None:
    """Two uses of one number would draw the same values."""
    sources = [path.read_text() for path in (Path(__file__).parents[3] / "world").rglob("*.py")]
    assigned = [
        stream
        for source in sources
        for numbers in re.findall(r"^(?:[A-Z_, ]+_STREAM|    stream) = ([\d, ]+)$", source, re.MULTILINE)
        for stream in numbers.split(", ")
    ]
    assert len(assigned) > 15
    assert len(assigned) == len(set(assigned))


AGENTS = 3


@given(radios, st.integers(0, 2**32))
def test_over_all_links_the_outcomes_are_the_books(table: dict[str, Any], seed: int) -> None:
    """As many delivered, dropped for each reason and under way as the air counts in that step."""
    outcomes, carried, under_way = Counter[str](), None, set()
    for sender, receiver in ((a, b) for a in range(AGENTS) for b in range(AGENTS) if a != b):
        rng = np.random.default_rng(seed)
        plain, stage = (Stage(rng.random((AGENTS, 2)) * 40, **{"range_m": 30.0, **table}) for _ in range(2))
        stage.positions_m = plain.positions_m
        for _ in range(12):
            speaking = [agent for agent in range(AGENTS) if rng.random() < 0.7]
            there = [bool(rng.random() < 0.8) for _ in range(AGENTS)]
            carried, asked = (one.carry(speaking, there) for one in (plain, stage))
            assert (asked.links, asked.dropped, asked.heard) == (carried.links, carried.dropped, carried.heard)
            stage.air.explain(sender, receiver, [True] * AGENTS)
            stage.air.outcomes(sender, receiver)
        under_way.add(plain.air.under_way)
        outcomes.update(outcome.split(",")[0] for outcome in stage.air.outcomes(sender, receiver))
    assert carried is not None
    assert outcomes.pop("delivered", 0) == len(carried.links)
    for reason, count in carried.dropped.items():
        assert outcomes.pop(f"dropped: {reason}") == count
    assert {sum(outcomes.values())} == under_way


def test_a_sender_with_a_dead_radio_is_named() -> None:
    stage = Stage([[0, 0], [1, 0]])
    carried = stage.air.carry(0, 0.0, {0: b"frame"}, stage.positions_m, [True, True], mute={0})
    assert carried.dropped == {"dead": 1}
    [outcome] = stage.air.outcomes(0, 1)
    assert outcome.startswith("dropped: dead")
    assert "sender" in outcome
