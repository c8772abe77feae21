"""Describe the columns of a table beside its rows, for the data dictionary and docs/RESULTS.md."""

from typing import Annotated, Any, NamedTuple, get_args, get_type_hints


class Column(NamedTuple):
    """The unit of a column, if it has one, and its meaning."""

    unit: str
    meaning: str


Utc = Annotated[str, Column("", "the same by the wall clock, in UTC to the millisecond; empty: no person was there")]
MONOTONIC = "wall s"
PAGE = "page s"
"""Unit of times by the page's clock: seconds since 1970, as set when the page was loaded and not corrected since."""

_TYPES: dict[Any, str] = {int: "whole number", float: "number", str: "text"}


def columns_of(table: type[NamedTuple]) -> dict[str, tuple[str, Column]]:
    """Return each column's type in words, and its unit and meaning."""
    found: dict[str, tuple[str, Column]] = {}
    for name, hint in get_type_hints(table, include_extras=True).items():
        plain, *notes = get_args(hint)
        (column,) = [note for note in notes if isinstance(note, Column)]
        found[name] = _TYPES[_first(plain)], column
    return found


def _first(hint: Any) -> Any:
    return next(iter(get_args(hint)), hint)
