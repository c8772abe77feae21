"""Standard output and error of commands, which may be closed, full, or no longer read."""

import errno
import io
import select
import sys
from typing import Any

from deltaswarm_wire.logs import open_standard_streams


class OutputError(Exception):
    """Standard output cannot be written.

    Attributes:
        is_unread: the reader has seen enough, as `head`; that is no reason to complain.
    """

    def __init__(self, error: OSError) -> None:
        super().__init__(f"standard output could not be written: {error.strerror}")
        self.is_unread = error.errno == errno.EPIPE


class Output(io.FileIO):
    """The descriptor of standard output or error. After its first failure it discards what it is given.

    Attributes:
        is_needed: whether that failure raises OutputError, since the output is all that a command makes.
        error: the failure.
    """

    def __init__(self, descriptor: int, *, is_needed: bool) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self.is_needed = is_needed
        self.error: OutputError | None = None

    def write(self, data: Any) -> int:
        """Write some of the data, and return how much; a descriptor that does not block is waited for.

        Raises:
            OutputError: see the class.
        """
        while self.error is None:
            try:
                written = super().write(data)
            except OSError as error:
                self.error = OutputError(error)
                if self.is_needed:
                    raise self.error from None
            else:
                if written is not None:
                    return written
                select.select([], [self], [])
        return len(data)


def open_outputs() -> None:
    """Make standard output and error `Output`s, which replace characters that their encoding lacks."""
    open_standard_streams()
    for name in ("stdout", "stderr"):
        before = getattr(sys, name)
        text = io.TextIOWrapper(
            io.BufferedWriter(Output(before.fileno(), is_needed=name == "stdout")),
            encoding=before.encoding,
            errors="replace",
            line_buffering=before.line_buffering,
            write_through=before.write_through,
        )
        setattr(sys, name, text)


def standard_output() -> Output | None:
    """Return the `Output` below standard output; None if `open_outputs` was not called or something else took over."""
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw if isinstance(raw, Output) else None
