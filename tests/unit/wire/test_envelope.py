"""The envelope of radio frames: a counter and an opaque payload; what is wrong is named."""

from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire.codec import MAX_ID, MAX_RADIO_BYTES, PROTOCOL_VERSION, WireError
from deltaswarm_wire.envelope import MAX_COMMANDS, Sample, decode_sample, encode_sample
from tests.support.strategies import NASTY, RADIO, assert_decodes_or_complains, assert_field_is_named, repacked, strange

PLAIN = Sample(5, b"whatever a controller says")


@given(RADIO.strategy)
def test_what_is_sent_is_heard(sample: Sample) -> None:
    """Counter, payload and commands come out as they went in."""
    assert decode_sample(encode_sample(sample)) == sample


@given(st.binary(max_size=200))
def test_a_payload_is_opaque(payload: bytes) -> None:
    """Any bytes pass, also none; nobody but the controller reads them."""
    assert decode_sample(encode_sample(Sample(0, payload))).payload == payload


@given(strange(RADIO))
def test_what_is_strange_is_refused_by_name(data: bytes) -> None:
    """Damaged or reshaped samples and random bytes decode to something valid or name a field."""
    assert_decodes_or_complains(RADIO, data)


@given(RADIO.strategy, st.data())
def test_a_wrong_field_is_named(sample: Sample, data: st.DataObject) -> None:
    """One bad value in one field: the error says which."""
    for field in RADIO.places:
        assert_field_is_named(RADIO, sample, field, data.draw(st.sampled_from(NASTY)))


@pytest.mark.parametrize("version", [1, PROTOCOL_VERSION + 1, True, None, 2.0])
def test_another_version_is_refused(version: Any) -> None:
    """Also the one whose frames were not opaque."""
    with pytest.raises(WireError, match=r"^version must"):
        decode_sample(repacked(encode_sample(PLAIN), 0, version))


@pytest.mark.parametrize("payload", ["text", None, 5, [1, 2], [], True])
def test_a_payload_is_bytes(payload: Any) -> None:
    """Text is not, nor are values that a sender did not encode."""
    with pytest.raises(WireError, match=r"^radio\.payload must be bytes"):
        decode_sample(repacked(encode_sample(PLAIN), 2, payload))


@pytest.mark.parametrize("counter", [-1, MAX_ID + 1, True, 1.0])
def test_a_counter_is_an_integer_of_32_bits(counter: Any) -> None:
    """From 0 on."""
    with pytest.raises(WireError, match=r"^radio\.counter must"):
        decode_sample(repacked(encode_sample(PLAIN), 1, counter))


def test_commands_are_bytes_and_few() -> None:
    """As many as the limit pass, one more does not, and nothing else does."""
    full = Sample(5, b"", (b"go",) * MAX_COMMANDS)
    assert decode_sample(encode_sample(full)) == full
    for wrong in ((b"go",) * (MAX_COMMANDS + 1), ("go",), (5,)):
        with pytest.raises(WireError, match=r"^radio\.commands must"):
            decode_sample(encode_sample(Sample(5, b"", wrong)))  # type: ignore[arg-type]


def test_a_frame_without_commands_does_not_pay_for_them() -> None:
    """Five bytes besides the payload: array, version, counter, and two for the payload's length."""
    assert msgpack.unpackb(encode_sample(PLAIN)) == [PROTOCOL_VERSION, 5, PLAIN.payload]
    assert len(encode_sample(PLAIN)) == len(PLAIN.payload) + 5


@pytest.mark.parametrize("length", [*range(3), *range(5, 9)])
def test_a_sample_has_three_or_four_items(length: int) -> None:
    """No fewer and no more."""
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
