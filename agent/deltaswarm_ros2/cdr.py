"""Encode and decode ROS 2's messages as CDR (XCDR version 1) with pycdr2, whose classes are made from `definitions.py`.

A message is a dict of its fields.
"""

import struct
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType, SimpleNamespace
from typing import Any

from pycdr2 import IdlStruct, make_idl_struct
from pycdr2._support import Buffer, Endianness
from pycdr2.types import array, float32, float64, int32, sequence, uint8, uint32

from deltaswarm_ros2.definitions import SEQUENCE, MessageField, fields_of

_BASIC = MappingProxyType(
    {
        "bool": bool,
        "byte": uint8,
        "float32": float32,
        "float64": float64,
        "int32": int32,
        "string": str,
        "uint8": uint8,
        "uint32": uint32,
    }
)

_HEADERS = (b"\x00\x00", b"\x00\x01")
"""What a message begins with: plain CDR, big- or little-endian."""

MAX_BYTES = 1_000_000
"""Maximum length of a message; bounds the work that a stranger's message can cause."""

_PADDING = 3
"""Bytes that DDS may add to make the length of a message a multiple of four."""


class CdrError(ValueError):
    """Bytes that are not a message of the expected type, or a message that does not fit its type."""


def encode(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode a message, little-endian. A missing field is zero, as in ROS; an array must have its defined length."""
    try:
        return bytes(_idl(message_type).serialize(_filled(message_type, message), endianness=Endianness.Little))
    except CdrError:
        raise
    except Exception as error:  # pycdr2's own
        raise CdrError(f"{message_type} must have values that fit its fields: {error}") from None


def decode(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode a message."""
    if len(data) > MAX_BYTES:
        raise CdrError(f"a message must have at most {MAX_BYTES} bytes (got {len(data)})")
    if data[:2] not in _HEADERS or len(data) < 4:
        raise CdrError(f"a message must begin with 00 00 or 00 01 and two more bytes (got {data[:4].hex(' ')})")
    buffer = Buffer(data, align_offset=4)
    try:
        message: dict[str, Any] = _plain(_idl(message_type).deserialize(buffer))
    except (struct.error, UnicodeDecodeError) as error:
        raise CdrError(f"{message_type} must have all of its fields (got {len(data)} bytes: {error})") from None
    if not 0 <= len(data) - buffer.tell() <= _PADDING:
        raise CdrError(f"{message_type} must end after {buffer.tell()} bytes (got {len(data)})")
    return message


@lru_cache
def _class(message_type: str) -> type[IdlStruct]:
    fields = {field.name: _annotation(field) for field in fields_of(message_type)}
    return make_idl_struct(message_type.rpartition("/")[2], message_type, fields)


def _idl(message_type: str) -> Any:
    return _class(message_type).__idl__


def _annotation(field: MessageField) -> Any:
    one: Any = _BASIC.get(field.type) or _class(field.type)
    if field.length is None:
        return one
    many: Any = (sequence, array)  # for mypy, without pycdr2's plug-in
    return many[0][one] if field.length == SEQUENCE else many[1][one, field.length]


def _filled(message_type: str, message: Mapping[str, Any]) -> SimpleNamespace:
    fields = fields_of(message_type)
    if unknown := set(message) - {field.name for field in fields}:
        raise CdrError(f"{message_type} must have no field {', '.join(sorted(unknown))}")
    return SimpleNamespace(**{field.name: _value(field, message.get(field.name)) for field in fields})


def _value(field: MessageField, value: Any) -> Any:
    if field.length is None:
        return _one(field.type, value)
    if field.length != SEQUENCE and value is not None and len(value) != field.length:
        raise CdrError(f"{field.name} must have {field.length} values (got {len(value)})")
    return [_one(field.type, entry) for entry in ([None] * field.length if value is None else value)]


def _one(kind: str, value: Any) -> Any:
    basic = _BASIC.get(kind)
    if basic is None:
        return _filled(kind, value or {})
    return value if value is not None else "" if basic is str else 0


def _plain(value: Any) -> Any:
    if isinstance(value, IdlStruct):
        return {name: _plain(entry) for name, entry in vars(value).items()}
    if isinstance(value, list) and value and isinstance(value[0], IdlStruct):
        return tuple(map(_plain, value))
    return tuple(value) if isinstance(value, list | bytes) else value
