"""Truth: all of a step for the recorder, on an ordinary link."""

from contextlib import suppress
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.truth import (
    COLUMNS,
    AgentState,
    EventState,
    Sample,
    StepRecord,
    Truth,
    decode_truth,
    decode_wire,
    encode_truth,
    encode_wire,
)
from deltaswarm_wire.codec import MAX_ORDINARY_BYTES, MAX_SAMPLE_BYTES, PROTOCOL_VERSION, WireError
from deltaswarm_wire.digest import RADIO, REPORT
from tests.support.strategies import step_records
from tests.support.tiers import in_one_test

TALLY = StepRecord.of(dict.fromkeys(COLUMNS, 0))


@given(step_records, st.sampled_from(COLUMNS))
def test_a_wrong_count_is_named(record: StepRecord, field: str) -> None:
    wrong: Any = {name: value for name, value in record.columns().items() if name in COLUMNS} | {field: "many"}
    raw = {
        "v": PROTOCOL_VERSION,
        "step": 0,
        "time_s": 0.0,
        "bodies": [],
        "events": [],
        "links": [],
        "step_record": list(wrong.values()),
    }
    with pytest.raises(WireError, match=rf"^truth\.step_record\.{field} must"):
        decode_truth(msgpack.packb(raw))


@in_one_test(
    ("place", "row", "field"),
    [
        ("bodies", AgentState(0, 0.0, 0.0, "a role of too many letters", 0, -1, -1), "role"),
        ("bodies", AgentState(0, 0.0, 0.0, "free", 0, -2, -1), "parent"),
        ("bodies", AgentState(0, float("nan"), 0.0, "free", 0, -1, -1), "x_m"),
        ("events", EventState(0, 0.0, 0.0, 1.0, -1.0, None, None, 0.0), "sensed_s"),
        ("events", EventState(0, 0.0, 0.0, 1.0, None, None, float("inf"), 0.0), "completed_s"),
        ("links", (0, True), "receiver"),
    ],
)
def test_a_wrong_value_in_a_row_is_named(place: str, row: Any, field: str) -> None:
    step = Truth(0, 0.0, (), (), (), TALLY)._replace(**{place: (row,)})
    with pytest.raises(WireError, match=rf"^truth\.{place}\.{field} must"):
        decode_truth(encode_truth(step))


def test_a_thousand_agents_fit_on_an_ordinary_link() -> None:
    """Truth outgrows a low-latency link, and stays below its own limit."""
    agents = tuple(AgentState(agent, agent / 7, agent / 3, "member", 3, 1, 0) for agent in range(1000))
    events = tuple(EventState(event, 1 / 3, 1 / 7, 1 / 9, None, None, None, 0.1) for event in range(1000))
    links = tuple((sender, receiver) for sender in range(1000) for receiver in range(0, 1000, 40))
    step = Truth(1, 1.0, agents, events, links, TALLY)
    data = encode_truth(step)
    assert MAX_SAMPLE_BYTES < len(data) < MAX_ORDINARY_BYTES / 10
    assert decode_truth(data) == step


def test_oversized_truth_is_refused_at_both_ends() -> None:
    body = AgentState(65535, 1 / 3, 1 / 3, "relocating", 1, 1, 0)
    with pytest.raises(WireError, match=rf"^sample must .*{MAX_ORDINARY_BYTES}"):
        encode_truth(Truth(1, 1.0, (body,) * 300_000, (), (), TALLY))
    with pytest.raises(WireError, match=r"^sample must"):
        decode_truth(bytes(MAX_ORDINARY_BYTES + 1))


def test_the_drops_are_on_the_wire_in_their_order() -> None:
    """Other readers of the wire know the columns by their places."""
    frames = "range blackout partition obstacle jam asymmetry loss burst contention bandwidth frame_full dead"
    reports = "outage range loss burst bandwidth base_full expired left dead"
    expected = [f"dropped_{reason}" for reason in frames.split()]
    expected += ["reports_sent", "reports_arrived", "reports_in_flight"]
    expected += [f"reports_dropped_{reason}" for reason in reports.split()]
    assert [*COLUMNS[17:]] == [*expected, "rejected", "transport_lost"]


@in_one_test("drops", [{}, {"dropped_fog": -1}, {"dropped_fog": "3"}, {"fog": 3}, [], 3])
def test_wrong_drops_of_models_from_outside_are_refused(drops: Any) -> None:
    row = [*TALLY.columns().values(), drops]
    raw = {"v": PROTOCOL_VERSION, "step": 0, "time_s": 0.0, "bodies": [], "events": [], "links": []}
    with pytest.raises(WireError, match=r"^truth\.step_record"):
        decode_truth(msgpack.packb({**raw, "step_record": row}))


SAID = st.tuples(st.integers(0, 0xFFFF), st.sampled_from([RADIO, REPORT]), st.binary(max_size=50))


@given(st.integers(0, 2**32 - 1), st.lists(SAID, max_size=20))
def test_what_was_said_survives(step: int, samples: list[Sample]) -> None:
    assert decode_wire(encode_wire(step, samples)) == (step, samples)


@given(st.binary(max_size=60))
def test_rubbish_was_said_by_nobody(data: bytes) -> None:
    with suppress(WireError):
        decode_wire(data)
