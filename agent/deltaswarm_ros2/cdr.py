"""CDR, the encoding of ROS 2's messages: XCDR version 1 after a header of four bytes.

A message is a dict of its fields. Only the types of `definitions.py` are known, so nothing needs to be generated.
"""

import struct
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NoReturn

from deltaswarm_ros2.definitions import SEQUENCE, fields_of

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""The header that is written: plain CDR, little-endian, no options."""

_ORDERS = MappingProxyType({b"\x00\x00": ">", b"\x00\x01": "<"})
"""Byte orders by the first two bytes of the header that are read."""

_FORMATS = MappingProxyType(
    {"bool": "?", "byte": "B", "float32": "f", "float64": "d", "int32": "i", "uint8": "B", "uint32": "I"}
)

MAX_VALUES = 10_000
"""Maximum length of a sequence or string; bounds the work that a stranger's message can cause."""

_PADDING = 3
"""Bytes that DDS may add to make the length of a message a multiple of four."""


class CdrError(ValueError):
    """Bytes that are not a message of the expected type, or a message that does not fit its type."""


def encode(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode a message. A missing field is zero, as in ROS; an array must have its defined length.

    Raises:
        CdrError: a field is unknown, or a value does not fit.
    """
    writer = _Writer()
    try:
        writer.message(message_type, message)
    except (struct.error, TypeError, AttributeError) as error:
        raise CdrError(f"{message_type} must have values that fit its fields: {error}") from None
    return LITTLE_ENDIAN + bytes(writer.data)


def decode(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode a message.

    Raises:
        CdrError: it is too short, too long, or no plain CDR.
    """
    order = _ORDERS.get(data[:2])
    if order is None or len(data) < len(LITTLE_ENDIAN):
        raise CdrError(f"a message must begin with 00 00 or 00 01 and two more bytes (got {data[:4].hex(' ')})")
    reader = _Reader(memoryview(data)[4:], order)
    message = reader.message(message_type)
    left = len(reader.data) - reader.at
    if left > _PADDING:
        raise CdrError(f"{message_type} must end after {reader.at} bytes (got {left} more)")
    return message


class _Writer:
    """Appends values, each aligned to its own size."""

    def __init__(self) -> None:
        self.data = bytearray()

    def message(self, message_type: str, message: Mapping[str, Any]) -> None:
        fields = fields_of(message_type)
        if unknown := set(message) - {field.name for field in fields}:
            raise CdrError(f"{message_type} must have no field {', '.join(sorted(unknown))}")
        for field in fields:
            value = message.get(field.name)
            if field.length is None:
                self._one(field.type, value)
                continue
            values: Sequence[Any] = [None] * field.length if value is None else value
            if field.length != SEQUENCE and len(values) != field.length:
                raise CdrError(f"{field.name} must have {field.length} values (got {len(values)})")
            if field.length == SEQUENCE:
                self._basic("I", len(values))
            for entry in values:
                self._one(field.type, entry)

    def _one(self, name: str, value: Any) -> None:
        if name == "string":
            text = (value or "").encode() + b"\0"
            self._basic("I", len(text))
            self.data += text
        elif name in _FORMATS:
            self._basic(_FORMATS[name], 0 if value is None else value)
        else:
            self.message(name, value or {})

    def _basic(self, form: str, value: Any) -> None:
        self.data += bytes(-len(self.data) % struct.calcsize(f"<{form}"))
        self.data += struct.pack(f"<{form}", value)


class _Reader:
    """Takes values from the bytes after the header."""

    def __init__(self, data: memoryview, order: str) -> None:
        self.data = data
        self.at = 0
        self._order = order

    def message(self, message_type: str) -> dict[str, Any]:
        message: dict[str, Any] = {}
        for field in fields_of(message_type):
            count = field.length
            if count is None:
                message[field.name] = self._one(field.type)
                continue
            if count == SEQUENCE:
                count = self._length()
            form = _FORMATS.get(field.type)
            if form and count:
                message[field.name] = self._basic(form, count)
            else:
                message[field.name] = tuple([self._one(field.type) for _ in range(count)])
        return message

    def _one(self, name: str) -> Any:
        if name == "string":
            text = self._bytes(self._length())
            try:
                return text.removesuffix(b"\0").decode()
            except UnicodeDecodeError:
                raise CdrError(f"a string must be UTF-8 (got {text[:20].hex(' ')})") from None
        form = _FORMATS.get(name)
        return self._basic(form, 1)[0] if form else self.message(name)

    def _basic(self, form: str, count: int) -> tuple[Any, ...]:
        size = struct.calcsize(f"<{form}")
        self.at += -self.at % size
        return struct.unpack(f"{self._order}{count}{form}", self._bytes(count * size))

    def _length(self) -> int:
        [length] = self._basic("I", 1)
        if length > MAX_VALUES:
            raise CdrError(f"a sequence or string must have at most {MAX_VALUES} values (got {length})")
        return int(length)

    def _bytes(self, count: int) -> bytes:
        taken = bytes(self.data[self.at : self.at + count])
        if len(taken) < count:
            self._ends_early(count)
        self.at += count
        return taken

    def _ends_early(self, count: int) -> NoReturn:
        raise CdrError(f"a message must have {self.at + count} bytes or more (got {len(self.data)})")
