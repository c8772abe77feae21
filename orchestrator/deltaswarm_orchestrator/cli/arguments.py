"""Arguments that several commands share."""

import argparse
from collections.abc import Callable
from typing import TypeVar

N = TypeVar("N", int, float)


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return a parser of a whole number within limits, for `type=`."""
    return _within(int, least, most)


def number(least: float, most: float | None = None) -> Callable[[str], float]:
    """Return a parser of a number within limits, for `type=`."""
    return _within(float, least, most)


def _within(kind: Callable[[str], N], least: N, most: N | None) -> Callable[[str], N]:
    limits = f"at least {least}" if most is None else f"{least} to {most}"

    def parsed(text: str) -> N:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not (least <= value and (most is None or value <= most)):
            raise argparse.ArgumentTypeError(f"must be {limits} (got {text!r})")
        return value

    return parsed
