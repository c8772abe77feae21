"""Radio frames: all that an agent ever tells another agent.

They are MessagePack arrays, since their bytes count on the air; rows stand one after the other in flat
arrays. Positions are whole centimetres in the world frame. At most one frame per agent and step; who has
nothing to say is silent.
"""

import struct
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import chain, cycle
from typing import Any, NamedTuple, NoReturn

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


_HEAD = ("radio.sender", "radio.counter", "radio.x_cm", "radio.y_cm")
_HEAD_CODES = "HIii"
_DESCENDANT_CODES, _SIGHTING_CODES, _GONE_CODES, _ORDER_CODES = "HHiiH", "IiiB", "IB", "HiiIB"
_BOUNDS = {"B": (0, MAX_AGE), "H": (0, MAX_AGENT_ID), "I": (0, MAX_ID), "i": (-MAX_ABS_CM, MAX_ABS_CM)}
_ONLY_INT = {int}

_LAYOUTS = 4096
"""Layouts kept: a whole run has about 2,200. A hostile sender could have millions made, of up to 64 kB each."""

_flat = chain.from_iterable
_new: Any = tuple.__new__  # a NamedTuple's own constructors cost several times as much
_descendant: Callable[[tuple[int, ...]], Descendant] = partial(_new, Descendant)
sighting: Callable[[tuple[int, int, int, int]], Sighting] = partial(_new, Sighting)
"""A sighting of its four fields."""
_gone: Callable[[tuple[int, ...]], Gone] = partial(_new, Gone)


def encode_radio(frame: RadioFrame) -> bytes:
    """The frame's bytes on the air: `[version, kind, *fields]`, rows in flat arrays."""
    if type(frame) is Member:
        *head, table, events, gone, order = frame
        rows = (tuple(_flat(table)), tuple(_flat(events)), tuple(_flat(gone)))
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
        return _decode_member(array(raw, 14, "radio"))
    if kind == ATTENDING:
        _check_integers(raw[2:], "HIiiIii", *_HEAD, "radio.event", "radio.event_x_cm", "radio.event_y_cm")
        return Attending(*raw[2:])
    _check_integers(raw[2:], _HEAD_CODES, *_HEAD)
    return (Relocating if kind == RELOCATING else Leaving)(*raw[2:])


def _decode_member(raw: list[Any]) -> Member:
    """Decoding members' frames is most of an agent's work: all their integers are checked in one call."""
    _, _, sender, counter, x_cm, y_cm, orphan, path, pulse, score, table, events, gone, order = raw
    if not (
        type(path) is type(table) is type(events) is type(gone) is list
        and type(orphan) is bool
        and _fit(
            [sender, counter, x_cm, y_cm, pulse, score, *path, *table, *events, *gone],
            _member_layout(len(path), len(table), len(events), len(gone)),
        )
        and path[-1] == sender
        and len(set(path)) == len(path)
    ):
        _blame_member(raw)
    return Member(
        sender,
        counter,
        x_cm,
        y_cm,
        orphan,
        tuple(path),
        pulse,
        score,
        tuple(map(_descendant, zip(*[iter(table)] * 5, strict=False))),
        tuple(map(sighting, zip(*[iter(events)] * 4, strict=False))),
        tuple(map(_gone, zip(*[iter(gone)] * 2, strict=False))),
        None if order is None else _order(order),
    )


def _fit(values: list[Any], layout: struct.Struct | None) -> bool:
    """Whether all are integers (no bool) that their C types hold."""
    if layout is None or set(map(type, values)) != _ONLY_INT:
        return False
    try:
        layout.pack(*values)
    except struct.error:
        return False
    return True


@lru_cache(_LAYOUTS)
def _layout(codes: str) -> struct.Struct:
    return struct.Struct("<" + codes)


@lru_cache(_LAYOUTS)
def _member_layout(path: int, table: int, events: int, gone: int) -> struct.Struct | None:
    """The C types of a member's integers, given the lengths of its arrays; None where a length is wrong."""
    if not 1 <= path <= MAX_PATH:
        return None
    codes = _HEAD_CODES + "IH" + "H" * path
    for length, row, limit in (
        (table, _DESCENDANT_CODES, MAX_TABLE),
        (events, _SIGHTING_CODES, MAX_EVENTS),
        (gone, _GONE_CODES, MAX_GONE),
    ):
        if length % len(row) or length > limit * len(row):
            return None
        codes += row * (length // len(row))
    return _layout(codes)


def _check_integers(values: list[Any], codes: str, *fields: str) -> None:
    """Raise for the first value that is no integer of its C type; `fields` names each, or all of them."""
    if len(values) != len(codes):
        raise WireError("radio", f"{len(codes)} integers are expected, not {len(values)}")
    if not _fit(values, _layout(codes)):
        for value, code, field in zip(values, codes, cycle(fields)):
            integer(value, *_BOUNDS[code], field)


def _blame_member(raw: list[Any]) -> NoReturn:
    """Say what is wrong with a member's frame."""
    _, _, sender, counter, x_cm, y_cm, orphan, path, pulse, score, table, events, gone, _ = raw
    _check_integers([sender, counter, x_cm, y_cm], _HEAD_CODES, *_HEAD)
    boolean(orphan, "radio.orphan")
    _check_integers(arrays(path, MAX_PATH, "radio.path"), "H" * len(path), "radio.path")
    if not path or path[-1] != sender:
        raise WireError("radio.path", "must end with the sender")
    if len(set(path)) != len(path):
        raise WireError("radio.path", "names an agent twice")
    _check_integers([pulse, score], "IH", "radio.pulse", "radio.score")
    _check_rows(table, _DESCENDANT_CODES, MAX_TABLE, "radio.table")
    _check_rows(events, _SIGHTING_CODES, MAX_EVENTS, "radio.events")
    _check_rows(gone, _GONE_CODES, MAX_GONE, "radio.gone")
    raise WireError("radio", "breaks the protocol")


def _check_rows(raw: Any, codes: str, limit: int, field: str) -> None:
    """Rows of integers, one after the other in a flat array."""
    flat = arrays(raw, limit * len(codes), field)
    if len(flat) % len(codes):
        raise WireError(field, f"{len(flat)} items, a multiple of {len(codes)} is expected")
    _check_integers(flat, codes * (len(flat) // len(codes)), field)


def _order(raw: Any) -> Order:
    order = array(raw, len(_ORDER_CODES), "radio.order")
    _check_integers(order, _ORDER_CODES, "radio.order")
    return Order._make(order)
