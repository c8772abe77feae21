"""MessagePack with limits, and the checks that every decoder is built from.

A decoder takes bytes from an untrusted sender. Every mistake in them is one `WireError` that names the field, what
must hold, and what was got.
"""

import struct
from collections.abc import Callable, Collection
from functools import lru_cache
from typing import Any, TypeVar

import msgpack

T = TypeVar("T")

PROTOCOL_VERSION = 3

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
    """A sample that breaks the protocol: the field, what it must do or be, and what was got."""

    def __init__(self, field: str, must: str, got: object) -> None:
        super().__init__(f"{field} must {must} (got {got})")
        self.field = field


tuple_of: Any = tuple.__new__
"""Makes a NamedTuple from its class and a tuple of all its fields, in a third of the time of the class's constructor:
for what is made several times a step."""

_IS_PURE_PYTHON = msgpack.Packer.__module__ == "msgpack.fallback"

_pack: Callable[[object], bytes] = msgpack.packb if _IS_PURE_PYTHON else msgpack.Packer().pack
"""Safe in any thread. All threads share the compiled packer, which works under Python's lock: making one costs as much
as using it. The pure-Python packer is not thread-safe, so each sample gets a new one."""


def pack(value: object, limit_bytes: int = MAX_SAMPLE_BYTES) -> bytes:
    """Encode `value`; raise WireError for more than `limit_bytes`, which would harm a link."""
    data = _pack(value)
    if len(data) > limit_bytes:
        raise WireError("sample", f"be at most {limit_bytes} bytes", f"{len(data)} to send")
    return data


def unpack(data: bytes, limit_bytes: int = MAX_SAMPLE_BYTES) -> Any:
    """Decode a sample that is exactly one MessagePack value. Raises WireError."""
    if len(data) > limit_bytes:
        raise WireError("sample", f"be at most {limit_bytes} bytes", len(data))
    try:
        return msgpack.unpackb(data)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise WireError("sample", "be MessagePack", str(error) or type(error).__name__) from None


def keep(kept: dict[bytes, T], data: bytes, value: T, most: int) -> T:
    """Keep a value by its encoding among the newest `most`, so that one process need not decode it; return it."""
    kept[data] = value
    if len(kept) > most:
        del kept[next(iter(kept))]
    return value


def shown(value: Any) -> str:
    """Show a received value in an error text: a number as it is, others, which may be huge or deep, by type."""
    return repr(value) if value is None or type(value) in (bool, int, float) else type(value).__name__


def array(value: Any, length: int, field: str) -> list[Any]:
    """Return `value` if it is a list of exactly `length` items."""
    if type(value) is not list:
        raise WireError(field, "be an array", type(value).__name__)
    if len(value) != length:
        raise WireError(field, f"have {length} items", len(value))
    return value


def arrays(value: Any, limit: int, field: str) -> list[Any]:
    """Return `value` if it is a list of at most `limit` items."""
    if type(value) is not list:
        raise WireError(field, "be an array", type(value).__name__)
    if len(value) > limit:
        raise WireError(field, f"have at most {limit} items", len(value))
    return value


def integer(value: Any, low: int, high: int, field: str) -> int:
    """Return `value` if it is an integer (no bool, no float) in [low, high]."""
    if type(value) is not int:
        raise WireError(field, "be an integer", type(value).__name__)
    if not low <= value <= high:
        raise WireError(field, f"be from {low} to {high}", value)
    return value


def number(value: Any, low: float, high: float, field: str) -> float:
    """Return `value` as float if it is a finite number in [low, high]."""
    if type(value) is not float and type(value) is not int:
        raise WireError(field, "be a number", type(value).__name__)
    if not low <= value <= high:
        raise WireError(field, f"be from {low:.15g} to {high:.15g}", value)
    return float(value)


_ONLY_INT = {int}


def all_fit(values: list[Any], codes: str) -> bool:
    """Whether all are integers of their C types (see `struct`): packing them is the quickest check of many at once."""
    if set(map(type, values)) != _ONLY_INT:
        return False
    try:
        _layout(codes).pack(*values)
    except struct.error:
        return False
    return True


@lru_cache(512)
def _layout(codes: str) -> struct.Struct:
    return struct.Struct("<" + codes)


def boolean(value: Any, field: str) -> bool:
    if type(value) is not bool:
        raise WireError(field, "be true or false", type(value).__name__)
    return value


def octets(value: Any, limit: int, field: str) -> bytes:
    """Return `value` if it is bytes, at most `limit` of them."""
    if type(value) is not bytes or len(value) > limit:
        raise WireError(
            field, f"be at most {limit} bytes", len(value) if type(value) is bytes else type(value).__name__
        )
    return value


def text(value: Any, field: str, limit: int = 200, allowed: Collection[str] | None = None) -> str:
    """Return `value` if it is a string of at most `limit` characters and, where given, one of `allowed`."""
    if type(value) is not str:
        raise WireError(field, "be a string", type(value).__name__)
    if len(value) > limit:
        raise WireError(field, f"have at most {limit} characters", len(value))
    if allowed is not None and value not in allowed:
        raise WireError(field, f"be one of {', '.join(sorted(allowed))}", repr(value))
    return value


def version(value: Any) -> None:
    if type(value) is not int or value != PROTOCOL_VERSION:
        raise WireError("version", f"be {PROTOCOL_VERSION}", shown(value))


def fields(value: Any, names: tuple[str, ...], message: str) -> dict[str, Any]:
    """Return `value` if it is a map with exactly the keys `names` and a known version `v`."""
    if type(value) is not dict:
        raise WireError(message, "be a map", type(value).__name__)
    version(value.get("v"))
    for name in names:
        if name not in value:
            raise WireError(f"{message}.{name}", "be given", "nothing")
    if len(value) != len(names) + 1:
        unknown = sorted(str(k) for k in value if k not in names and k != "v")
        raise WireError(message, "have no other fields", ", ".join(unknown)[:200])
    return value
