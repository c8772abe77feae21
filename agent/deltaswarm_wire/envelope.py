"""The envelope of a radio frame: the only part that the air, the recorder and the tools read.

The payload belongs to the sender's controller. The sender is known from the key on which the sample came.
"""

from collections.abc import Iterable
from typing import NamedTuple

from deltaswarm_wire.codec import (
    MAX_ABS_M,
    MAX_ID,
    MAX_RADIO_BYTES,
    PROTOCOL_VERSION,
    WireError,
    array,
    arrays,
    integer,
    keep,
    number,
    pack,
    unpack,
    version,
)
from deltaswarm_wire.messages import MAX_TIME_S

MAX_COMMANDS = 8
"""Operator commands that one frame can relay."""

MAX_SENT_BYTES = 32
"""Maximum size of a radio sample's attachment."""


ITEM_BYTES = 3
"""What a relayed command takes in a frame besides its own bytes, at most."""


def fitting(items: Iterable[bytes], room_bytes: int) -> tuple[bytes, ...]:
    """The first of these encoded commands that fit into one frame with this much room for them."""
    taken: list[bytes] = []
    for item in items:
        room_bytes -= len(item) + ITEM_BYTES
        if room_bytes < 0 or len(taken) == MAX_COMMANDS:
            break
        taken.append(item)
    return tuple(taken)


class Sample(NamedTuple):
    """One radio frame: the sender's frame count, the controller's payload, relayed commands.

    A frame that only relays commands has no payload.
    """

    counter: int
    payload: bytes | None
    commands: tuple[bytes, ...] = ()


def encode_sample(sample: Sample) -> bytes:
    """`[version, counter, payload]`, with `[command...]` as a fourth item if there are commands."""
    counter, payload, commands = sample
    items = (PROTOCOL_VERSION, counter, payload, commands) if commands else (PROTOCOL_VERSION, counter, payload)
    return pack(items, MAX_RADIO_BYTES)


def decode_sample(data: bytes) -> Sample:
    """Check and decode all but the payload. Raises WireError."""
    raw = unpack(data, MAX_RADIO_BYTES)
    if type(raw) is not list or not 3 <= len(raw) <= 4:
        raise WireError(
            "radio", "be an array of 3 or 4 items", type(raw).__name__ if type(raw) is not list else len(raw)
        )
    version(raw[0])
    counter = integer(raw[1], 0, MAX_ID, "radio.counter")
    commands = _commands(raw[3]) if len(raw) == 4 else ()
    if type(raw[2]) is not bytes and not (raw[2] is None and commands):
        raise WireError("radio.payload", "be bytes", type(raw[2]).__name__)
    return Sample(counter, raw[2], commands)


_KEPT = 256
_kept: dict[bytes, Sample] = {}
"""The newest samples by their bytes: in one process a frame with many receivers is decoded once, or not at all."""


def keep_sample(data: bytes, sample: Sample) -> Sample:
    """Keep a sample that `decode_sample` would make of these bytes, and return it."""
    return keep(_kept, data, sample, _KEPT)


def opened(data: bytes) -> Sample:
    """Return what `decode_sample` returns. Raises WireError."""
    sample = _kept.get(data)
    return keep_sample(data, decode_sample(data)) if sample is None else sample


def _commands(raw: object) -> tuple[bytes, ...]:
    commands = arrays(raw, MAX_COMMANDS, "radio.commands")
    for command in commands:
        if type(command) is not bytes:
            raise WireError("radio.commands", "be bytes", type(command).__name__)
    return tuple(commands)


class Sent(NamedTuple):
    """A radio sample's attachment: sending time by the sender's clock [s since its start], and position [m]."""

    sent_s: float
    x_m: float
    y_m: float


def encode_sent(sent: Sent) -> bytes:
    """`[sent_s, x_m, y_m]`."""
    return pack(sent)


def decode_sent(data: bytes) -> Sent:
    """Check and decode. Raises WireError."""
    sent_s, x_m, y_m = array(unpack(data, MAX_SENT_BYTES), 3, "sent")
    return Sent(
        number(sent_s, 0.0, MAX_TIME_S, "sent.sent_s"),
        number(x_m, -MAX_ABS_M, MAX_ABS_M, "sent.x_m"),
        number(y_m, -MAX_ABS_M, MAX_ABS_M, "sent.y_m"),
    )
