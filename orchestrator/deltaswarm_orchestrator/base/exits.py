"""What commands tell the user: exit codes, messages and progress."""

import sys

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
    """Whether notices are printed."""

    are_shown = True


def show_notices(are_shown: bool) -> None:
    """Let `notice` print, or not."""
    _Notices.are_shown = are_shown


def notice(text: str) -> None:
    """Print on standard error what is worth knowing and no error, unless notices are off."""
    if _Notices.are_shown:
        print(text, file=sys.stderr, flush=True)


def complain(text: str) -> None:
    """Print what is wrong on standard error."""
    print(f"deltaswarm: {text}", file=sys.stderr)


class Reporter:
    """Takes the progress of a run. This base class discards it, and needs no terminal: sweep workers show nothing."""

    def update(self, status: Status, messages_per_s: float | None) -> None:
        """Take the newest state."""

    def say(self, text: str) -> None:
        """Take a message for the user."""
