"""How a command ends: its exit code, and what it complains of."""

import sys

OK, FAILED, USAGE, MISSED = 0, 1, 2, 3
"""Well; the run failed; usage or scenario; a tolerance was missed."""


def complain(text: str) -> None:
    """Say what is wrong, on standard error."""
    print(f"deltaswarm: {text}", file=sys.stderr)
