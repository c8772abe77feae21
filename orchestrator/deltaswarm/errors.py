"""The exception of this package: its text is what the command line prints, and its code the exit code."""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from deltaswarm_orchestrator.base import disk
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, USAGE, CommandError
from deltaswarm_orchestrator.base.limits import reached
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.extras import missing_by
from deltaswarm_wire.files import Written
from deltaswarm_wire.plugin_errors import PluginError, blamed, distinct
from deltaswarm_wire.reading import working_folder_problem


class Error(Exception):
    """A mistake, or something that failed; the text has a line for each.

    Args:
        lines: what the command line prints, after its name.
        code: the exit code of the command line: 1 failed, 2 a mistake, 130 interrupted.
        traces: the tracebacks of plug-ins that raised, each from the plug-in's own frame on.
    """

    def __init__(self, *lines: str, code: int = USAGE, traces: tuple[str, ...] = ()) -> None:
        super().__init__("\n".join(lines))
        self.lines, self.code, self.traces = lines, code, traces
        for trace in traces:
            self.add_note(trace)


def of_settings(error: SettingsError) -> Error:
    """Return the error to show for mistakes in settings."""
    traces = distinct({str(problem): problem.trace for problem in error.problems if problem.trace})
    return Error(*map(str, error.problems), traces=(*traces,))


def of_plugin(error: PluginError) -> Error:
    """Return the error to show for a plug-in that failed."""
    return Error(str(error), code=FAILED, traces=(error.trace,) if error.trace else ())


def error_of(error: BaseException, command: str) -> Error | None:
    """Return the error to show; None for an exception that only a bug in deltaswarm can cause."""
    if isinstance(error, Error):
        return error
    if isinstance(error, SettingsError):
        return of_settings(error)
    if isinstance(error, CommandError):
        return Error(str(error), code=error.code)
    if plugin := blamed(error):
        return of_plugin(plugin)
    if isinstance(error, KeyboardInterrupt):
        return Error("interrupted", code=INTERRUPTED)
    if isinstance(error, OSError | MemoryError | RuntimeError) and (limit := reached(error)):
        return Error(f"{command} failed: {limit}; {Written.summary()}", code=FAILED)
    if isinstance(error, OSError):
        return Error(_of_system(error, command), code=FAILED)
    if needs := missing_by(error):
        return Error(f"{command} {needs}")
    return None


def _of_system(error: OSError, command: str) -> str:
    """Say which file could not be read or written and why, and which files were written before."""
    reason, written = error.strerror or str(error), Written.summary()
    if isinstance(error, shutil.Error):  # of a copied folder: source, target and reason of each file
        reason = str(error.args[0][0][2])
    if error.filename is None:
        return f"{command} failed: {working_folder_problem() or reason}; {written}"
    if disk.is_refused(error):
        return f"{os.fsdecode(error.filename2 or error.filename)} could not be written: {reason}; {written}"
    named = f"{os.fsdecode(error.filename)} could not be read or written: {reason}"
    return f"{named}; {written}" if Written.count else named


_OPTION = re.compile(r"(?P<command>deltaswarm [a-z][^;`]*)|(?P<by>by )?(?<![\w`/-])--(?P<name>[a-z-]+)(?![\w-])")
"""An option in a message, except in a command line."""

IN_PYTHON = {
    "commands": "commands",
    "engine": "engine",
    "force": "force=True",
    "in-process": "engine='in-process'",
    "jobs": "jobs",
    "out": "out",
    "processes": "engine='processes'",
    "record": "the key record =",
    "repeats": "replicates",
    "scheduler": "scheduler",
    "seed": "seed",
    "set": "keys",
}
"""What is given by an option on the command line, as functions take it."""


def in_python(text: str) -> str:
    """Return a message of the command line with its options as a caller from Python gives them."""

    def named(option: re.Match[str]) -> str:
        name = IN_PYTHON.get(option["name"] or "")
        by = option["by"] or ""
        return option[0] if name is None else f"{'in ' if by and name == 'keys' else by}{name}"

    return _OPTION.sub(named, text)


@contextmanager
def one_error(command: str) -> Iterator[None]:
    """Raise what the user should see as `Error`; `command` names in messages what was asked for.

    Raises:
        Error: as above; Ctrl-C, and bugs of deltaswarm itself, pass.
    """
    try:
        yield
    except Exception as error:
        if (told := error_of(error, command)) is None:
            raise
        raise Error(*map(in_python, told.lines), code=told.code, traces=told.traces) from None
