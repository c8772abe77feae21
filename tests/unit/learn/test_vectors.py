"""Percepts as vectors and vectors as decisions, by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controller import OperatorReport, Percept
from deltaswarm_learn.vectors import VectorCoding, VectorSettings
from deltaswarm_wire.messages import Event
from deltaswarm_wire.settings import AgentSettings

SHARED = AgentSettings(width_m=40.0, height_m=20.0, speed_mps=2.0, sensing_range_m=5.0)
NEAR, FAR, FARTHER = Event(9, 21.0, 5.0), Event(3, 20.0, 7.5), Event(1, 15.0, 5.0)


def coding(agent: int = 2, events: int = 2, frames: int = 2, message: int = 2) -> VectorCoding:
    return VectorCoding(VectorSettings(events, frames, message), SHARED, agent)


def percept(*events: Event, heard: tuple[tuple[int, bytes], ...] = (), time_s: float = 900.0) -> Percept:
    return Percept(450, time_s, (20.0, 5.0), (), events, list(heard))


def test_an_observation_by_hand() -> None:
    """Alive, asked, a quarter of an hour, the middle along x; the two nearest of three events; a row left free."""
    seen = coding().observation(percept(FARTHER, FAR, NEAR))
    assert seen.dtype == np.float32
    own, events, heard = [1, 1, 0.25, 0, -0.5], [1, 0.2, 0, 1, 0, 0.5], [0] * 6
    assert seen.tolist() == pytest.approx(own + events + heard)


def test_a_decision_by_hand() -> None:
    """Half speed to the east; it works on the nearest and reports all, nearest first; without a broadcast."""
    decision = coding().decision(percept(FARTHER, FAR, NEAR), np.array([0.5, 0, 1, 0, 1, 1, 1], np.float32))
    assert (decision.velocity, decision.observed, decision.payload) == ((1.0, 0.0), (9,), None)
    assert decision.report == OperatorReport((NEAR, FAR, FARTHER))
    assert decision.role == "attending"
    still = coding().decision(percept(), np.array([0, 0, 1, 1, 0, 0, 0], np.float32))
    assert (still.observed, still.report, still.role) == ((), None, "free")
    assert still.payload == bytes(4)


@given(st.lists(st.floats(-1, 1, width=32), min_size=2, max_size=2))
def test_a_broadcast_arrives_as_it_was_meant(message: list[float]) -> None:
    """To within half of a step of 16 bits."""
    action = np.array([0, 0, 0, 1, 0, *message], np.float32)
    payload = coding().decision(percept(), action).payload
    assert payload is not None
    row = coding(agent=5).observation(percept(heard=((2, payload),)))[-6:-3]
    assert row.tolist() == pytest.approx([1.0, *message], abs=0.6 / 32767)


def test_each_agent_hears_its_successors_first() -> None:
    """So that no agent is heard by all where there are too few slots; what is no broadcast of a policy is not heard."""
    payloads = {sender: int(sender * 1000).to_bytes(2, "little") * 2 for sender in range(5)}
    heard = [(sender, payload) for sender, payload in payloads.items() if sender != 2]
    rows = coding().observation(percept(heard=(*heard, (7, b"odd"))))[-6:].reshape(2, 3)
    assert (rows * 32767).round()[:, 1].tolist() == [3000, 4000]
    beyond = coding(frames=4).observation(percept(heard=(*heard, (7, b"odd"))))[-12:].reshape(4, 3)
    assert (beyond * 32767).round()[:, 1].tolist() == [3000, 4000, 0, 1000]
    assert beyond[:, 0].tolist() == [1, 1, 1, 1]


def test_what_is_out_of_bounds_is_cut() -> None:
    """A phantom far away, a long run, and the lowest number of 16 bits, which no broadcast has."""
    seen = coding().observation(percept(Event(1, 300.0, 5.0), heard=((4, b"\x00\x80" * 2),), time_s=1e9))
    assert [seen[2], *seen[5:8], *seen[11:14]] == [1, 1, 1, 0, 1, -1, -1]
