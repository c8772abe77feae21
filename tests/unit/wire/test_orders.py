"""Orders between world and orchestrator: what is encoded is decoded, and nothing else is."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire.codec import MAX_AGENT_ID, MAX_ID, MAX_STEP, PROTOCOL_VERSION, WireError, pack
from deltaswarm_wire.orders import (
    ACTIONS,
    MAX_WHY,
    ProcessOrder,
    decode_done,
    decode_order,
    decode_taken,
    encode_done,
    encode_order,
    encode_taken,
)
from tests.support.tiers import in_one_test

ORDERS = st.builds(
    ProcessOrder,
    st.integers(0, MAX_ID),
    st.integers(0, MAX_STEP),
    st.floats(0, 1e8),
    st.sampled_from(ACTIONS),
    st.lists(st.integers(0, MAX_AGENT_ID), max_size=20).map(tuple),
    st.text(max_size=60),
)
GOOD = ProcessOrder(0, 3, 3.0, "kill", (1, 2), "kill of the roots")


@given(ORDERS)
def test_an_order_survives(order: ProcessOrder) -> None:
    assert decode_order(encode_order(order)) == order
    assert str(order.step) in order.text


def test_a_long_reason_of_a_plugin_is_cut() -> None:
    assert decode_order(encode_order(GOOD._replace(why="x" * 1000))) == GOOD._replace(why="x" * MAX_WHY)


@given(st.integers(0, MAX_ID))
def test_the_word_that_it_is_done_survives(number: int) -> None:
    assert decode_done(encode_done(number)) == number


@given(st.integers(-1, MAX_STEP))
def test_the_word_of_what_is_taken_survives(step: int) -> None:
    assert decode_taken(encode_taken(step)) == step


@in_one_test(
    ("field", "value"),
    [("action", "burn"), ("agents", 3), ("agents", [-1]), ("agents", ["1"]), ("step", 1.5), ("number", -1), ("why", 7)],
)
def test_a_wrong_field_is_named(field: str, value: Any) -> None:
    with pytest.raises(WireError) as caught:
        decode_order(pack({"v": PROTOCOL_VERSION, **GOOD._asdict(), field: value}))
    assert caught.value.field == f"order.{field}"


@given(st.binary(max_size=40))
def test_rubbish_is_refused(data: bytes) -> None:
    for decode in (decode_order, decode_done, decode_taken):
        with pytest.raises(WireError):
            decode(data)
