"""How a command ends: its exit code, and what it complains of."""

import sys

OK, FAILED, USAGE, MISSED = 0, 1, 2, 3
"""Success; the run failed; usage or scenario; a claim missed its tolerance."""


class CommandError(Exception):
    """Ends a command with its text as one line on standard error, and with an exit code."""

    code = USAGE

    def __init__(self, text: str = "", code: int | None = None) -> None:
        super().__init__(text)
        self.code = self.code if code is None else code


def complain(text: str) -> None:
    """Say what is wrong, on standard error."""
    print(f"deltaswarm: {text}", file=sys.stderr)
