"""Radio frames: what was sent is heard, and what is wrong is named."""

from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.frames import (
    Attending,
    Descendant,
    Gone,
    Leaving,
    Member,
    RecruitmentOrder,
    Relocating,
    Sighting,
    decode_radio,
    encode_radio,
)
from deltaswarm_wire import radio
from deltaswarm_wire.codec import MAX_ABS_CM, MAX_AGENT_ID, MAX_ID, MAX_RADIO_BYTES, MAX_STEP, WireError
from tests.strategies import (
    ATTENDING,
    MEMBER,
    NASTY,
    RADIO,
    Codec,
    assert_decodes_or_complains,
    assert_field_is_named,
    members,
    radio_frames,
    repacked,
    strange,
)

SENDER = 7
PLAIN = Member(SENDER, 3, 100, 200, False, (2, SENDER), 5, 1, (), (), (), None)

FULL = Member(
    MAX_AGENT_ID,
    MAX_STEP,
    -MAX_ABS_CM,
    -MAX_ABS_CM,
    True,
    tuple(range(MAX_AGENT_ID - radio.MAX_PATH + 1, MAX_AGENT_ID + 1)),
    MAX_STEP,
    radio.MAX_SCORE,
    (Descendant(MAX_AGENT_ID, MAX_AGENT_ID, -MAX_ABS_CM, -MAX_ABS_CM, radio.MAX_SCORE),) * radio.MAX_TABLE,
    (Sighting(MAX_ID, -MAX_ABS_CM, -MAX_ABS_CM, radio.MAX_AGE),) * radio.MAX_EVENTS,
    (Gone(MAX_ID, radio.MAX_AGE),) * radio.MAX_GONE,
    RecruitmentOrder(MAX_AGENT_ID, -MAX_ABS_CM, -MAX_ABS_CM, MAX_STEP, radio.MAX_TTL),
)


@given(radio_frames)
def test_what_is_sent_is_heard(frame: radio.PaperFrame) -> None:
    """Every frame comes out as it went in, and as the same kind."""
    heard = decode_radio(encode_radio(frame))
    assert heard == frame
    assert type(heard) is type(frame)


@given(strange(RADIO))
def test_what_is_strange_is_refused_by_name(data: bytes) -> None:
    """Damaged or reshaped frames and random bytes decode to something valid or name a field."""
    assert_decodes_or_complains(MEMBER if data[1:2] == b"\x01" else ATTENDING, data)


@pytest.mark.parametrize("codec", [MEMBER, ATTENDING], ids=["member", "attending"])
@given(data=st.data())
def test_a_wrong_field_is_named(codec: Codec, data: st.DataObject) -> None:
    """One bad value in one field: the error says which. A new sender does not end its path."""
    frame = data.draw(codec.strategy)
    for field in codec.places:
        assert_field_is_named(codec, frame, field, data.draw(st.sampled_from(NASTY)))


@given(members(), st.sampled_from(["table", "events", "gone", "order", "path"]), st.data())
def test_one_bad_number_in_a_row_is_found(frame: Member, field: str, data: st.DataObject) -> None:
    """Rows are checked all at once for speed; a single bad value among good ones is found all the same."""
    raw: Any = msgpack.unpackb(encode_radio(frame))
    row = raw[MEMBER.places[field]]
    if row:
        row[data.draw(st.integers(0, len(row) - 1))] = data.draw(st.sampled_from([None, True, 0.5, -(2**40), 2**40]))
        with pytest.raises(WireError, match=rf"^radio\.{field}: "):
            decode_radio(msgpack.packb(raw))


@given(members(), st.sampled_from(["table", "events", "gone"]))
def test_rows_are_whole(frame: Member, field: str) -> None:
    """Rows stand one after the other in a flat array; one number too many is no row."""
    raw: Any = msgpack.unpackb(encode_radio(frame))
    raw[MEMBER.places[field]].append(0)
    with pytest.raises(WireError, match=rf"^radio\.{field}: .* multiple of"):
        decode_radio(msgpack.packb(raw))


@pytest.mark.parametrize("kind", [True, False, 1.0, -1, 4, None, "member", [1], 2**40])
def test_a_kind_is_one_of_four_integers(kind: Any) -> None:
    """True equals 1 in Python; it is no kind of frame."""
    with pytest.raises(WireError, match=r"^radio\.kind: "):
        decode_radio(repacked(encode_radio(PLAIN), 1, kind))


@pytest.mark.parametrize("path", [(), (SENDER, 2), (2,), (2, 3, 2, SENDER), (SENDER, 2, SENDER)])
def test_a_path_ends_with_its_sender_and_names_nobody_twice(path: tuple[int, ...]) -> None:
    """A frame whose path is a cycle, or not its sender's, is not heard."""
    with pytest.raises(WireError, match=r"^radio\.path: "):
        decode_radio(encode_radio(PLAIN._replace(path=path)))


@pytest.mark.parametrize("field", ["table", "events", "gone"])
def test_rows_are_limited_in_number(field: str) -> None:
    """As many as the limit pass, one more does not."""
    rows = getattr(FULL, field)
    assert decode_radio(encode_radio(PLAIN._replace(**{field: rows})))
    with pytest.raises(WireError, match=rf"^radio\.{field}: .*, at most"):
        decode_radio(encode_radio(PLAIN._replace(**{field: (*rows, rows[0])})))


def test_a_frame_with_everything_at_its_limit_fits() -> None:
    """No frame that keeps the limits of its parts breaks the limit of the whole."""
    data = encode_radio(FULL)
    assert len(data) <= MAX_RADIO_BYTES
    assert decode_radio(data) == FULL


def test_an_oversized_frame_is_refused_at_both_ends() -> None:
    """The sender gets an error rather than a dead link; a receiver does not even look."""
    with pytest.raises(WireError, match=rf"^sample: .*{MAX_RADIO_BYTES}"):
        encode_radio(FULL._replace(table=FULL.table * 2))
    with pytest.raises(WireError, match=rf"^sample: {MAX_RADIO_BYTES + 1} bytes"):
        decode_radio(bytes(MAX_RADIO_BYTES + 1))


@pytest.mark.parametrize(
    ("frame", "most_bytes"),
    [
        (Attending(24, 8999, 10000, 10000, 449, 10000, 10000), 24),
        (Relocating(24, 8999, 10000, 10000), 13),
        (Leaving(24, 8999, 10000, 10000), 13),
        (Member(24, 8999, 10000, 10000, False, (24,), 8999, 3, (), (), (), None), 25),
    ],
    ids=lambda value: type(value).__name__,
)
def test_frames_are_short_on_the_air(frame: radio.PaperFrame, most_bytes: int) -> None:
    """At the far corner of the paper's arena, at the end of a run."""
    assert len(encode_radio(frame)) <= most_bytes


def test_a_frame_of_one_kind_with_the_length_of_another_is_refused() -> None:
    """The kind says how many fields there are."""
    for kind in (radio.ATTENDING, radio.MEMBER, radio.RELOCATING, radio.LEAVING):
        for length in range(15):
            raw = [1, kind, 0, 0, 0, 0, *([0] * 8)][:length]
            if (kind, length) not in [(radio.ATTENDING, 9), (radio.RELOCATING, 6), (radio.LEAVING, 6)]:
                with pytest.raises(WireError, match=r"^radio"):
                    decode_radio(msgpack.packb(raw))
