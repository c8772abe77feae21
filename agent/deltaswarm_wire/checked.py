"""Settings as frozen dataclasses whose fields carry their own limits.

`check(cls, table, path)` makes one from a plain table (as TOML gives it) and collects every mistake
instead of stopping at the first.
"""

import dataclasses
import difflib
import functools
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypedDict, TypeVar, Unpack

T = TypeVar("T")

PAPER, OURS = "paper", "our reading"
"""Sources of defaults."""

MAX_LINE = 1000
"""Characters of each part of a message: a wrong value may be huge."""


MAX_NUMBER, MIN_POSITIVE = 1e9, 1e-9
"""Limits of every number that states none of its own: with what is allowed, nothing that is computed overflows."""


def one_line(text: str) -> str:
    """Make a text one line: escape unprintable characters, cut after `MAX_LINE`."""
    cut = text if len(text) <= MAX_LINE else f"{text[: MAX_LINE - 3]}..."
    return cut if cut.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in cut)


@dataclass(frozen=True)
class Problem:
    """One mistake: the key, what was given, and what must hold ("must be ...") or what to do."""

    path: str
    given: str
    allowed: str
    trace: str = ""
    """The traceback of the plug-in that raised, if it is one's fault."""

    def __str__(self) -> str:
        path, given, allowed = map(one_line, (self.path, self.given, self.allowed))
        is_of_key = allowed.startswith(("must ", "is ", "varies "))
        return f"{path} {allowed} (got {given})" if is_of_key else f"{path}: {given}; {allowed}"


class SettingsError(ValueError):
    """Settings with mistakes; `problems` has all of them."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


class Bounds(TypedDict, total=False):
    """What a value may be: a number in a range, one of `choices`, a list of this `length`."""

    low: float | None
    high: float | None
    above: float | None
    choices: tuple[str, ...] | None
    length: int | None


def key(default: Any, doc: str, *, source: str = "", **bounds: Unpack[Bounds]) -> Any:
    """A field with its default, its meaning, its source ("paper" or "our reading") and its limits."""
    if unknown := bounds.keys() - Bounds.__annotations__.keys():
        raise TypeError(f"key() must have no argument {', '.join(sorted(unknown))}")
    metadata = {"doc": doc, "source": source, **dict.fromkeys(Bounds.__annotations__), **bounds}
    if isinstance(default, type):
        return dataclasses.field(default_factory=default, hash=False if default is dict else None, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def with_default(cls: Any, name: str, default: Any) -> Any:
    """Redeclare the field of a base class with another default."""
    spec = next(spec for spec in dataclasses.fields(cls) if spec.name == name)
    return dataclasses.field(default=default, metadata=spec.metadata)


def rest(doc: str) -> Any:
    """Declare a dict field for all other keys of the table; its user checks them."""
    return dataclasses.field(default_factory=dict, hash=False, metadata={"doc": doc, "rest": True})


def check(cls: type[T], table: Any, path: str = "") -> tuple[T | None, list[Problem]]:
    """Make an instance of `cls` from `table`; with mistakes, return None and all of them."""
    value, problems = known(cls, table, path)
    return (None if problems else value), problems


def known(cls: type[T], table: Any, path: str = "") -> tuple[T | None, list[Problem]]:
    """Like `check`, but make an instance despite unknown keys, so that they hide no other mistake."""
    if not isinstance(table, Mapping):
        return None, [Problem(path or "settings", shown(table), "must be a table")]
    fields = dataclasses.fields(typing.cast(Any, cls))
    specs = {spec.name: spec for spec in fields if not spec.metadata.get("rest")}
    hints = _hints(typing.cast(Any, cls))
    unknown = [name for name in table if name not in specs]
    values: dict[str, Any] = {spec.name: {n: table[n] for n in unknown} for spec in fields if spec.name not in specs}
    problems = [] if values else [unknown_key(name, specs, path) for name in unknown]
    for name, spec in specs.items():
        if name in table:
            value, inner_problems = _value(table[name], hints[name], spec.metadata, _join(path, name))
            problems += inner_problems
            values[name] = value
    if None in values.values():
        return None, problems
    instance = cls(**values)
    extra = getattr(instance, "problems", None)
    own_problems = [Problem(_join(path, p.path), p.given, p.allowed) for p in extra()] if extra else []
    return (None if own_problems else instance), problems + own_problems


@functools.lru_cache(maxsize=256)
def _hints(cls: type[Any]) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def load(cls: type[T], table: Any, path: str = "") -> T:
    """Like `check`, but raise an error if there are mistakes.

    Raises:
        SettingsError: with every mistake.
    """
    made, problems = check(cls, table, path)
    if made is None:
        raise SettingsError(problems)
    return made


def plain(settings: Any) -> dict[str, Any]:
    """Turn settings into a plain table for TOML or JSON, without keys that are None."""
    table: dict[str, Any] = {}
    for spec in dataclasses.fields(settings):
        value = getattr(settings, spec.name)
        if spec.metadata.get("rest"):
            table |= value
        elif value is not None:
            table[spec.name] = plain_value(value)
    return table


def plain_value(value: Any) -> Any:
    """Turn one value into its TOML or JSON form: tuples become lists, settings become tables."""
    if dataclasses.is_dataclass(value):
        return plain(value)
    if isinstance(value, tuple):
        return [plain_value(item) for item in value]
    return value


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def shown(value: Any) -> str:
    """Show a value in a message."""
    try:
        text = repr(value)
    except Exception:  # thousands of digits or of levels, or a class of the user's
        return type(value).__name__
    return text if len(text) <= 60 else f"{text[:57]}..."


def unknown_key(name: str, specs: Iterable[str], path: str = "") -> Problem:
    """Make the problem of a key that is not in `specs`."""
    specs = list(specs)
    near = difflib.get_close_matches(str(name), specs, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(specs)}"
    return Problem(_join(path, str(name)), "unknown key", hint)


def _value(value: Any, hint: Any, limits: Mapping[str, Any], path: str) -> tuple[Any, list[Problem]]:
    origin = typing.get_origin(hint)
    if origin in (types.UnionType, typing.Union):
        hint = next(arm for arm in typing.get_args(hint) if arm is not type(None))
        origin = typing.get_origin(hint)
    if dataclasses.is_dataclass(hint):
        return known(typing.cast(type[Any], hint), value, path)
    if origin is dict:
        return (value, []) if isinstance(value, dict) else (None, [Problem(path, shown(value), "must be a table")])
    if origin is tuple:
        return _tuple(value, typing.get_args(hint)[0], limits, path)
    allowed = _allowed(hint, limits)
    fits = type(value) is hint or (hint is float and type(value) is int)
    if not fits or not _within(value, limits):
        hint = did_you_mean(value, limits.get("choices") or ()).rstrip()
        return None, [Problem(path, shown(value) + (hint and f"; {hint}"), f"must be {allowed}")]
    return (float(value) if hint is float else value), []


def did_you_mean(value: Any, choices: Iterable[str]) -> str:
    """Ask about the most similar choice, to start a message; return "" if no choice is similar."""
    near = difflib.get_close_matches(value[:60], list(choices), n=1) if isinstance(value, str) else ()
    return f"did you mean {near[0]!r}? " if near else ""


def _tuple(value: Any, item: Any, limits: Mapping[str, Any], path: str) -> tuple[Any, list[Problem]]:
    length = limits.get("length")
    if not isinstance(value, list | tuple) or (length is not None and len(value) != length):
        count = "" if length is None else f" of {length} items"
        return None, [Problem(path, shown(value), f"must be a list{count}")]
    inner = {**limits, "length": limits.get("length") if typing.get_origin(item) is tuple else None}
    checked_values, problems = [], []
    for index, entry in enumerate(value):
        checked_value, inner_problems = _value(entry, item, inner, f"{path}[{index}]")
        checked_values.append(checked_value)
        problems += inner_problems
    return (None if None in checked_values else tuple(checked_values)), problems


def _bounds(limits: Mapping[str, Any]) -> tuple[float, float, float | None]:
    """Return the least and the greatest value of a number, and the value that it must exceed, if any."""
    low, high, above = limits.get("low"), limits.get("high"), limits.get("above")
    high = MAX_NUMBER if high is None else high
    if low is None:
        low = -MAX_NUMBER if above is None else above + MIN_POSITIVE
    return low, high, above


def _within(value: Any, limits: Mapping[str, Any]) -> bool:
    if limits.get("choices") is not None:
        return value in limits["choices"]
    if isinstance(value, bool | str):
        return True
    low, high, above = _bounds(limits)
    return bool(low <= value <= high and (above is None or value > above))


def _allowed(hint: Any, limits: Mapping[str, Any]) -> str:
    if limits.get("choices") is not None:
        return "one of " + ", ".join(limits["choices"])
    noun = {float: "a number", int: "an integer", str: "a string", bool: "true or false"}[hint]
    if hint in (str, bool):
        return noun
    low, high, above = _bounds(limits)
    if above is not None:
        return f"{noun} above {shown_limit(above)} and at most {shown_limit(high)}"
    return shown_limit(low) if low == high else f"{noun} from {shown_limit(low)} to {shown_limit(high)}"


def shown_limit(limit: float) -> str:
    """Show whole numbers in full: a rounded limit would be wrong."""
    return str(limit) if isinstance(limit, int) else f"{limit:.15g}"
