"""How every part writes its log."""

import logging

from deltaswarm_wire.session import without_sources


class LogFormatter(logging.Formatter):
    """Every part's log lines, tracebacks included, without the places in Zenoh's sources that its errors name."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """One record as text."""
        return without_sources(super().format(record))


def log_to_standard_error() -> None:
    """Set up a part's log, from INFO on."""
    handler = logging.StreamHandler()
    handler.setFormatter(LogFormatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
