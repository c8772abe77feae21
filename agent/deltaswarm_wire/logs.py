"""The log format of all parts."""

import logging

from deltaswarm_wire.session import without_sources
from deltaswarm_wire.streams import open_standard_streams


class LogFormatter(logging.Formatter):
    """Formats log lines and tracebacks without locations in Zenoh's sources."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Format one record."""
        return without_sources(super().format(record))


def log_to_standard_error() -> None:
    """Log to standard error, from level INFO; all standard streams are open afterwards."""
    open_standard_streams()
    handler = logging.StreamHandler()
    handler.setFormatter(LogFormatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
