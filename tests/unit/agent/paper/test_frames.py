"""The payload of the paper's radio frames: what was sent is heard, and what is wrong is named."""

from collections.abc import Iterator
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper import frames
from deltaswarm_agent.controllers.paper.frames import (
    Attending,
    Averages,
    Descendant,
    Gone,
    Leaving,
    Member,
    PaperFrame,
    RecruitmentOrder,
    Relocating,
    Sighting,
    decode,
    encode,
)
from deltaswarm_wire.codec import MAX_ABS_CM, MAX_AGENT_ID, MAX_ID, MAX_RADIO_BYTES, MAX_STEP, WireError
from deltaswarm_wire.envelope import Sample, encode_sample
from tests.support.strategies import (
    ATTENDING,
    MEMBER,
    NASTY,
    PAPER,
    SENDER,
    Codec,
    assert_decodes_or_complains,
    assert_field_is_named,
    repacked,
    strange,
)
from tests.support.tiers import in_one_test

PLAIN = Member(SENDER, 100, 200, False, (2, SENDER), 5, 1, (), (), (), None)

FULL = Member(
    MAX_AGENT_ID,
    -MAX_ABS_CM,
    -MAX_ABS_CM,
    True,
    tuple(range(MAX_AGENT_ID - frames.MAX_PATH + 1, MAX_AGENT_ID + 1)),
    MAX_STEP,
    frames.MAX_SCORE,
    (Descendant(MAX_AGENT_ID, MAX_AGENT_ID, -MAX_ABS_CM, -MAX_ABS_CM, frames.MAX_SCORE),) * frames.MAX_TABLE,
    (Sighting(MAX_ID, -MAX_ABS_CM, -MAX_ABS_CM, frames.MAX_AGE),) * frames.MAX_EVENTS,
    (Gone(MAX_ID, frames.MAX_AGE),) * frames.MAX_GONE,
    RecruitmentOrder(MAX_AGENT_ID, -MAX_ABS_CM, -MAX_ABS_CM, MAX_STEP, frames.MAX_TTL),
    Averages(MAX_ID, MAX_ID, MAX_ID, MAX_ID, 1000, frames.Tried(frames.MAX_ARM, MAX_ID, MAX_ID, MAX_ID)),
)


@pytest.fixture(autouse=True)
def nothing_kept() -> Iterator[None]:
    """Begin and end without frames kept from encoding: they would not be decoded at all."""
    frames.encoded.clear()
    yield
    frames.encoded.clear()


def decoded(payload: bytes, sender: int = SENDER) -> PaperFrame:
    """A payload of another process, so that it must be decoded."""
    frames.encoded.clear()
    return decode(sender, payload)


@given(PAPER.strategy)
def test_what_is_sent_is_heard(frame: PaperFrame) -> None:
    heard = decoded(encode(frame))
    assert heard == frame
    assert type(heard) is type(frame)


@given(PAPER.strategy)
def test_what_this_process_encoded_need_not_be_decoded(frame: PaperFrame) -> None:
    """It is kept by sender and payload, and equals what decoding gives; another sender's is decoded."""
    payload = encode(frame)
    assert decode(SENDER, payload) is frame
    assert decode(SENDER, bytes(payload)) == decoded(payload)
    other = decode(SENDER + 1, payload) if SENDER + 1 not in getattr(frame, "path", ()) else None
    assert other is None or other.sender == SENDER + 1


def test_few_frames_are_kept_of_each_sender() -> None:
    """Memory does not grow with the length of a run."""
    for x_cm in range(100):
        encode(Leaving(SENDER, x_cm, 0))
    assert len(frames.encoded[SENDER]) == frames.KEPT


@given(strange(PAPER))
def test_what_is_strange_is_refused_by_name(data: bytes) -> None:
    assert_decodes_or_complains(MEMBER if data[1:2] == b"\x01" else ATTENDING, data)


@pytest.mark.parametrize("codec", [MEMBER, ATTENDING], ids=["member", "attending"])
@given(data=st.data())
def test_a_wrong_field_is_named(codec: Codec, data: st.DataObject) -> None:
    frame = data.draw(codec.strategy)
    for field in codec.places:
        assert_field_is_named(codec, frame, field, data.draw(st.sampled_from(NASTY)))


@given(MEMBER.strategy, st.sampled_from(["table", "events", "gone", "order", "path", "averages"]), st.data())
def test_one_bad_number_in_a_row_is_found(frame: Member, field: str, data: st.DataObject) -> None:
    """Rows are checked all at once for speed; a single bad value among good ones is found all the same."""
    raw: Any = msgpack.unpackb(encode(frame))
    row = raw[MEMBER.places[field]]
    if row:
        row[data.draw(st.integers(0, len(row) - 1))] = data.draw(st.sampled_from([None, True, 0.5, -(2**40), 2**40]))
        with pytest.raises(WireError, match=rf"^frame\.{field} must"):
            decoded(msgpack.packb(raw))


@given(MEMBER.strategy, st.sampled_from(["table", "events", "gone"]))
def test_rows_are_whole(frame: Member, field: str) -> None:
    raw: Any = msgpack.unpackb(encode(frame))
    raw[MEMBER.places[field]].append(0)
    with pytest.raises(WireError, match=rf"^frame\.{field} must .*multiple"):
        decoded(msgpack.packb(raw))


@in_one_test("kind", [True, False, 1.0, -1, 4, None, "member", [1], 2**40])
def test_a_kind_is_one_of_four_integers(kind: Any) -> None:
    """True equals 1 in Python; it is no kind of frame."""
    with pytest.raises(WireError, match=r"^frame\.kind must"):
        decoded(repacked(encode(PLAIN), 0, kind))


@in_one_test("above", [(2, 2), (2, 3, 2), (SENDER,), (2, SENDER, 3)])
def test_a_path_names_nobody_twice(above: tuple[int, ...]) -> None:
    """A frame whose path is a cycle is not heard; its sender is the last of its path."""
    payload = encode(PLAIN._replace(path=(*above, SENDER)))
    with pytest.raises(WireError, match=r"^frame\.path must .*once"):
        decoded(payload)


def test_a_payload_does_not_say_who_sent_it() -> None:
    """The key does, so that no agent can speak as another, and it costs no bytes."""
    payload = encode(PLAIN)
    other = decoded(payload, 9)
    assert other == PLAIN._replace(sender=9, path=(2, 9))
    assert encode(other) == payload


@pytest.mark.parametrize("field", ["table", "events", "gone"])
def test_rows_are_limited_in_number(field: str) -> None:
    rows = getattr(FULL, field)
    assert decoded(encode(PLAIN._replace(**{field: rows})))
    with pytest.raises(WireError, match=rf"^frame\.{field} must .*at most"):
        decoded(encode(PLAIN._replace(**{field: (*rows, rows[0])})))


def test_a_path_is_limited_in_length() -> None:
    longest = tuple(range(1000, 1000 + frames.MAX_PATH - 1))
    assert decoded(encode(PLAIN._replace(path=(*longest, SENDER)))) == PLAIN._replace(path=(*longest, SENDER))
    with pytest.raises(WireError, match=r"^frame\.path must .*at most"):
        decoded(encode(PLAIN._replace(path=(1, *longest, SENDER))))


def test_a_frame_with_everything_at_its_limit_fits() -> None:
    """No frame that keeps the limits of its parts breaks the limit of the whole, its envelope included."""
    payload = encode(FULL)
    assert len(encode_sample(Sample(MAX_ID, payload))) <= MAX_RADIO_BYTES
    assert decoded(payload, MAX_AGENT_ID) == FULL


def test_an_oversized_frame_is_refused_at_both_ends() -> None:
    """The sender gets an error rather than a dead link; a receiver does not even look."""
    with pytest.raises(WireError, match=rf"^sample must .*{MAX_RADIO_BYTES}"):
        encode(FULL._replace(table=FULL.table * 2))
    with pytest.raises(WireError, match=rf"^sample must .*{MAX_RADIO_BYTES + 1}"):
        decoded(bytes(MAX_RADIO_BYTES + 1))


@in_one_test(
    ("frame", "most_bytes"),
    [
        (Attending(24, 10000, 10000, 449, 10000, 10000), 17),
        (Relocating(24, 10000, 10000), 8),
        (Leaving(24, 10000, 10000), 8),
        (Member(24, 10000, 10000, False, (24,), 8999, 3, (), (), (), None), 18),
    ],
)
def test_frames_are_short_on_the_air(frame: PaperFrame, most_bytes: int) -> None:
    """At the far corner of the paper's arena, at the end of a run; the envelope adds 5 to 9 bytes."""
    payload = encode(frame)
    assert len(payload) <= most_bytes
    for counter, more in ((0, 5), (MAX_ID, 9)):
        assert len(encode_sample(Sample(counter, payload))) == len(payload) + more


def test_a_frame_of_one_kind_with_the_length_of_another_is_refused() -> None:
    lengths = {frames.ATTENDING: 6, frames.RELOCATING: 3, frames.LEAVING: 3}
    for kind in (frames.ATTENDING, frames.MEMBER, frames.RELOCATING, frames.LEAVING):
        for length in range(15):
            if length != lengths.get(kind):
                with pytest.raises(WireError, match=r"^frame"):
                    decoded(msgpack.packb([kind, *([0] * 14)][:length]))
