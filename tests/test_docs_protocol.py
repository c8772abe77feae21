"""The protocol page: its examples are what the code sends, its numbers are the code's numbers.

`python -m tests.test_docs_protocol` prints the examples anew.
"""

import inspect
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from deltaswarm_wire.radio import Attending, Descendant, Gone, Leaving, Member, Order, Relocating, Sighting

from deltaswarm_agent import beliefs, core, hearing, process, recruitment, tree
from deltaswarm_wire import access, codec, keys, messages, radio, session, settings
from deltaswarm_wire.keys import Keys
from deltaswarm_wire.messages import Act, Clock, Event, Frame, Health, Report, Status, Workload
from tests import test_agent_protocol_machine as machine

HEX_COLUMNS = 47

PAGE = Path(__file__).parent.parent / "agent" / "PROTOCOL.md"
TEXT = PAGE.read_text()

SOURCES = (
    access,
    codec,
    messages,
    radio,
    session,
    settings,
    core,
    hearing,
    tree,
    beliefs,
    recruitment,
    process,
    machine,
)


@dataclass(frozen=True)
class Shape:
    """What the parts of a message are called: a field, or an array of fields, of flat or of nested rows."""

    name: str
    parts: tuple["Shape | str", ...] = ()
    rows: str = ""


def _message(name: str, fields: tuple[str, ...], **arrays: Shape) -> Shape:
    return Shape(name, tuple(arrays.get(field, field) for field in fields))


_EVENTS = Shape("events", Event._fields, "nested")
_RADIO = ("version", "kind")
_MEMBER = _message(
    "radio",
    (*_RADIO, *Member._fields),
    path=Shape("path"),
    table=Shape("table", Descendant._fields, "flat"),
    events=Shape("events", Sighting._fields, "flat"),
    gone=Shape("gone", Gone._fields, "flat"),
    order=Shape("order", Order._fields),
)

LEAVING = Leaving(9, 77, 5000, 4200)

EXAMPLES: dict[str, tuple[Any, Callable[[Any], bytes], Callable[[bytes], Any], Shape]] = {
    "frame": (
        Frame(12, 12.0, False, 50.25, 48.0, (Event(3, 52.5, 47.0),), (radio.encode_radio(LEAVING),)),
        messages.encode_frame,
        messages.decode_frame,
        _message("frame", ("version", *Frame._fields), events=_EVENTS, heard=Shape("heard")),
    ),
    "act": (
        Act(12, 0.0, -1.0, (3,)),
        messages.encode_act,
        messages.decode_act,
        _message("act", ("version", *Act._fields), observed=Shape("observed")),
    ),
    "report": (
        Report(4, 31, 12, "root", 50.25, 48.0, 2, (Event(3, 52.5, 47.0),)),
        messages.encode_report,
        messages.decode_report,
        _message("report", Report._fields, events=_EVENTS),
    ),
    "health": (
        Health("no battery"),
        messages.encode_health,
        messages.decode_health,
        _message("health", Health._fields),
    ),
    "attending": (
        Attending(4, 30, 5250, 4700, 3, 5250, 4700),
        radio.encode_radio,
        radio.decode_radio,
        _message("radio", (*_RADIO, *Attending._fields)),
    ),
    "member": (
        Member(
            *(6, 250, 5820, 4800, False, (4, 6), 412, 1),
            (Descendant(9, 6, 6400, 4500, 0),),
            (Sighting(3, 5250, 4700, 0), Sighting(5, 6100, 4950, 2)),
            (Gone(2, 7),),
            Order(9, 5300, 5400, 2, 11),
        ),
        radio.encode_radio,
        radio.decode_radio,
        _MEMBER,
    ),
    "relocating": (
        Relocating(9, 76, 6213, 4631),
        radio.encode_radio,
        radio.decode_radio,
        _message("radio", (*_RADIO, *Relocating._fields)),
    ),
    "leaving": (
        LEAVING,
        radio.encode_radio,
        radio.decode_radio,
        _message("radio", (*_RADIO, *Leaving._fields)),
    ),
    "clock": (
        Clock(12, 12.0, False),
        messages.encode_clock,
        messages.decode_clock,
        _message("clock", Clock._fields),
    ),
    "status": (
        Status(12, 9000, 12.0, 25, 11, 24.5, "running"),
        messages.encode_status,
        messages.decode_status,
        _message("status", Status._fields),
    ),
    "workload": (
        Workload(12, 12.0, 4, 4, 4.0, 3.5, 0.0, 0, 0, 0),
        messages.encode_workload,
        messages.decode_workload,
        _message("workload", Workload._fields),
    ),
}

_NUMBERS = {0xCC: ">B", 0xCD: ">H", 0xCE: ">I", 0xCF: ">Q", 0xD0: ">b", 0xD1: ">h", 0xD2: ">i", 0xD3: ">q", 0xCB: ">d"}
_CONSTANTS = {0xC0: "nil", 0xC2: "false", 0xC3: "true"}


class Annotator:
    """Walks through MessagePack bytes; one line for each value, with its bytes and its name."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def lines(self, shape: Shape) -> Iterator[str]:
        """All lines of the one message."""
        yield from self._value(shape.name, shape)
        assert self._at == len(self._data)

    def _take(self, count: int) -> bytes:
        self._at += count
        return self._data[self._at - count : self._at]

    @staticmethod
    def _line(data: bytes, text: str) -> str:
        return f"{data.hex(' '):<{HEX_COLUMNS}}  {text}"

    def _value(self, name: str, shape: Shape | None) -> Iterator[str]:
        head = self._take(1)
        code = head[0]
        if 0x80 <= code <= 0x8F:
            yield self._line(head, f"{name}: map of {code & 15}")
            yield from self._map(code & 15, shape)
        elif 0x90 <= code <= 0x9F:
            yield self._line(head, f"{name}: array of {code & 15}")
            for index in range(code & 15):
                yield from self._value(*self._part(name, shape, index))
        elif 0xA0 <= code <= 0xBF:
            text = self._take(code & 31)
            yield self._line(head + text, f'{name}: "{text.decode()}"')
        elif code == 0xC4:
            length = self._take(1)
            yield self._line(head + length, f"{name}: {length[0]} bytes")
            yield self._line(self._take(length[0]), "its bytes, as sent by its sender")
        elif code in _NUMBERS:
            body = self._take(struct.calcsize(_NUMBERS[code]))
            yield self._line(head + body, f"{name}: {struct.unpack(_NUMBERS[code], body)[0]}")
        elif code in _CONSTANTS:
            yield self._line(head, f"{name}: {_CONSTANTS[code]}")
        else:
            assert code < 0x80 or code >= 0xE0, hex(code)
            yield self._line(head, f"{name}: {code if code < 0x80 else code - 0x100}")

    def _map(self, count: int, shape: Shape | None) -> Iterator[str]:
        assert shape is not None
        named = {part.name if isinstance(part, Shape) else part: part for part in shape.parts}
        for _ in range(count):
            key = self._take(1 + (self._data[self._at] & 31))
            name = key[1:].decode()
            part = named.get(name)
            first, *rest = self._value(name, part if isinstance(part, Shape) else None)
            yield self._line(key, f'"{name}"')
            yield first
            yield from rest

    @staticmethod
    def _part(name: str, shape: Shape | None, index: int) -> tuple[str, Shape | None]:
        if shape is None or not shape.parts:
            return f"{name} {index}", None
        if shape.rows == "nested":
            return f"{name} {index}", Shape(name, shape.parts)
        if shape.rows == "flat":
            row, column = divmod(index, len(shape.parts))
            return f"{name} {row} {shape.parts[column]}", None
        part = shape.parts[index]
        return (part.name, part) if isinstance(part, Shape) else (part, None)


def example(name: str) -> str:
    """An annotated example, as it stands in the page."""
    message, encode, _, shape = EXAMPLES[name]
    lines = "\n".join(Annotator(encode(message)).lines(shape))
    return f"```hexdump {name}\n{lines}\n```\n\nIt decodes to `{message!r}`.\n"


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_what_the_code_sends(name: str) -> None:
    """Every byte of the page's example, with its annotation, is the code's."""
    assert example(name) in TEXT


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_bytes_of_an_example_decode_to_what_the_page_says(name: str) -> None:
    """Read from the page alone: the hexadecimal column, and the line below it."""
    block = re.search(rf"```hexdump {name}\n(.*?)\n```\n\nIt decodes to `(.*?)`\.\n", TEXT, re.DOTALL)
    assert block is not None
    data = bytes.fromhex("".join(line[:HEX_COLUMNS] for line in block[1].splitlines()))
    _, _, decode, _ = EXAMPLES[name]
    assert repr(decode(data)) == block[2]


def test_every_radio_frame_and_every_message_has_its_example() -> None:
    """Frames of all kinds, and whatever else crosses the fabric but the truth, which is the recorder's."""
    shown = {type(message) for message, *_ in EXAMPLES.values()}
    assert shown == {Frame, Act, Report, Health, Clock, Status, Workload, Attending, Member, Relocating, Leaving}
    assert len(re.findall(r"^```hexdump ", TEXT, re.MULTILINE)) == len(EXAMPLES)


LIMITS = re.findall(r"^\| `([A-Z][A-Z_]+)` \| ([-0-9.]+) \|", TEXT, re.MULTILINE)


@pytest.mark.parametrize(("name", "number"), LIMITS)
def test_a_number_of_the_page_is_the_codes(name: str, number: str) -> None:
    """Each row of a table that begins with a constant's name gives that constant."""
    values = [getattr(source, name) for source in SOURCES if hasattr(source, name)]
    assert values
    assert all(value == float(number) for value in values)


def test_the_page_names_all_limits_of_the_radio() -> None:
    """And all counts of the tree protocol."""
    named = {name for name, _ in LIMITS}
    limits = {name for name in vars(radio) if re.fullmatch(r"MAX_[A-Z_]+", name)}
    rules = {
        name
        for source in (core, tree, beliefs, recruitment)
        for name, value in vars(source).items()
        if re.fullmatch(r"[A-Z_]+_(STEPS|M|S)", name) and isinstance(value, int | float)
    }
    assert limits | rules <= named


def test_what_holds_is_held_by_a_test() -> None:
    """Each row of the table under "What holds" gives a number of the machine, and names its method that holds it."""
    section = TEXT.split("### What holds", 1)[1].split("\n## ", 1)[0]
    rows = re.findall(r"^\| `([A-Z_]+_STEPS)` \| \d+ \|.*\| `(\w+)` \|$", section, re.MULTILINE)
    assert [name for name, _ in rows] == ["CYCLE_STEPS", "ROOTLESS_STEPS", "GHOST_STEPS", "HEALED_STEPS"]
    for name, method in rows:
        assert name in inspect.getsource(getattr(machine.TreeProtocol, method))


def test_keys_and_names_of_the_page_are_the_codes() -> None:
    """For a run called `demo` and agent 7."""
    demo = Keys("demo")
    leaves = (keys.FRAME, keys.RADIO, keys.REPORT, keys.ACT)
    for key in (*(demo.agent(7, leaf) for leaf in leaves), demo.token(keys.AGENT, 7), demo.token(keys.WORLD)):
        assert f"`{key}`" in TEXT
    assert f"`{keys.HEALTH}`" in TEXT
    for key in (demo.clock, demo.truth, demo.status, demo.workload, demo.orders, demo.done):
        assert f"`{key.removeprefix(demo.root + '/')}`" in TEXT
    assert f"`{access.user_name(keys.AGENT, 7)}`" in TEXT
    for message in ("Frame", "Radio", "Report", "Act"):
        assert f"`application/msgpack;deltaswarm.{message}.v1`" in TEXT


def test_the_kinds_of_the_page_are_the_codes() -> None:
    """The table of kinds gives each its number."""
    for kind in ("ATTENDING", "MEMBER", "RELOCATING", "LEAVING"):
        assert f"| {getattr(radio, kind)} | {kind.lower()} |" in TEXT


if __name__ == "__main__":
    print("\n".join(example(name) for name in EXAMPLES))
