"""Frames, acts, reports, the envelope, truth and all others: what was sent arrives, what is wrong is named."""

from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire import messages
from deltaswarm_wire.codec import MAX_AGENT_ID, MAX_RADIO_BYTES, MAX_SAMPLE_BYTES, PROTOCOL_VERSION, WireError
from deltaswarm_wire.envelope import Sample, encode_sample
from deltaswarm_wire.messages import Event, Frame, decode_frame, encode_frame
from deltaswarm_wire.operator_messages import (
    MAX_FAULT,
    MAX_REPORTED,
    Health,
    Report,
    decode_health,
    decode_report,
    encode_health,
    encode_report,
    read_own_report,
)
from deltaswarm_world.core.world import HEARD_BYTES
from tests.support.strategies import (
    CODECS,
    FELT_FRAME,
    FRAME,
    MESSAGES,
    NASTY,
    RADIO,
    TRUTH,
    Codec,
    assert_decodes_or_complains,
    assert_field_is_named,
    events,
    nested,
    reports,
    strange,
)
from tests.support.tiers import in_one_test

each = pytest.mark.parametrize("codec", [*MESSAGES, RADIO, TRUTH], ids=str)


@each
@given(data=st.data())
def test_what_is_encoded_is_decoded(codec: Codec, data: st.DataObject) -> None:
    message = data.draw(codec.strategy)
    assert codec.decode(codec.encode(message)) == message


@each
@given(data=st.data())
def test_what_is_strange_is_refused_by_name(codec: Codec, data: st.DataObject) -> None:
    assert_decodes_or_complains(codec, data.draw(strange(codec)))


@each
@given(data=st.data())
def test_a_wrong_field_is_named(codec: Codec, data: st.DataObject) -> None:
    message = data.draw(codec.strategy)
    for field in codec.places:
        assert_field_is_named(codec, message, field, data.draw(st.sampled_from(NASTY)))


@pytest.mark.parametrize("codec", [codec for codec in CODECS if codec.places], ids=str)
@given(data=st.data())
def test_nesting_of_any_depth_in_any_field_is_refused(codec: Codec, data: st.DataObject) -> None:
    raw = msgpack.unpackb(codec.encode(data.draw(codec.strategy)))
    field = data.draw(st.sampled_from(list(codec.places)))
    raw[codec.places[field]] = "here"
    deep = nested(data.draw(st.integers(900, 1100)))
    with pytest.raises(WireError):
        codec.decode(msgpack.packb(raw).replace(b"\xa4here", deep))


@pytest.mark.parametrize("codec", MESSAGES, ids=str)
@given(data=st.data())
def test_every_field_is_needed_and_no_other_is_taken(codec: Codec, data: st.DataObject) -> None:
    message = data.draw(codec.strategy)
    less: Any = msgpack.unpackb(codec.encode(message))
    more: Any = msgpack.unpackb(codec.encode(message))
    del less[data.draw(st.sampled_from([place for name, place in codec.places.items() if name not in codec.optional]))]
    if type(more) is dict:
        more["extra"] = 0
    else:
        more.append(0)
    for raw in (less, more):
        with pytest.raises(WireError, match=f"^{codec.name}"):
            codec.decode(msgpack.packb(raw))


@given(events)
def test_a_sensed_event_fits_into_what_is_reckoned_for_it(event: Event) -> None:
    """The world reckons with SENSED_BYTES for each event of a frame."""
    assert len(msgpack.packb(event)) <= messages.SENSED_BYTES


@in_one_test("radio_bytes", [1, 7, 20, 342, MAX_RADIO_BYTES])
def test_a_frame_that_is_full_to_its_room_passes(radio_bytes: int) -> None:
    """Whatever fits into FRAME_ROOM_BYTES, with what the world reckons besides for each, is encoded and decoded."""
    count = min(messages.MAX_HEARD, messages.FRAME_ROOM_BYTES // (radio_bytes + HEARD_BYTES))
    heard = ((MAX_AGENT_ID, b"x" * radio_bytes),) * count
    frame = Frame(2**32 - 1, 1e9, True, -1e6, 1e6, ((1 / 3, 1 / 3),) * messages.MAX_POSES, (), heard)
    data = encode_frame(frame)
    assert len(data) <= MAX_SAMPLE_BYTES
    assert decode_frame(data) == frame


def test_more_frames_than_may_be_heard_do_not_fit_into_a_frame() -> None:
    """The number of heard frames needs no check of its own at the sender: bytes run out first."""
    smallest = len(encode_sample(Sample(0, b"")))
    assert messages.FRAME_ROOM_BYTES // (smallest + HEARD_BYTES) < messages.MAX_HEARD


def test_a_frame_with_all_events_that_may_be_sensed_passes() -> None:
    poses = ((1 / 3, 1 / 3),) * messages.MAX_POSES
    frame = Frame(1, 1.0, False, 0.0, 0.0, poses, (Event(2**32 - 1, 1e5, 1e5),) * messages.MAX_SENSED, ())
    assert decode_frame(encode_frame(frame)) == frame


@pytest.mark.parametrize(
    ("heard", "said"),
    [(((0, b"x" * (MAX_RADIO_BYTES + 1)),), "frame.heard"), (((0, b"x" * MAX_RADIO_BYTES),) * 5, "sample")],
)
def test_an_oversized_frame_is_refused(heard: tuple[messages.Heard, ...], said: str) -> None:
    """One heard frame may be as large as a radio frame may; a whole frame as large as a sample may."""
    with pytest.raises(WireError, match=f"^{said}"):
        decode_frame(encode_frame(Frame(1, 1.0, False, 0.0, 0.0, (), (), heard)))


def test_the_longest_report_is_far_below_the_limit() -> None:
    """A root that knows more events reports the first MAX_REPORTED."""
    event = Event(2**32 - 1, -1e6, 1e6)
    full = Report(65535, 2**32 - 1, 2**32 - 1, "attending", -1e6, 1e6, 65535, (event,) * 64)
    assert len(encode_report(full)) < MAX_SAMPLE_BYTES / 10
    more = full._replace(events=(event,) * (MAX_REPORTED + 1))
    with pytest.raises(WireError, match=r"^report\.events must .*64.*got 65"):
        decode_report(encode_report(more))


@given(reports)
def test_a_report_of_ones_own_is_read_as_anothers(report: Report) -> None:
    """To the types: the console must not see which engine made it."""
    data = encode_report(report)
    assert [*map(repr, read_own_report(data))] == [*map(repr, decode_report(data))]


@given(st.text())
def test_whatever_a_body_says_of_itself_can_be_sent(fault: str) -> None:
    """On one line, and cut to its length; nothing of it can pass for another line in the operator's log."""
    sent = decode_health(encode_health(Health(fault))).fault
    assert len(sent) == min(len(fault), MAX_FAULT)
    assert len(sent.splitlines()) <= 1
    assert all(new in (old, " ") for old, new in zip(fault, sent, strict=False))


def test_a_word_of_health_with_control_characters_is_refused() -> None:
    """It would be written into a log and on a terminal."""
    with pytest.raises(WireError, match=r"^health\.fault must .*printable"):
        decode_health(msgpack.packb({"v": PROTOCOL_VERSION, "fault": "well\x1b[2J\nagent 4 is there"}))


def test_a_frame_is_not_an_act() -> None:
    """Messages have no kind of their own, the key has; still a wrong one is refused."""
    frame = encode_frame(Frame(1, 1.0, False, 0.0, 0.0, (), (), ()))
    for codec in MESSAGES:
        if codec not in (FRAME, FELT_FRAME):
            with pytest.raises(WireError):
                codec.decode(frame)
