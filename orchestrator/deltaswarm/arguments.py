"""Check the arguments of public functions by their annotations, before anything is done."""

import functools
import inspect
import os
import types
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin

from deltaswarm.errors import Error
from deltaswarm_scenario.scenario import MAX_SEED
from deltaswarm_wire.checked import MAX_NUMBER, shown, shown_limit
from deltaswarm_wire.files import Written

P = ParamSpec("P")
R = TypeVar("R")

Limits = tuple[float, float]

MOST = 10**6
"""The largest whole number, such as of runs or agents, unless a function names another."""

COUNTS: Limits = (1, MOST)
SEEDS: Limits = (0, MAX_SEED)


class _UnfitError(Exception):
    """A value does not fit an annotation."""


def public(**limits: Limits) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator of a public function, which checks its arguments; `limits` are those of numbers, by name.

    The decorated function raises `Error` if an argument is not as its annotation and its limits say.
    """

    def decorator(function: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(function)

        @functools.wraps(function)
        def checked(*arguments: P.args, **named: P.kwargs) -> R:
            bound = fitted(signature, arguments, named, limits)
            Written.begin()
            return function(*bound.args, **bound.kwargs)

        return checked

    return decorator


def fitted(
    signature: inspect.Signature, arguments: Iterable[Any], named: Mapping[str, Any], limits: Mapping[str, Limits]
) -> inspect.BoundArguments:
    """Return the arguments of a call, with the numbers of other packages as Python's own.

    Raises:
        Error: an argument is not as its annotation and its limits say.
        TypeError: one is missing, or is not known.
    """
    bound = signature.bind(*arguments, **named)
    for name, value in bound.arguments.items():
        kind = signature.parameters[name].annotation
        if kind is inspect.Parameter.empty:  # such as `self`
            continue
        try:
            bound.arguments[name] = _fitted(value, kind, limits.get(name))
        except _UnfitError:
            raise Error(f"{name} must be {_said(kind, limits.get(name))} (got {shown(value)})") from None
    return bound


def _fitted(value: Any, kind: Any, limits: Limits | None) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (types.UnionType, Union):
        for part in parts:
            try:
                return _fitted(value, part, limits)
            except _UnfitError:
                pass
        raise _UnfitError
    if kind is int or kind is float:
        return _number(value, kind, limits)
    if origin is tuple and isinstance(value, tuple | list) and len(value) == len(parts):
        return tuple(_fitted(item, part, limits) for item, part in zip(value, parts, strict=True))
    if origin is Mapping and isinstance(value, Mapping):
        return {_fitted(name, parts[0], None): _fitted(item, parts[1], limits) for name, item in value.items()}
    if origin is Iterable and isinstance(value, Iterable) and not isinstance(value, str | bytes):
        return [_fitted(item, parts[0], limits) for item in value]
    if not _is_plain(value, kind, origin):
        raise _UnfitError
    return value


def _is_plain(value: Any, kind: Any, origin: Any) -> bool:
    """Whether a value without parts fits."""
    if kind is Any:
        return True
    if origin is Callable:
        return callable(value)
    if origin not in (None, os.PathLike) or not isinstance(value, origin or kind):
        return False
    return not isinstance(value, str | os.PathLike) or _is_text(os.fspath(value))


def _is_text(text: Any) -> bool:
    """Whether the system and files can hold a text."""
    try:
        return isinstance(text, str) and b"\0" not in text.encode()
    except UnicodeEncodeError:
        return False


def _number(value: Any, kind: type, limits: Limits | None) -> Any:
    if isinstance(value, bool) or not isinstance(value, Integral if kind is int else Real):
        raise _UnfitError
    low, high = limits or _limits_of(kind)
    number: Any = value
    if not low <= number <= high:  # which NaN is not
        raise _UnfitError
    return number if isinstance(number, int) else kind(number)


def _limits_of(kind: type) -> Limits:
    return (0, MOST) if kind is int else (-MAX_NUMBER, MAX_NUMBER)


def _said(kind: Any, limits: Limits | None) -> str:
    """Say what fits an annotation."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (types.UnionType, Union):
        said = dict.fromkeys(_said(part, limits) for part in parts if part is not types.NoneType)
        return " or ".join(said) + (", or None" if types.NoneType in parts else "")
    if kind is float and limits is None:
        return "a finite number"
    if kind is int or kind is float:
        low, high = map(shown_limit, limits or _limits_of(kind))
        return f"{'an integer' if kind is int else 'a number'} from {low} to {high}"
    if origin is tuple:
        return f"({', '.join(_said(part, limits) for part in parts)})"
    if origin is Mapping:
        whole = "" if parts == (Any, Any) else f" of {_said(parts[0], None)} to {_said(parts[1], limits)}"
        return f"a mapping{whole}"
    if origin is Iterable:
        return f"a list of {_said(parts[0], limits)}"
    words: dict[Any, str] = {str: "a text without NUL", bool: "True or False", type: "a class", bytes: "bytes"}
    words |= {Any: "anything", os.PathLike: "a path", Callable: "a function"}
    return words.get(origin or kind) or str(kind.__name__)
