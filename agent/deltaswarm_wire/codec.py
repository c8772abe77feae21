"""MessagePack with limits, and the checks that every decoder is built from.

A decoder takes bytes from a stranger. Whatever is wrong with them comes out as one `WireError`
that names the field, what was found and what is allowed.
"""

import math
from collections.abc import Callable, Collection
from typing import Any

import msgpack

PROTOCOL_VERSION = 2

MAX_SAMPLE_BYTES = 32 * 1024
"""Largest sample on a low-latency link: such a link does not fragment, and dies without an error."""

MAX_RADIO_BYTES = 8 * 1024
"""Largest radio frame."""

MAX_ORDINARY_BYTES = 8 * 1024 * 1024
"""Largest sample on an ordinary link (truth for hundreds of agents)."""

MAX_ID = 0xFFFF_FFFF
MAX_AGENT_ID = 0xFFFF
MAX_STEP = 0xFFFF_FFFF
MAX_ABS_M = 21_474_837.0
MAX_ABS_CM = 0x7FFF_FFFF


class WireError(ValueError):
    """A sample that breaks the protocol; `field` says where, the text says what was wrong."""

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field}: {problem}")
        self.field = field


_IS_PURE_PYTHON = msgpack.Packer.__module__ == "msgpack.fallback"

_pack: Callable[[object], bytes] = msgpack.packb if _IS_PURE_PYTHON else msgpack.Packer().pack
"""For any thread. The compiled packer, which costs as much to make as to use, is shared: it works under Python's lock.
A pure-Python one would mix what two threads encode at the same time, so there each sample has its own."""


def pack(value: object, limit_bytes: int = MAX_SAMPLE_BYTES) -> bytes:
    """Encode `value`; a sample above `limit_bytes` is refused here, before it can harm a link.

    Raises:
        WireError: the encoded sample is too large.
    """
    data = _pack(value)
    if len(data) > limit_bytes:
        raise WireError("sample", f"{len(data)} bytes to send, at most {limit_bytes} are allowed")
    return data


def unpack(data: bytes, limit_bytes: int = MAX_SAMPLE_BYTES) -> Any:
    """Decode one MessagePack value, whole and alone.

    Raises:
        WireError: too large, not MessagePack, or followed by further bytes.
    """
    if len(data) > limit_bytes:
        raise WireError("sample", f"{len(data)} bytes, at most {limit_bytes} are allowed")
    try:
        return msgpack.unpackb(data)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise WireError("sample", f"not MessagePack: {str(error) or type(error).__name__}") from None


def shown(value: Any) -> str:
    """A stranger's value in an error text: numbers as they are, the rest by type, since it may be huge or deep."""
    return repr(value) if value is None or type(value) in (bool, int, float) else type(value).__name__


def array(value: Any, length: int, field: str) -> list[Any]:
    """`value`, if it is a list of exactly `length` items."""
    if type(value) is not list:
        raise WireError(field, f"an array is expected, not {type(value).__name__}")
    if len(value) != length:
        raise WireError(field, f"{length} items are expected, not {len(value)}")
    return value


def arrays(value: Any, limit: int, field: str) -> list[Any]:
    """`value`, if it is a list of at most `limit` items."""
    if type(value) is not list:
        raise WireError(field, f"an array is expected, not {type(value).__name__}")
    if len(value) > limit:
        raise WireError(field, f"{len(value)} items, at most {limit} are allowed")
    return value


def integer(value: Any, low: int, high: int, field: str) -> int:
    """`value`, if it is an integer (no bool, no float) in [low, high]."""
    if type(value) is not int:
        raise WireError(field, f"an integer is expected, not {type(value).__name__}")
    if not low <= value <= high:
        raise WireError(field, f"{value} is outside {low} to {high}")
    return value


def number(value: Any, low: float, high: float, field: str) -> float:
    """`value` as float, if it is a finite number in [low, high]."""
    if type(value) is not float and type(value) is not int:
        raise WireError(field, f"a number is expected, not {type(value).__name__}")
    if not low <= value <= high:
        problem = f"{value} is outside {low} to {high}" if math.isfinite(value) else f"{value} is not finite"
        raise WireError(field, problem)
    return float(value)


def boolean(value: Any, field: str) -> bool:
    """`value`, if it is a bool."""
    if type(value) is not bool:
        raise WireError(field, f"true or false is expected, not {type(value).__name__}")
    return value


def text(value: Any, field: str, limit: int = 200, allowed: Collection[str] | None = None) -> str:
    """`value`, if it is a string of at most `limit` characters and, where given, one of `allowed`."""
    if type(value) is not str:
        raise WireError(field, f"a string is expected, not {type(value).__name__}")
    if len(value) > limit:
        raise WireError(field, f"{len(value)} characters, at most {limit} are allowed")
    if allowed is not None and value not in allowed:
        raise WireError(field, f"{value!r} is not one of {', '.join(sorted(allowed))}")
    return value


def version(value: Any) -> None:
    """Accept the one protocol version that is known."""
    if type(value) is not int or value != PROTOCOL_VERSION:
        raise WireError("version", f"{shown(value)} is not known, {PROTOCOL_VERSION} is")


def fields(value: Any, names: tuple[str, ...], message: str) -> dict[str, Any]:
    """`value`, if it is a map with exactly the keys `names` and a known version `v`."""
    if type(value) is not dict:
        raise WireError(message, f"a map is expected, not {type(value).__name__}")
    version(value.get("v"))
    for name in names:
        if name not in value:
            raise WireError(f"{message}.{name}", "is missing")
    if len(value) != len(names) + 1:
        unknown = sorted(str(k) for k in value if k not in names and k != "v")
        raise WireError(message, f"unknown fields: {', '.join(unknown)[:200]}")
    return value
