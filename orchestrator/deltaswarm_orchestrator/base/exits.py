"""Exit codes and error messages of commands."""

import sys

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


def complain(text: str) -> None:
    """Print what is wrong on standard error."""
    print(f"deltaswarm: {text}", file=sys.stderr)
