"""Exit codes and error messages of commands."""

import sys

OK, FAILED, USAGE, MISSED = 0, 1, 2, 3
"""Success; a run failed; wrong usage or scenario; a claim missed its tolerance."""


class CommandError(Exception):
    """Ends a command with an exit code and with its text as one line on standard error."""

    code = USAGE

    def __init__(self, text: str = "", code: int | None = None) -> None:
        super().__init__(text)
        self.code = self.code if code is None else code


def complain(text: str) -> None:
    """Print what is wrong on standard error."""
    print(f"deltaswarm: {text}", file=sys.stderr)
