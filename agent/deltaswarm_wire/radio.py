"""Radio frames: all that an agent ever tells another agent.

They are MessagePack arrays, since their bytes count on the air. Positions are whole centimetres in
the world frame. At most one frame per agent and step; who has nothing to say is silent.
"""

from typing import Any, NamedTuple

from deltaswarm_wire.codec import (
    MAX_ABS_CM,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_RADIO_BYTES,
    MAX_STEP,
    PROTOCOL_VERSION,
    WireError,
    array,
    arrays,
    boolean,
    integer,
    pack,
    unpack,
    version,
)

MAX_PATH = 128
MAX_TABLE = 512
MAX_EVENTS = 16
MAX_GONE = 8
MAX_AGE = 255
MAX_SCORE = 0xFFFF
MAX_TTL = 64

ATTENDING, MEMBER, RELOCATING, LEAVING = 0, 1, 2, 3


class Attending(NamedTuple):
    """A free agent stands at an event and observes it (Baseline coordination algorithm)."""

    sender: int
    counter: int
    x_cm: int
    y_cm: int
    event: int
    event_x_cm: int
    event_y_cm: int


class Descendant(NamedTuple):
    """One row of a member's table: an agent below it (the paper's F_i with its scores S_i)."""

    agent: int
    parent: int
    x_cm: int
    y_cm: int
    score: int


class Sighting(NamedTuple):
    """An event that some member of the tree sensed `age` steps ago."""

    event: int
    x_cm: int
    y_cm: int
    age: int


class Gone(NamedTuple):
    """An event that some member of the tree found missing `age` steps ago."""

    event: int
    age: int


class Order(NamedTuple):
    """A root tells a leaf where to go (Active Recruitment); relayed down while `ttl` lasts."""

    leaf: int
    x_cm: int
    y_cm: int
    number: int
    ttl: int


class Member(NamedTuple):
    """An agent in a tree. The path runs from the root to the sender, so its length less 1 is the level."""

    sender: int
    counter: int
    x_cm: int
    y_cm: int
    orphan: bool
    path: tuple[int, ...]
    pulse: int
    score: int
    table: tuple[Descendant, ...]
    events: tuple[Sighting, ...]
    gone: tuple[Gone, ...]
    order: Order | None


class Relocating(NamedTuple):
    """A recruited leaf on its way."""

    sender: int
    counter: int
    x_cm: int
    y_cm: int


class Leaving(NamedTuple):
    """An agent that has just left its tree, and with it its whole subtree (Dissolution)."""

    sender: int
    counter: int
    x_cm: int
    y_cm: int


RadioFrame = Attending | Member | Relocating | Leaving

_KIND_OF = {Attending: ATTENDING, Member: MEMBER, Relocating: RELOCATING, Leaving: LEAVING}


def encode_radio(frame: RadioFrame) -> bytes:
    """The frame's bytes on the air: `[version, kind, *fields]`."""
    return pack((PROTOCOL_VERSION, _KIND_OF[type(frame)], *frame), MAX_RADIO_BYTES)


def decode_radio(data: bytes) -> RadioFrame:
    """Check and decode one frame.

    Raises:
        WireError: anything that breaks the protocol, naming the field.
    """
    raw = unpack(data, MAX_RADIO_BYTES)
    if type(raw) is not list or len(raw) < 6:
        raise WireError("radio", "an array of at least 6 items is expected")
    version(raw[0])
    kind = raw[1]
    sender = integer(raw[2], 0, MAX_AGENT_ID, "radio.sender")
    counter = integer(raw[3], 0, MAX_STEP, "radio.counter")
    x_cm = integer(raw[4], -MAX_ABS_CM, MAX_ABS_CM, "radio.x_cm")
    y_cm = integer(raw[5], -MAX_ABS_CM, MAX_ABS_CM, "radio.y_cm")
    if kind == MEMBER:
        array(raw, 14, "radio")
        return Member(
            sender,
            counter,
            x_cm,
            y_cm,
            boolean(raw[6], "radio.orphan"),
            _path(raw[7], sender),
            integer(raw[8], 0, MAX_STEP, "radio.pulse"),
            integer(raw[9], 0, MAX_SCORE, "radio.score"),
            tuple([_descendant(row) for row in arrays(raw[10], MAX_TABLE, "radio.table")]),
            tuple([_sighting(row) for row in arrays(raw[11], MAX_EVENTS, "radio.events")]),
            tuple([_gone(row) for row in arrays(raw[12], MAX_GONE, "radio.gone")]),
            _order(raw[13]),
        )
    if kind == ATTENDING:
        array(raw, 9, "radio")
        return Attending(
            sender,
            counter,
            x_cm,
            y_cm,
            integer(raw[6], 0, MAX_ID, "radio.event"),
            integer(raw[7], -MAX_ABS_CM, MAX_ABS_CM, "radio.event_x_cm"),
            integer(raw[8], -MAX_ABS_CM, MAX_ABS_CM, "radio.event_y_cm"),
        )
    if kind in (RELOCATING, LEAVING):
        array(raw, 6, "radio")
        return (Relocating if kind == RELOCATING else Leaving)(sender, counter, x_cm, y_cm)
    raise WireError("radio.kind", f"{kind!r} is not one of 0 to 3")


def _path(raw: Any, sender: int) -> tuple[int, ...]:
    path = tuple(arrays(raw, MAX_PATH, "radio.path"))
    for agent in path:
        integer(agent, 0, MAX_AGENT_ID, "radio.path")
    if not path or path[-1] != sender:
        raise WireError("radio.path", "must end with the sender")
    if len(set(path)) != len(path):
        raise WireError("radio.path", "names an agent twice")
    return path


def _row(row: Any, highs: tuple[int, ...], field: str) -> list[int]:
    """A list of integers, each between 0 (or, for a coordinate, minus its bound) and its bound."""
    if type(row) is not list or len(row) != len(highs):
        raise WireError(field, f"{len(highs)} integers are expected")
    for value, high in zip(row, highs, strict=True):
        low = -MAX_ABS_CM if high == MAX_ABS_CM else 0
        if type(value) is not int or not low <= value <= high:
            raise WireError(field, f"{value!r} is not an integer from {low} to {high}")
    return row


_DESCENDANT_HIGHS = (MAX_AGENT_ID, MAX_AGENT_ID, MAX_ABS_CM, MAX_ABS_CM, MAX_SCORE)
_SIGHTING_HIGHS = (MAX_ID, MAX_ABS_CM, MAX_ABS_CM, MAX_AGE)
_GONE_HIGHS = (MAX_ID, MAX_AGE)
_ORDER_HIGHS = (MAX_AGENT_ID, MAX_ABS_CM, MAX_ABS_CM, MAX_STEP, MAX_TTL)


def _descendant(row: Any) -> Descendant:
    return Descendant(*_row(row, _DESCENDANT_HIGHS, "radio.table"))


def _sighting(row: Any) -> Sighting:
    return Sighting(*_row(row, _SIGHTING_HIGHS, "radio.events"))


def _gone(row: Any) -> Gone:
    return Gone(*_row(row, _GONE_HIGHS, "radio.gone"))


def _order(raw: Any) -> Order | None:
    return None if raw is None else Order(*_row(raw, _ORDER_HIGHS, "radio.order"))
