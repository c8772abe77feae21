"""Radio frames: all that an agent ever tells another agent.

They are MessagePack arrays, since their bytes count on the air; rows stand one after the other in flat
arrays. Positions are whole centimetres in the world frame. At most one frame per agent and step; who has
nothing to say is silent.
"""

import struct
from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import chain, cycle
from typing import Any, Generic, NamedTuple, TypeVar, cast

from deltaswarm_wire.codec import (
    MAX_ABS_CM,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_RADIO_BYTES,
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
MAX_TABLE = 350
MAX_EVENTS = 16
MAX_GONE = 8
MAX_AGE = 0xFF
MAX_SCORE = 0xFFFF
MAX_TTL = 0xFF

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


R = TypeVar("R", Descendant, Sighting, Gone)


class _Rows(Generic[R]):
    """Rows of integers of one kind, written one after the other into a flat array.

    `codes` are the C types of a row's integers as `struct` names them: one call then checks the ranges of
    all rows, which matters since this is most of an agent's work.
    """

    def __init__(self, kind: type[R], codes: str, limit: int, field: str) -> None:
        self._codes = codes
        self._width = len(codes)
        self._limit = limit
        self._field = field
        self._make: Callable[[tuple[int, ...]], R] = partial(cast(Any, tuple.__new__), kind)

    def encode(self, rows: Sequence[R]) -> list[int]:
        return list(chain.from_iterable(rows))

    def decode(self, raw: Any) -> tuple[R, ...]:
        if raw == [] and type(raw) is list:
            return ()
        flat = arrays(raw, self._limit * self._width, self._field)
        if len(flat) % self._width:
            raise WireError(self._field, f"{len(flat)} items, a multiple of {self._width} is expected")
        check_integers(flat, self._codes * (len(flat) // self._width), self._field)
        return tuple(map(self._make, zip(*[iter(flat)] * self._width, strict=True)))


_TABLE = _Rows(Descendant, "HHiiH", MAX_TABLE, "radio.table")
_EVENTS = _Rows(Sighting, "IiiB", MAX_EVENTS, "radio.events")
_GONE = _Rows(Gone, "IB", MAX_GONE, "radio.gone")
_ORDER_CODES = "HiiIB"

_HEAD = ("radio.sender", "radio.counter", "radio.x_cm", "radio.y_cm")
_ONLY_INT = {int}
_BOUNDS = {"B": (0, 0xFF), "H": (0, MAX_AGENT_ID), "I": (0, MAX_ID), "i": (-MAX_ABS_CM, MAX_ABS_CM)}


@cache
def _packer(codes: str) -> struct.Struct:
    return struct.Struct("<" + codes)


def check_integers(values: list[Any], codes: str, *fields: str) -> None:
    """Whether each value is an integer (no bool) that its C type holds; `fields` names each, or all of them.

    Raises:
        WireError: for the first that is not.
    """
    if set(map(type, values)) == _ONLY_INT:
        try:
            _packer(codes).pack(*values)
        except struct.error:
            pass
        else:
            return
    for value, code, field in zip(values, codes, cycle(fields)):
        integer(value, *_BOUNDS[code], field)


def encode_radio(frame: RadioFrame) -> bytes:
    """The frame's bytes on the air: `[version, kind, *fields]`, rows in flat arrays."""
    if type(frame) is Member:
        *head, table, events, gone, order = frame
        rows = _TABLE.encode(table), _EVENTS.encode(events), _GONE.encode(gone)
        return pack((PROTOCOL_VERSION, MEMBER, *head, *rows, order), MAX_RADIO_BYTES)
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
    kind = integer(raw[1], ATTENDING, LEAVING, "radio.kind")
    if kind == MEMBER:
        array(raw, 14, "radio")
        check_integers([*raw[2:6], raw[8], raw[9]], "HIiiIH", *_HEAD, "radio.pulse", "radio.score")
        sender, counter, x_cm, y_cm = raw[2:6]
        return Member(
            sender,
            counter,
            x_cm,
            y_cm,
            boolean(raw[6], "radio.orphan"),
            _path(raw[7], sender),
            raw[8],
            raw[9],
            _TABLE.decode(raw[10]),
            _EVENTS.decode(raw[11]),
            _GONE.decode(raw[12]),
            None if raw[13] is None else _order(raw[13]),
        )
    if kind == ATTENDING:
        array(raw, 9, "radio")
        check_integers(raw[2:], "HIiiIii", *_HEAD, "radio.event", "radio.event_x_cm", "radio.event_y_cm")
        return Attending(*raw[2:])
    array(raw, 6, "radio")
    check_integers(raw[2:], "HIii", *_HEAD)
    return (Relocating if kind == RELOCATING else Leaving)(*raw[2:])


def _path(raw: Any, sender: int) -> tuple[int, ...]:
    path = arrays(raw, MAX_PATH, "radio.path")
    check_integers(path, "H" * len(path), "radio.path")
    if not path or path[-1] != sender:
        raise WireError("radio.path", "must end with the sender")
    if len(set(path)) != len(path):
        raise WireError("radio.path", "names an agent twice")
    return tuple(path)


def _order(raw: Any) -> Order:
    order = array(raw, len(_ORDER_CODES), "radio.order")
    check_integers(order, _ORDER_CODES, "radio.order")
    return Order._make(order)
