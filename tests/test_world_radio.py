"""The air: a disc, seeded loss, and a reason for every frame that is not heard."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltaswarm_wire.settings import RadioSettings
from deltaswarm_world.density import Floats
from deltaswarm_world.radio import SILENCE, RangeDisc, Reception

RANGE_M = 10.0


def air(loss: float = 0.0, seed: int = 1) -> RangeDisc:
    return RangeDisc(RadioSettings(RANGE_M, loss), np.random.default_rng(seed))


@st.composite
def situations(draw: st.DrawFn) -> tuple[Floats, list[int], list[bool]]:
    """Positions, who speaks, and who is there to hear."""
    count = draw(st.integers(1, 12))
    coordinate = st.floats(0, 30)
    positions = draw(st.lists(st.tuples(coordinate, coordinate), min_size=count, max_size=count))
    present = draw(st.lists(st.booleans(), min_size=count, max_size=count))
    senders = sorted(draw(st.sets(st.integers(0, count - 1))))
    return np.array(positions), senders, present


def dropped(reception: Reception) -> int:
    return reception.dropped_range + reception.dropped_loss + reception.dropped_dead


@given(situations(), st.sampled_from([0.0, 0.3, 1.0]))
@settings(max_examples=200)
def test_every_frame_is_heard_or_dropped_for_a_reason(
    situation: tuple[Floats, list[int], list[bool]], loss: float
) -> None:
    """Links and drops add up to each frame's pairs with all others, whoever is there."""
    positions, senders, present = situation
    reception = air(loss).receive(positions, senders, present)
    assert len(reception.links) + dropped(reception) == len(senders) * (len(present) - 1)
    assert min(reception.dropped_range, reception.dropped_loss, reception.dropped_dead) >= 0
    assert reception.dropped_loss == 0 or loss > 0


@given(situations())
def test_a_frame_is_heard_by_all_who_are_in_range_and_there(
    situation: tuple[Floats, list[int], list[bool]],
) -> None:
    """And by nobody else, not by its sender; in order of receiver, then sender."""
    positions, senders, present = situation
    reception = air().receive(positions, senders, present)
    near = {
        (sender, receiver)
        for sender in senders
        for receiver in range(len(present))
        if receiver != sender and ((positions[sender] - positions[receiver]) ** 2).sum() <= RANGE_M**2
    }
    assert set(reception.links) == {(sender, receiver) for sender, receiver in near if present[receiver]}
    assert reception.links == sorted(reception.links, key=lambda link: (link[1], link[0]))
    absent = [agent for agent, there in enumerate(present) if not there]
    assert reception.dropped_dead == sum(agent != sender for sender in senders for agent in absent)


@given(situations())
def test_hearing_is_mutual(situation: tuple[Floats, list[int], list[bool]]) -> None:
    """Where all speak and all are there, whoever hears is heard."""
    positions, _, present = situation
    everybody = list(range(len(present)))
    links = set(air().receive(positions, everybody, [True] * len(present)).links)
    assert links == {(receiver, sender) for sender, receiver in links}


@pytest.mark.parametrize(("distance_m", "heard"), [(9.999, True), (10.0, True), (10.001, False)])
def test_the_range_is_a_sharp_edge(distance_m: float, heard: bool) -> None:
    """The range itself is within it."""
    reception = air().receive(np.array([[0.0, 0.0], [distance_m, 0.0]]), [0], [True, True])
    assert reception.links == ([(0, 1)] if heard else [])
    assert reception.dropped_range == (not heard)


def test_silence_is_nothing() -> None:
    """No senders, no links, no drops, and no draw of chance."""
    disc = air(0.5)
    assert disc.receive(np.zeros((3, 2)), [], [True] * 3) == SILENCE
    assert disc.receive(np.zeros((3, 2)), [0], [True] * 3) == air(0.5).receive(np.zeros((3, 2)), [0], [True] * 3)


CROWD = np.zeros((20, 2))
ALL = list(range(20))
THERE = [True] * 20


def heard_in(steps: int, loss: float, seed: int) -> list[Reception]:
    disc = air(loss, seed)
    return [disc.receive(CROWD, ALL, THERE) for _ in range(steps)]


def test_loss_is_reproducible() -> None:
    """The same generator gives the same losses, another other ones."""
    assert heard_in(5, 0.3, seed=1) == heard_in(5, 0.3, seed=1) != heard_in(5, 0.3, seed=2)


@pytest.mark.parametrize("loss", [0.05, 0.3, 0.9])
def test_loss_has_its_share(loss: float) -> None:
    """Of 38,000 pairs in range, within four standard errors."""
    receptions = heard_in(100, loss, seed=3)
    lost = sum(reception.dropped_loss for reception in receptions)
    pairs = 100 * 20 * 19
    assert lost + sum(len(reception.links) for reception in receptions) == pairs
    assert lost / pairs == pytest.approx(loss, abs=4 * (loss * (1 - loss) / pairs) ** 0.5)


def test_loss_is_independent_per_receiver() -> None:
    """One frame is lost for some and heard by others; no pair is luckier than another."""
    receptions = heard_in(400, 0.5, seed=4)
    heard = np.zeros((20, 20))
    for reception in receptions:
        per_frame = np.bincount([sender for sender, _ in reception.links], minlength=20)
        assert per_frame.max() < 19
        for sender, receiver in reception.links:
            heard[sender, receiver] += 1
    shares = heard[~np.eye(20, dtype=bool)] / 400
    assert 0.37 < shares.min() < shares.max() < 0.63


def test_no_loss_and_total_loss_are_exact() -> None:
    """At 0 nothing is lost, at 1 everything in range is."""
    (clear,), (noise,) = heard_in(1, 0.0, seed=5), heard_in(1, 1.0, seed=5)
    assert (len(clear.links), clear.dropped_loss) == (380, 0)
    assert (len(noise.links), noise.dropped_loss) == (0, 380)
