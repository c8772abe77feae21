"""MessagePack bytes with the name of each value beside them, as the protocol's pages show them."""

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

HEX_BYTES = 16
HEX_COLUMNS = 3 * HEX_BYTES - 1


@dataclass(frozen=True)
class Shape:
    """What the parts of a message are called: a field, or an array of fields, of flat or of nested rows."""

    name: str
    parts: tuple["Shape | str", ...] = ()
    rows: str = ""


def message(name: str, fields: tuple[str, ...], **arrays: Shape) -> Shape:
    return Shape(name, tuple(arrays.get(field, field) for field in fields))


class Example(NamedTuple):
    """A message that a page shows: how to encode and decode it, and what its parts are called."""

    message: Any
    encode: Callable[[Any], bytes]
    decode: Callable[[bytes], Any]
    shape: Shape


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
            for start in range(0, length[0], HEX_BYTES):
                row = self._take(min(HEX_BYTES, length[0] - start))
                yield self._line(row, "and so on" if start else "as its sender made them")
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


class Page:
    """A page of the documentation, and the examples that it should show."""

    def __init__(self, path: Path, examples: dict[str, Example]) -> None:
        self.path = path
        self.text = path.read_text()
        self.examples = examples

    def example(self, name: str) -> str:
        """An annotated example, as it stands in the page."""
        message, encode, _, shape = self.examples[name]
        lines = "\n".join(Annotator(encode(message)).lines(shape))
        return f"```hexdump {name}\n{lines}\n```\n\nIt decodes to `{message!r}`.\n"

    def assert_shows(self, name: str) -> None:
        """The page's bytes and annotations are the code's, and decode to what the page says."""
        assert self.example(name) in self.text
        block = re.search(rf"```hexdump {name}\n(.*?)\n```\n\nIt decodes to `(.*?)`\.\n", self.text, re.DOTALL)
        assert block is not None
        data = bytes.fromhex("".join(line.split("  ")[0] for line in block[1].splitlines()))
        assert repr(self.examples[name].decode(data)) == block[2]

    def assert_shows_no_other(self) -> None:
        """Each example of the page is one of those that are checked."""
        assert sorted(re.findall(r"^```hexdump (\w+)$", self.text, re.MULTILINE)) == sorted(self.examples)

    def constants(self) -> list[tuple[str, str]]:
        """Names and values of the rows that begin with a constant's name."""
        return re.findall(r"^\| `([A-Z][A-Z_]+)` \| ([-0-9.]+) \|", self.text, re.MULTILINE)

    def section(self, title: str) -> str:
        """The text below a heading, up to the next one."""
        return re.split(r"^#+ ", self.text.split(f"# {title}\n", 1)[1], maxsplit=1, flags=re.MULTILINE)[0]


def assert_is_the_codes(name: str, number: str, sources: tuple[ModuleType, ...]) -> None:
    """A constant has the page's value wherever it is defined."""
    values = [getattr(source, name) for source in sources if hasattr(source, name)]
    assert values, name
    assert all(value == float(number) for value in values)
