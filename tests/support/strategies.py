"""Hypothesis strategies for everything that travels, and for what a stranger might send instead."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import msgpack
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper import frames as paper
from deltaswarm_scenario import truth
from deltaswarm_wire import envelope, messages
from deltaswarm_wire import operator_messages as om
from deltaswarm_wire.codec import MAX_ABS_CM, MAX_ABS_M, MAX_AGENT_ID, MAX_ID, MAX_STEP, WireError

agents = st.integers(0, MAX_AGENT_ID)
ids = st.integers(0, MAX_ID)
steps = st.integers(0, MAX_STEP)
metres = st.floats(-MAX_ABS_M, MAX_ABS_M)
centimetres = st.integers(-MAX_ABS_CM, MAX_ABS_CM)
times_s = st.floats(0.0, messages.MAX_TIME_S)
speeds_mps = st.floats(-messages.MAX_SPEED_MPS, messages.MAX_SPEED_MPS)
rates_hz = st.floats(0.0, MAX_ID)
scores = st.integers(0, paper.MAX_SCORE)
ages = st.integers(0, paper.MAX_AGE)


def tuples_of(strategy: st.SearchStrategy[Any], most: int) -> st.SearchStrategy[tuple[Any, ...]]:
    return st.lists(strategy, max_size=most).map(tuple)


events = st.builds(messages.Event, ids, metres, metres)
frames = st.builds(
    messages.Frame,
    steps,
    times_s,
    st.booleans(),
    metres,
    metres,
    tuples_of(st.tuples(metres, metres), 4),
    tuples_of(events, 6),
    tuples_of(st.tuples(agents, st.binary(max_size=40)), 6),
)
roles = st.sampled_from(["free", "attending", "root", "member", "orphan", "leaving", "relocating", "my own role 1"])
nobody = st.just(messages.NOBODY)
deltas = st.integers(0, messages.MAX_DELTA)
standings = st.builds(messages.TreeStatus, roles, agents, agents | nobody, agents | nobody, deltas)


@st.composite
def acts_of(draw: st.DrawFn) -> messages.Act:
    step = draw(steps)
    until = draw(st.integers(step + 1, MAX_STEP + 1))
    velocity = draw(st.tuples(speeds_mps, speeds_mps))
    return messages.Act(step, *velocity, draw(tuples_of(ids, 6)), draw(standings), until)


acts = acts_of()
samples = st.builds(
    envelope.Sample, ids, st.binary(max_size=60), tuples_of(st.binary(max_size=20), envelope.MAX_COMMANDS)
)
reports = st.builds(
    om.Report,
    agents,
    steps,
    steps,
    roles,
    metres,
    metres,
    agents,
    tuples_of(events, 6),
    tuples_of(st.builds(om.ReportedMember, agents, agents, centimetres, centimetres), 6),
    tuples_of(st.builds(om.Answer, ids, st.integers(om.HEARD, om.REFUSED)), 4),
    deltas,
)
printable = st.text(st.characters(categories=["L", "M", "N", "P", "S"], include_characters=" "), max_size=20)
healths = st.builds(om.Health, printable)
clocks = st.builds(om.Clock, steps, times_s, st.booleans())
workloads = st.builds(om.Workload, steps, times_s, ids, ids, rates_hz, rates_hz, times_s, ids, ids, ids)
statuses = st.builds(
    om.Status, steps, steps, times_s, agents, agents, times_s, ids, ids, st.sampled_from(om.STATUS_PHASES)
)

_heads = (agents, centimetres, centimetres)
tried = st.builds(paper.Tried, st.integers(0, paper.MAX_ARM), ids, ids, ids)
averages = st.builds(paper.Averages, ids, ids, ids, ids, st.integers(0, 1000), st.none() | tried)
attendings = st.builds(paper.Attending, *_heads, ids, centimetres, centimetres, averages)
descendants = st.builds(paper.Descendant, agents, agents, centimetres, centimetres, scores)
sightings = st.builds(paper.Sighting, ids, centimetres, centimetres, ages)
departures = st.builds(paper.Gone, ids, ages)
orders = st.builds(paper.RecruitmentOrder, agents, centimetres, centimetres, steps, st.integers(0, paper.MAX_TTL))


@st.composite
def members(draw: st.DrawFn) -> paper.Member:
    path = draw(st.lists(agents, min_size=1, max_size=6, unique=True))
    return paper.Member(
        path[-1],
        draw(centimetres),
        draw(centimetres),
        draw(st.booleans()),
        tuple(path),
        draw(steps),
        draw(scores),
        draw(tuples_of(descendants, 4)),
        draw(tuples_of(sightings, 4)),
        draw(tuples_of(departures, 4)),
        draw(st.none() | orders),
        draw(averages),
    )


paper_frames = st.one_of(
    members(),
    members().map(lambda frame: frame._replace(averages=None)),
    attendings,
    attendings.map(lambda frame: frame._replace(averages=None)),
    st.builds(paper.Relocating, *_heads),
    st.builds(paper.Leaving, *_heads),
)

_points = st.builds(
    truth.AgentState,
    agents,
    metres,
    metres,
    roles | st.just(truth.DEAD),
    agents,
    agents | nobody,
    agents | nobody,
    deltas,
    **dict.fromkeys(truth.AgentState._fields[8:], st.none()),
)
_fields = st.sampled_from([truth.BODY_FIELDS, truth.AgentState._fields[8:]])
_states = _fields.flatmap(lambda names: st.fixed_dictionaries(dict.fromkeys(names, st.floats(-10.0, 10.0))))
bodies = _points | st.builds(lambda body, state: body._replace(**state), _points, _states)
event_states = st.builds(truth.EventState, ids, metres, metres, times_s, *[st.none() | times_s] * 3, times_s)
step_records = st.builds(
    truth.StepRecord,
    **{name: ids for name, hint in truth.StepRecord.__annotations__.items() if hint is int},
    metrics=st.just({}),
    frames_dropped=st.tuples(*[ids] * 12).map(lambda drops: dict(zip(truth.DROP_REASONS, drops, strict=True))),
    reports_dropped=st.tuples(*[ids] * 9).map(lambda drops: dict(zip(truth.UPLINK_REASONS, drops, strict=True))),
    time_s=times_s,
    covered_area_m2=st.none() | st.floats(0.0, MAX_ABS_M**2),
    roots_from_densest_m=st.none() | st.floats(0.0, MAX_ABS_M),
    delta=st.none() | st.floats(0.0, messages.MAX_DELTA),
)
_links = tuples_of(st.tuples(agents, agents), 4)
_foreign_drops = st.sampled_from([{}, {"fog": 3}, {"smoke": 0, "fog": 7}])
_own_numbers = st.dictionaries(st.text(max_size=8), st.none() | st.floats(-1e300, 1e300), max_size=3)
_any_step_records = st.builds(
    lambda record, more, own: record._replace(frames_dropped=record.frames_dropped | more, metrics=own),
    step_records,
    _foreign_drops,
    _own_numbers,
)
"""With what plug-ins add: causes of drops, and a controller's own numbers."""
truths = st.builds(
    truth.Truth, steps, times_s, tuples_of(bodies, 4), tuples_of(event_states, 4), _links, _any_step_records
)


@dataclass(frozen=True)
class Codec:
    """One kind of message: how to make one, encode and decode it, and where its fields stand in the bytes."""

    name: str
    strategy: st.SearchStrategy[Any]
    encode: Callable[[Any], bytes]
    decode: Callable[[bytes], Any]
    places: dict[str, int | str]
    optional: tuple[str, ...] = ()
    """Fields that a message may leave out."""

    def __str__(self) -> str:
        return self.name


def _in_array(fields: tuple[str, ...], first: int) -> dict[str, int | str]:
    return {name: index for index, name in enumerate(fields, first)}


def _in_map(fields: tuple[str, ...]) -> dict[str, int | str]:
    return {name: name for name in fields}


_FELT = ("bumped", "blocked")
_FRAME_FIELDS = messages.Frame._fields[: -len(_FELT)]
_CODEC = (messages.encode_frame, messages.decode_frame)
FRAME = Codec("frame", frames, *_CODEC, _in_array(_FRAME_FIELDS, first=1))
FELT_FRAME = Codec(
    "frame",
    st.builds(lambda frame, felt: frame._replace(**felt), frames, st.sampled_from([{name: True} for name in _FELT])),
    *_CODEC,
    _in_array(messages.Frame._fields, first=1),
)
"""Of a body that touched something."""
_ACT_FIELDS = ("step", "vx_mps", "vy_mps", "observed", *messages.TreeStatus._fields, "until")
ACT = Codec("act", acts, messages.encode_act, messages.decode_act, _in_array(_ACT_FIELDS, first=1))
REPORT = Codec(
    "report",
    reports,
    om.encode_report,
    om.decode_report,
    _in_map(om.Report._fields),
    optional=("members", "answers", "delta"),
)
HEALTH = Codec("health", healths, om.encode_health, om.decode_health, _in_map(om.Health._fields))
CLOCK = Codec("clock", clocks, om.encode_clock, om.decode_clock, _in_map(om.Clock._fields))
WORKLOAD = Codec("workload", workloads, om.encode_workload, om.decode_workload, _in_map(om.Workload._fields))
STATUS = Codec("status", statuses, om.encode_status, om.decode_status, _in_map(om.Status._fields))
FORWARDED = Codec(
    "forwarded",
    st.builds(om.Forwarded, ids, steps, st.binary(max_size=60)),
    om.encode_forwarded,
    om.decode_forwarded,
    {"sequence": 1, "step": 2},
)
SENDER = 7
"""Of the paper's frames, which do not say it."""


def _decode_paper(data: bytes) -> paper.PaperFrame:
    paper.encoded.clear()  # else a frame that was encoded here would not be decoded at all
    return paper.decode(SENDER, data)


def _from_sender(frame: Any) -> Any:
    """The same frame, sent by SENDER."""
    if isinstance(frame, paper.Member):
        path = (*[agent for agent in frame.path[:-1] if agent != SENDER], SENDER)
        return frame._replace(sender=SENDER, path=path)
    return frame._replace(sender=SENDER)


RADIO = Codec("radio", samples, envelope.encode_sample, envelope.decode_sample, {"counter": 1, "payload": 2})
PAPER = Codec("frame", paper_frames.map(_from_sender), paper.encode, _decode_paper, {"kind": 0})
MEMBER = Codec(
    "frame", members().map(_from_sender), paper.encode, _decode_paper, _in_array(paper.Member._fields[1:], 1)
)
ATTENDING = Codec(
    "frame", attendings.map(_from_sender), paper.encode, _decode_paper, _in_array(paper.Attending._fields[1:], 1)
)
TRUTH = Codec("truth", truths, truth.encode_truth, truth.decode_truth, _in_map(truth.Truth._fields))

MESSAGES = (FRAME, FELT_FRAME, ACT, REPORT, FORWARDED, HEALTH, CLOCK, WORKLOAD, STATUS)
CODECS = (*MESSAGES, RADIO, PAPER, MEMBER, ATTENDING, TRUTH)

NASTY: tuple[Any, ...] = (
    None,
    True,
    False,
    float("nan"),
    float("inf"),
    float("-inf"),
    1.5,
    -1,
    2**63,
    2**64 - 1,
    -(2**63),
    "",
    "x" * 300,
    b"\xff",
    [],
    [[]],
    [None] * 7,
    {},
    {"v": 1},
    msgpack.Timestamp(1, 2),
    msgpack.ExtType(5, b"x"),
)


def nested(depth: int) -> bytes:
    """Arrays within arrays, deeper than msgpack's own encoder goes."""
    return b"\x91" * depth + b"\x01"


def repacked(data: bytes, place: int | str, value: Any) -> bytes:
    """A message with one field of its top level put in the place of another value."""
    raw = msgpack.unpackb(data)
    raw[place] = value
    return bytes(msgpack.packb(raw))


def _slots(raw: Any, found: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """Every (container, key) within a decoded value."""
    keys = range(len(raw)) if type(raw) is list else list(raw) if type(raw) is dict else ()
    for key in keys:
        found.append((raw, key))
        _slots(raw[key], found)
    return found


@st.composite
def reshaped(draw: st.DrawFn, codec: Codec) -> bytes:
    """A valid message with a few of its values, at any depth, replaced, dropped, doubled or swapped."""
    raw = msgpack.unpackb(codec.encode(draw(codec.strategy)))
    for _ in range(draw(st.integers(1, 3))):
        slots = _slots(raw, [])
        if not slots:
            break
        container, key = draw(st.sampled_from(slots))
        match draw(st.sampled_from(("replace", "drop", "double", "swap", "extra"))):
            case "replace":
                container[key] = deepcopy(draw(st.sampled_from(NASTY)))
            case "drop":
                del container[key]
            case "double" if type(container) is list:
                container.insert(key, deepcopy(container[key]))
            case "swap":
                other, there = draw(st.sampled_from(slots))
                if _is_apart(container[key], other) and _is_apart(other[there], container):
                    container[key], other[there] = other[there], container[key]
            case _ if type(container) is dict:
                container["extra"] = 1
            case _:
                container.append(deepcopy(draw(st.sampled_from(NASTY))))
    return bytes(msgpack.packb(raw))


def _is_apart(value: Any, container: Any) -> bool:
    """Whether a container is not within a value: else a swap would tie a knot."""
    return value is not container and all(inner[key] is not container for inner, key in _slots(value, []))


@st.composite
def damaged(draw: st.DrawFn, codec: Codec) -> bytes:
    """A valid message with its bytes flipped, cut, extended, doubled in part, or mixed with another."""
    data = bytearray(codec.encode(draw(codec.strategy)))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(data)))
        match draw(st.sampled_from(("flip", "cut", "extend", "repeat", "splice", "set"))):
            case "flip" if at < len(data):
                data[at] ^= 1 << draw(st.integers(0, 7))
            case "set" if at < len(data):
                data[at] = draw(st.integers(0, 255))
            case "cut":
                del data[at:]
            case "repeat":
                data[at:at] = data[at : at + draw(st.integers(0, 8))]
            case "splice":
                data[at:] = codec.encode(draw(codec.strategy))[at:]
            case _:
                data += draw(st.binary(max_size=9))
    return bytes(data)


def tables_of(names: list[str], values: list[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Tables as TOML might give them, with keys that are known in the wrong places, and anything for values."""
    keys = st.sampled_from(names)
    scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text("ab", max_size=3)
    anything = st.recursive(
        scalars | st.sampled_from(values),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=4),
        max_leaves=12,
    )
    return st.dictionaries(keys, anything, max_size=6)


def strange(codec: Codec) -> st.SearchStrategy[bytes]:
    """What a broken or hostile sender might put on a key."""
    return st.one_of(reshaped(codec), damaged(codec), st.binary(max_size=60))


def complaint(codec: Codec, data: bytes) -> WireError | None:
    """What a decoder has against a message; None if it takes it, and would take it again."""
    try:
        message = codec.decode(data)
    except WireError as error:
        return error
    assert codec.decode(codec.encode(message)) == message
    return None


def assert_decodes_or_complains(codec: Codec, data: bytes) -> None:
    """A decoder gives a message, or a WireError that names a field. Nothing else."""
    error = complaint(codec, data)
    if error is not None:
        known = {"sample", "version", codec.name, *(f"{codec.name}.{field}" for field in codec.places)}
        assert any(error.field == name or error.field.startswith(f"{name}.") for name in known), error.field
        assert str(error).startswith(f"{error.field} must ")
        assert len(str(error)) < 2500


def assert_field_is_named(codec: Codec, message: Any, field: str, value: Any) -> None:
    """A wrong value of one field is refused, if at all, by that field's name; an empty map always is."""
    error = complaint(codec, repacked(codec.encode(message), codec.places[field], value))
    if error is None:
        assert value != {}
    else:
        assert error.field == f"{codec.name}.{field}" or error.field.startswith(f"{codec.name}.{field}.")
