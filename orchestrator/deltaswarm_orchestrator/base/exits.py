"""What commands tell the user: exit codes, messages, progress, and results as text."""

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # imported before the signal handlers are set, so it imports nothing itself
    from deltaswarm_wire.operator_messages import Status

OK, FAILED, USAGE, MISSED, INTERRUPTED = 0, 1, 2, 3, 130

EXIT_CODES = {
    OK: "success",
    FAILED: "a run failed or is not valid, or a result is incomplete",
    USAGE: "wrong usage, a name that does not exist, or an invalid scenario or file",
    MISSED: "a claim, finding or published number did not hold",
    INTERRUPTED: "interrupted by Ctrl-C, SIGTERM or a closed terminal",
}
"""What the exit codes of all commands mean."""


class CommandError(Exception):
    """Ends a command with an exit code and with its text as one line on standard error."""

    code = USAGE

    def __init__(self, text: str = "", code: int | None = None) -> None:
        super().__init__(text)
        self.code = self.code if code is None else code


class _Notices:
    are_shown = True


def show_notices(are_shown: bool) -> None:
    _Notices.are_shown = are_shown


def notices_are_shown() -> bool:
    return _Notices.are_shown


def notice(text: str) -> None:
    """Print a notice on standard error, unless notices are off."""
    if _Notices.are_shown:
        print(text, file=sys.stderr, flush=True)


def complain(text: str) -> None:
    print(f"deltaswarm: {text}", file=sys.stderr)


class Reporter:
    """Shows the progress of a run. This base class shows nothing, as in the workers of a sweep."""

    def update(self, status: "Status", messages_per_s: float | None) -> None:
        """Take the newest state."""

    def say(self, text: str) -> None:
        """Take a message for the user."""


def aligned(rows: Iterable[Iterable[str]]) -> str:
    """Format rows of cells as lines with aligned columns."""
    cells = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells
    )


def shown(value: Any) -> str:
    """Format a value; a float has two decimals below 100 and none from 100 on."""
    if isinstance(value, float):
        return f"{value:.0f}" if abs(value) >= 100 else f"{value:.2f}"
    return {"None": "-", "True": "yes", "False": "NO"}.get(str(value), str(value))
