"""A board's log: to standard error, or to files of bounded length until the disk is full."""

import logging
import logging.handlers
import sys
from contextlib import suppress
from pathlib import Path

from deltaswarm_board.settings import LogSettings
from deltaswarm_wire.logs import LogFormatter

log = logging.getLogger("deltaswarm.board")


class _Files(logging.handlers.RotatingFileHandler):
    """Falls back to the previous handlers when the disk is full or read-only."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 (the name that `logging` calls)
        """Handle a line that could not be written; `logging` calls this."""
        error = sys.exc_info()[1]
        root = logging.getLogger()
        if self in root.handlers:  # else another thread has removed it meanwhile
            root.removeHandler(self)
            if self.stream:
                with suppress(OSError):  # else Python would complain of the lines left in its buffer
                    self.stream.close()
            _to_standard_error(logging.NOTSET)
            log.error("logging to %s stopped: %s", self.baseFilename, error)
        if record.levelno < logging.ERROR:  # errors are already on standard error
            root.handle(record)


def log_to(settings: LogSettings, agent: int) -> None:
    """Log to standard error, which systemd keeps; with a folder, to rotating files, and errors to both.

    If the folder is not writable, log this and use standard error.
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
        log.error("cannot log to %s: %s", folder, error)
        return
    _to_standard_error(logging.ERROR)
    files.setFormatter(LogFormatter())
    root.addHandler(files)


def _to_standard_error(level: int) -> None:
    """Set the level of the existing handlers."""
    for handler in logging.getLogger().handlers:
        handler.setLevel(level)
