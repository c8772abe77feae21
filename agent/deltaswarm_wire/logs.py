"""The log format of all parts, and the standard streams that they log to."""

import logging
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


class LogFormatter(logging.Formatter):
    """Formats log lines and tracebacks without locations in Zenoh's sources."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        from deltaswarm_wire.session import without_sources  # which commands need not load

        return without_sources(super().format(record))


def log_to_standard_error() -> None:
    """Log to standard error, from level INFO; all standard streams are open afterwards."""
    open_standard_streams()
    handler = logging.StreamHandler()
    handler.setFormatter(LogFormatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
