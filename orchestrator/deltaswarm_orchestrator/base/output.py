"""Standard output and error of commands: they may be closed, full, or no longer read."""

import errno
import io
import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

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
        """Write some of the data, and return how much; a descriptor that does not block is waited for."""
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
        before, is_needed = getattr(sys, name), name == "stdout"
        # A copy of its descriptor, since `only_results` gives the descriptor itself to plug-ins.
        descriptor = os.dup(before.fileno()) if is_needed else before.fileno()
        text = io.TextIOWrapper(
            io.BufferedWriter(Output(descriptor, is_needed=is_needed)),
            encoding=before.encoding,
            errors="replace",
            line_buffering=before.line_buffering,
            write_through=before.write_through,
        )
        setattr(sys, name, text)


def standard_output() -> Output | None:
    """Return the `Output` below standard output; None if `open_outputs` was not called or something else took over."""
    raw = getattr(getattr(results(), "buffer", None), "raw", None)
    return raw if isinstance(raw, Output) else None


class _Results:
    """Where results are printed; None: on standard output as it is."""

    stream: TextIO | None = None


def results() -> TextIO:
    """Return the stream for what a command prints as its result."""
    return _Results.stream or sys.stdout


def print_result(text: str) -> None:
    print(text, file=results(), flush=True)


@contextmanager
def results_on(stream: TextIO) -> Iterator[None]:
    before, _Results.stream = _Results.stream, stream
    try:
        yield
    finally:
        _Results.stream = before


@contextmanager
def only_results(*, to_the_end: bool = False) -> Iterator[None]:
    """Keep standard output for results: what plug-ins print, by whatever means, goes to standard error.

    `to_the_end`: until the process ends, if it is a command's own, since a plug-in's threads may go on printing.
    """
    output, stream, before = standard_output(), results(), sys.stdout
    stream.flush()
    sys.stdout = sys.stderr
    if output is not None:
        os.dup2(2, 1)
    with results_on(stream):
        try:
            yield
        finally:
            stream.flush()
            if output is None or not to_the_end:
                sys.stdout = before
            if output is not None and not to_the_end:
                os.dup2(output.fileno(), 1)
