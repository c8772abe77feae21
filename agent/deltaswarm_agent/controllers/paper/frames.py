"""The payload of the paper's radio frames, the only messages between agents (`FRAMES.md` has every byte).

Payloads are MessagePack arrays, to save bytes; rows are in flat arrays. Positions are whole centimetres in the world
frame. An agent without information sends nothing. The key of the frame identifies the sender, which is not in the
payload.
"""

from collections.abc import Callable
from functools import partial
from itertools import chain, cycle
from typing import Any, NamedTuple

from deltaswarm_wire.codec import (
    MAX_ABS_CM,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_RADIO_BYTES,
    WireError,
    all_fit,
    array,
    arrays,
    boolean,
    integer,
    keep,
    pack,
    shown,
    tuple_of,
    unpack,
)

MAX_PATH = 128
MAX_TABLE = 350
MAX_EVENTS = 16
MAX_GONE = 8
MAX_AGE = 0xFFFF
MAX_SCORE = 0xFFFF
MAX_TTL = 0xFF
MAX_ARM = 5

ATTENDING, MEMBER, RELOCATING, LEAVING = 0, 1, 2, 3


class Tried(NamedTuple):
    """What its sender knows of the structure that it follows: the place of that, and counts that fade (`bandit.py`)."""

    arm: int
    time_ds: int
    work_ds: int
    messages_milli: int


class Averages(NamedTuple):
    """How often walkers find events, by the kind of their legs, and how busy agents are (`finds.py`)."""

    random_finds_milli: int
    returning_finds_milli: int
    random_ds: int
    returning_ds: int
    """Time on such legs [0.1 s]."""
    busy_permille: int
    tried: Tried | None = None
    """With the rule `bandit` alone."""


class Attending(NamedTuple):
    """A free agent stands at an event and observes it (Baseline coordination algorithm)."""

    sender: int
    x_cm: int
    y_cm: int
    event: int
    event_x_cm: int
    event_y_cm: int
    averages: Averages | None = None


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


class RecruitmentOrder(NamedTuple):
    """A root tells a leaf where to go (Active Recruitment); relayed down while `ttl` lasts."""

    leaf: int
    x_cm: int
    y_cm: int
    number: int
    ttl: int


class Member(NamedTuple):
    """An agent in a tree. The path runs from the root to the sender, so its length less 1 is the level.

    On the air the path ends with the parent: the sender is known.
    """

    sender: int
    x_cm: int
    y_cm: int
    orphan: bool
    path: tuple[int, ...]
    pulse: int
    score: int
    table: tuple[Descendant, ...]
    events: tuple[Sighting, ...]
    gone: tuple[Gone, ...]
    order: RecruitmentOrder | None
    averages: Averages | None = None


class Relocating(NamedTuple):
    """A travelling recruited leaf."""

    sender: int
    x_cm: int
    y_cm: int


class Leaving(NamedTuple):
    """An agent that has just left its tree, and with it its whole subtree (Dissolution)."""

    sender: int
    x_cm: int
    y_cm: int


PaperFrame = Attending | Member | Relocating | Leaving

_KINDS = (Attending, Member, Relocating, Leaving)
_KIND_OF = {cls: kind for kind, cls in enumerate(_KINDS)}

_PLACE_CODES, _ATTENDING_CODES = "ii", "iiIii"
_ATTENDING_FIELDS = [f"frame.{field}" for field in Attending._fields[1:-1]]
_DESCENDANT_CODES, _SIGHTING_CODES, _GONE_CODES, _ORDER_CODES = "HHiiH", "IiiH", "IH", "HiiIB"
_AVERAGES_CODES, _TRIED_CODES = "IIIIH", "HIII"
_WITH_AVERAGES = {ATTENDING: 7, MEMBER: 12}
"""Items of a payload that ends with averages."""
_BOUNDS = {"B": (0, MAX_TTL), "H": (0, MAX_AGENT_ID), "I": (0, MAX_ID), "i": (-MAX_ABS_CM, MAX_ABS_CM)}
"""The C types that the integers fit, and their bounds."""

_flat = chain.from_iterable
_descendant: Callable[[tuple[int, ...]], Descendant] = partial(tuple_of, Descendant)
sighting: Callable[[tuple[int, int, int, int]], Sighting] = partial(tuple_of, Sighting)
"""A sighting of its four fields."""
_gone: Callable[[tuple[int, ...]], Gone] = partial(tuple_of, Gone)

KEPT = 8
"""Frames kept of each sender that this process encodes for."""

encoded: dict[int, dict[bytes, PaperFrame]] = {}
"""By sender and payload: receivers in the same process need not decode again."""


def encode(frame: PaperFrame) -> bytes:
    """The frame's payload: `[kind, *fields]`, rows in flat arrays; without averages, if there are none."""
    sender = frame.sender
    if type(frame) is Member:
        _, x_cm, y_cm, orphan, path, pulse, score, table, events, gone, order, averages = frame
        rows = (tuple(_flat(table)), tuple(_flat(events)), tuple(_flat(gone)))
        items: tuple[Any, ...] = (MEMBER, x_cm, y_cm, orphan, path[:-1], pulse, score, *rows, order)
        items = items if averages is None else (*items, _told(averages))
    else:
        items = (_KIND_OF[type(frame)], *frame[1:])
        if type(frame) is Attending:
            items = items[:-1] if frame.averages is None else (*items[:-1], _told(frame.averages))
    payload = pack(items, MAX_RADIO_BYTES)
    keep(encoded.setdefault(sender, {}), payload, frame, KEPT)
    return payload


def decode(sender: int, payload: bytes) -> PaperFrame:
    """Check and decode one frame of a sender. Raises WireError."""
    kept = encoded.get(sender)
    if kept is not None and payload in kept:
        return kept[payload]
    raw = unpack(payload, MAX_RADIO_BYTES)
    if type(raw) is not list or len(raw) < 3:
        raise WireError("frame", "be an array of at least 3 items", shown(raw))
    kind = integer(raw[0], ATTENDING, LEAVING, "frame.kind")
    averages = _averages(raw.pop()) if len(raw) == _WITH_AVERAGES.get(kind) else None
    if kind == MEMBER:
        return _decode_member(sender, array(raw, 11, "frame"), averages)
    if kind == ATTENDING:
        _check_integers(raw[1:], _ATTENDING_CODES, *_ATTENDING_FIELDS)
        return Attending._make((sender, *raw[1:], averages))
    _check_integers(raw[1:], _PLACE_CODES, "frame.x_cm", "frame.y_cm")
    return (Relocating if kind == RELOCATING else Leaving)(sender, *raw[1:])


def _told(averages: Averages) -> tuple[Any, ...]:
    return averages if averages.tried is not None else averages[:-1]


def _averages(raw: Any) -> Averages:
    tried = None
    if type(raw) is list and len(raw) > len(_AVERAGES_CODES):
        tried = Tried._make(array(raw.pop(), len(_TRIED_CODES), "frame.averages.tried"))
        _check_integers([*tried], _TRIED_CODES, "frame.averages.tried")
        integer(tried.arm, 0, MAX_ARM, "frame.averages.tried.arm")
    _check_integers(array(raw, len(_AVERAGES_CODES), "frame.averages"), _AVERAGES_CODES, "frame.averages")
    integer(raw[-1], 0, 1000, "frame.averages.busy_permille")
    return Averages._make((*raw, tried))


def _decode_member(sender: int, raw: list[Any], averages: Averages | None) -> Member:
    _, x_cm, y_cm, orphan, above, pulse, score, table, events, gone, order = raw
    _check_integers([x_cm, y_cm, pulse, score], "iiIH", "frame.x_cm", "frame.y_cm", "frame.pulse", "frame.score")
    boolean(orphan, "frame.orphan")
    _check_integers(above, "H" * len(arrays(above, MAX_PATH - 1, "frame.path")), "frame.path")
    path = (*above, sender)
    if len(set(path)) != len(path):
        raise WireError("frame.path", "name each agent once", list(path))
    return Member(
        sender,
        x_cm,
        y_cm,
        orphan,
        path,
        pulse,
        score,
        _rows(table, _descendant, _DESCENDANT_CODES, MAX_TABLE, "frame.table"),
        _rows(events, sighting, _SIGHTING_CODES, MAX_EVENTS, "frame.events"),
        _rows(gone, _gone, _GONE_CODES, MAX_GONE, "frame.gone"),
        None if order is None else _order(order),
        averages,
    )


def _rows(raw: Any, row: Callable[[Any], Any], codes: str, limit: int, field: str) -> tuple[Any, ...]:
    flat = arrays(raw, limit * len(codes), field)
    if not flat:
        return ()
    count, left = divmod(len(flat), len(codes))
    if left:
        raise WireError(field, f"have a multiple of {len(codes)} items", len(flat))
    _check_integers(flat, codes * count, field)
    return tuple(map(row, zip(*[iter(flat)] * len(codes), strict=True)))


def _order(raw: Any) -> RecruitmentOrder:
    _check_integers(array(raw, len(_ORDER_CODES), "frame.order"), _ORDER_CODES, "frame.order")
    return RecruitmentOrder._make(raw)


def _check_integers(values: list[Any], codes: str, *fields: str) -> None:
    """Raise for the first value that is no integer of its C type; `fields` names each, or all of them."""
    if len(values) != len(codes):
        raise WireError("frame", f"have {len(codes)} integers", len(values))
    if all_fit(values, codes):
        return
    for value, code, field in zip(values, codes, cycle(fields)):
        integer(value, *_BOUNDS[code], field)
