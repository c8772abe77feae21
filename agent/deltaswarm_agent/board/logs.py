"""Where a board's log goes: to standard error, or to files of bounded length for as long as there is room for them."""

import logging
import logging.handlers
import sys
from pathlib import Path

from deltaswarm_agent.board.settings import LogSettings
from deltaswarm_wire.logs import LogFormatter

log = logging.getLogger("deltaswarm.board")


class _Files(logging.handlers.RotatingFileHandler):
    """Gives its place up to the handlers before it when the disk is full or read-only."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 (the name that `logging` calls)
        """Called by `logging` for a line that could not be written."""
        error = sys.exc_info()[1]
        root = logging.getLogger()
        if self in root.handlers:  # else another thread has done so, while this one waited to write
            root.removeHandler(self)
            _to_standard_error(logging.NOTSET)
            log.error("nothing more is logged to %s: %s", self.baseFilename, error)
        if record.levelno < logging.ERROR:  # others are there already
            root.handle(record)


def log_to(settings: LogSettings, agent: int) -> None:
    """To standard error, which systemd keeps; with a folder to rotating files instead, errors to both.

    A folder that cannot be written to is said and left.
    """
    root = logging.getLogger()
    root.setLevel(settings.level)
    if not settings.folder:
        return
    folder = Path(settings.folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = _Files(folder / f"agent-{agent}.log", maxBytes=settings.max_bytes, backupCount=settings.backups)
    except OSError as error:
        log.error("nothing is logged to %s: %s", folder, error)
        return
    _to_standard_error(logging.ERROR)
    files.setFormatter(LogFormatter())
    root.addHandler(files)


def _to_standard_error(level: int) -> None:
    """From this level on, by the handlers that were there first."""
    for handler in logging.getLogger().handlers:
        handler.setLevel(level)
