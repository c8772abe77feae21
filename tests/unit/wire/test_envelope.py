"""The envelope of radio frames: a counter and an opaque payload; what is wrong is named."""

from typing import Any

import msgpack
import pytest

from deltaswarm_wire.codec import MAX_ID, MAX_RADIO_BYTES, PROTOCOL_VERSION, WireError
from deltaswarm_wire.envelope import MAX_COMMANDS, Sample, decode_sample, encode_sample
from tests.support.strategies import repacked
from tests.support.tiers import in_one_test

PLAIN = Sample(5, b"whatever a controller says")


@in_one_test(
    ("place", "value", "said"),
    [
        *((0, version, r"version must") for version in (1, PROTOCOL_VERSION + 1, True, None, 2.0)),
        *((1, counter, r"radio\.counter must") for counter in (-1, MAX_ID + 1, True, 1.0)),
        *((2, payload, r"radio\.payload must be bytes") for payload in ("text", None, 5, [1, 2], [], True)),
    ],
)
def test_a_wrong_value_is_refused(place: int, value: Any, said: str) -> None:
    with pytest.raises(WireError, match=f"^{said}"):
        decode_sample(repacked(encode_sample(PLAIN), place, value))


def test_commands_are_bytes_and_few() -> None:
    full = Sample(5, b"", (b"go",) * MAX_COMMANDS)
    assert decode_sample(encode_sample(full)) == full
    for wrong in ((b"go",) * (MAX_COMMANDS + 1), ("go",), (5,)):
        with pytest.raises(WireError, match=r"^radio\.commands must"):
            decode_sample(encode_sample(Sample(5, b"", wrong)))  # type: ignore[arg-type]


def test_a_frame_without_commands_does_not_pay_for_them() -> None:
    """Five bytes besides the payload: array, version, counter, and two for the payload's length."""
    assert msgpack.unpackb(encode_sample(PLAIN)) == [PROTOCOL_VERSION, 5, PLAIN.payload]
    assert len(encode_sample(PLAIN)) == len(PLAIN.payload) + 5


@in_one_test("length", [*range(3), *range(5, 9)])
def test_a_sample_has_three_or_four_items(length: int) -> None:
    raw = [PROTOCOL_VERSION, 5, b"", [], 0, 0, 0, 0][:length]
    with pytest.raises(WireError, match=r"^radio must .*3 or 4"):
        decode_sample(msgpack.packb(raw))


def test_an_oversized_sample_is_refused_at_both_ends() -> None:
    """The sender gets an error; a receiver does not even look. The limit is that of the whole sample."""
    largest = Sample(MAX_ID, bytes(MAX_RADIO_BYTES - 10))
    assert len(encode_sample(largest)) == MAX_RADIO_BYTES
    with pytest.raises(WireError, match=rf"^sample must .*{MAX_RADIO_BYTES} .*{MAX_RADIO_BYTES + 1}"):
        encode_sample(largest._replace(payload=largest.payload + b"x"))
    with pytest.raises(WireError, match=rf"^sample must .*{MAX_RADIO_BYTES + 1}"):
        decode_sample(bytes(MAX_RADIO_BYTES + 1))
