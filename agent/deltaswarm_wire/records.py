"""Codec of records: named tuples whose annotations give each field's meaning and limits, sent as maps.

The recording's schema and the tables of agent/PROTOCOL.md follow from the same annotations.
"""

from collections.abc import Callable
from types import NoneType
from typing import Annotated, Any, Generic, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from deltaswarm_wire.codec import (
    MAX_SAMPLE_BYTES,
    PROTOCOL_VERSION,
    array,
    arrays,
    boolean,
    fields,
    integer,
    number,
    pack,
    text,
    unpack,
)

T = TypeVar("T", bound=tuple[Any, ...])


class Limits(NamedTuple):
    """What a field means and may be: a number from `low` to `high`, one of the texts `choices`, at most `most` items.

    A `check` of the value and the field's name stands for all of these.
    """

    meaning: str
    low: float = 0
    high: float = 0
    choices: tuple[str, ...] | None = None
    most: int = 0
    check: Callable[[Any, str], Any] | None = None


class Record(Generic[T]):
    """Codec of one kind of record. Fields are `Annotated[..., Limits(...)]`.

    Their types are int, float, bool, str, tuples of these, tuples of named tuples with such fields (rows), or any of
    these or None. A row may leave out its last fields if these have the default None.
    """

    def __init__(self, kind: type[T], name: str, most_bytes: int = MAX_SAMPLE_BYTES) -> None:
        self.name = name
        self._kind: Any = kind
        self._most_bytes = most_bytes
        self._hints = get_type_hints(kind, include_extras=True)
        self._checks = {field: _check_of(hint, f"{name}.{field}") for field, hint in self._hints.items()}
        self._names = tuple(self._hints)

    def encode(self, record: T) -> bytes:
        """A map with the fields and the version `v`. Raises WireError."""
        return pack({"v": PROTOCOL_VERSION, **dict(zip(self._names, record, strict=True))}, self._most_bytes)

    def decode(self, data: bytes) -> T:
        """Check and decode. Raises WireError."""
        raw = fields(unpack(data, self._most_bytes), self._names, self.name)
        made: T = self._kind(*[check(raw[field]) for field, check in self._checks.items()])
        return made

    def table(self) -> str:
        """Return the rows of the protocol's page."""
        rows = ["| field | type | limits | meaning |", "| --- | --- | --- | --- |"]
        for field, hint in self._hints.items():
            of, limits = hint.__origin__, hint.__metadata__[0]
            allowed = ", ".join(f"`{choice}`" for choice in limits.choices or ())
            if of in (int, float):
                allowed = f"{limits.low:,.15g} to {limits.high:,.15g}"
            rows.append(f"| `{field}` | {_TYPES[of]} |{f' {allowed} ' if allowed else ' '}| {limits.meaning} |")
        return "\n".join(rows)


_TYPES = {int: "integer", float: "number", bool: "boolean", str: "string"}


def _check_of(hint: Any, field: str) -> Callable[[Any], Any]:
    """Return what checks the values of a field by its annotation."""
    of, limits = hint.__origin__, hint.__metadata__[0]
    low, high, check, arms = limits.low, limits.high, limits.check, get_args(of)
    if check is not None:
        return lambda value: check(value, field)
    if NoneType in arms:
        checked = _check_of(Annotated[arms[0], limits], field)
        return lambda value: None if value is None else checked(value)
    if get_origin(of) is tuple:
        is_row = hasattr(arms[0], "_fields")
        item = _rows_of(arms[0], field) if is_row else _check_of(Annotated[arms[0], limits], field)
        return lambda value: tuple([item(one) for one in arrays(value, limits.most, field)])
    if of is int:
        return lambda value: integer(value, int(low), int(high), field)
    if of is float:
        return lambda value: number(value, low, high, field)
    if of is bool:
        return lambda value: boolean(value, field)
    return lambda value: text(value, field, allowed=limits.choices)


def _rows_of(kind: Any, field: str) -> Callable[[Any], Any]:
    hints = get_type_hints(kind, include_extras=True)
    checks = [_check_of(hint, f"{field}.{name}") for name, hint in hints.items()]
    least = len(checks) - [*kind._field_defaults.values()].count(None)

    def checked(row: Any) -> Any:
        if type(row) is list and least <= len(row) < len(checks):
            row = [*row, *[None] * (len(checks) - len(row))]
        return kind(*[check(value) for check, value in zip(checks, array(row, len(checks), field), strict=True)])

    return checked
