"""Standard streams: there is always one of each number."""

import os
import sys


def open_standard_streams() -> None:
    """Open those that are closed on the null device: else a file or socket would get the number of one.

    Call it before anything else is opened.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # gets the smallest free number
            os.set_inheritable(opened, True)
            stream = os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False)
            setattr(sys, name, stream)
