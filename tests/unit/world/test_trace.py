"""What the air says of one link is what happened on it, and asking changes nothing."""

from collections import Counter
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.support.airs import Stage, radios

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
    """Its frame is dropped before it meets anything."""
    stage = Stage([[0, 0], [1, 0]])
    carried = stage.air.carry(0, 0.0, {0: b"frame"}, stage.positions_m, [True, True], mute={0})
    assert carried.dropped == {"dead": 1}
    [outcome] = stage.air.outcomes(0, 1)
    assert outcome.startswith("dropped: dead")
    assert "sender" in outcome
