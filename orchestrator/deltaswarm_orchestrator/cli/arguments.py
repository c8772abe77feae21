"""Arguments that several commands share."""

import argparse
from collections.abc import Callable


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """The parser of a whole number within limits, for `type=`."""
    limits = f"at least {least}" if most is None else f"{least} to {most}"

    def parsed(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= (most or int(text)):
            raise argparse.ArgumentTypeError(f"must be {limits} (got {text!r})")
        return int(text)

    return parsed
