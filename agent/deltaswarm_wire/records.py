"""Codec of a record: a named tuple whose annotations say what each field means and may be, sent as a map.

The recording's schema and the tables of agent/PROTOCOL.md follow from the same annotations.
"""

from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

from deltaswarm_wire.codec import PROTOCOL_VERSION, boolean, fields, integer, number, pack, text, unpack

T = TypeVar("T", bound=tuple[Any, ...])


class Limits(NamedTuple):
    """What a field means, and what it may be: a number from `low` to `high`, or one of the texts `choices`."""

    meaning: str
    low: float = 0
    high: float = 0
    choices: tuple[str, ...] = ()


class Record(Generic[T]):
    """Codec of one kind of record. Fields are `Annotated[int | float | bool | str, Limits(...)]`."""

    def __init__(self, kind: type[T], name: str) -> None:
        self.name = name
        self.kind: Any = kind
        hints = get_type_hints(kind, include_extras=True)
        self.fields: dict[str, tuple[type[Any], Limits]] = {
            field: (hint.__origin__, hint.__metadata__[0]) for field, hint in hints.items()
        }
        self._names = tuple(self.fields)

    def encode(self, record: T) -> bytes:
        """A map with the fields and the version `v`."""
        return pack({"v": PROTOCOL_VERSION, **dict(zip(self._names, record, strict=True))})

    def decode(self, data: bytes) -> T:
        """Check and decode. Raises WireError."""
        raw = fields(unpack(data), self._names, self.name)
        made: T = self.kind(*[self._checked(field, raw[field]) for field in self._names])
        return made

    def _checked(self, field: str, value: Any) -> Any:
        of, limits = self.fields[field]
        name = f"{self.name}.{field}"
        if of is int:
            return integer(value, int(limits.low), int(limits.high), name)
        if of is float:
            return number(value, limits.low, limits.high, name)
        return boolean(value, name) if of is bool else text(value, name, allowed=limits.choices)

    def table(self) -> str:
        """Return the rows of the protocol's page."""
        rows = ["| field | type | limits | meaning |", "| --- | --- | --- | --- |"]
        for field, (of, limits) in self.fields.items():
            allowed = ", ".join(f"`{choice}`" for choice in limits.choices)
            if of in (int, float):
                allowed = f"{limits.low:,.15g} to {limits.high:,.15g}"
            rows.append(f"| `{field}` | {_TYPES[of]} |{f' {allowed} ' if allowed else ' '}| {limits.meaning} |")
        return "\n".join(rows)


_TYPES = {int: "integer", float: "number", bool: "boolean", str: "string"}
