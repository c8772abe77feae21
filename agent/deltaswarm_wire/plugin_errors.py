"""Errors of plug-ins: one line for people, and the traceback from the plug-in's own frame on.

A plug-in may raise anything: an error that means bad input, a full disk or an interruption elsewhere in deltaswarm must
not be taken for that. So every caller of a plug-in turns what it raises into a `PluginError`.
"""

import signal
import traceback
from collections.abc import Iterator, Mapping
from itertools import takewhile
from types import FrameType, TracebackType

PACKAGES = frozenset(
    f"deltaswarm{part}"
    for part in (
        *("", "_cli", "_field", "_wire", "_scenario", "_agent", "_world", "_operator", "_orchestrator", "_serving"),
        *("_board", "_ros2", "_studies", "_sessions", "_branches", "_cluster", "_dense", "_learn", "_physics"),
    )
)
"""Packages whose frames are not a plug-in's."""

MAX_DESCRIBED = 400
"""Characters of a plug-in's error text."""

FIRST_LINES, LAST_LINES = 20, 40
"""Lines that are kept of a longer traceback, such as that of an endless recursion."""

_plugins: set[str] = set()
"""Top-level packages that were loaded as plug-ins."""


class PluginError(Exception):
    """A plug-in raised, or returned something invalid.

    Args:
        text: what failed.
        error: what the plug-in raised; None if it raised nothing.
        function: what was called, whose definition is shown if the error passed no frame of the plug-in.

    Attributes:
        kind: the type of `error`; "" without one.
        where: `file:line` of the plug-in's last frame, or of `function`; "" if there is neither.
        trace: the traceback from the plug-in's own frame on, which ends with the exception; "" without an error, and
            if it had only deltaswarm's frame that caught what C raised, such as pickle.
    """

    def __init__(self, text: str, error: BaseException | None = None, function: object = None) -> None:
        self.kind = self.where = self.trace = ""
        if error is not None:
            self.kind, self.trace = type(error).__name__, _trace(error)
            self.where = _where(error) or (defined_at(function) if function else "")
            text = f"{text}: {described(error)}" + (f" ({self.where})" if self.where else "")
        super().__init__(text)

    @property
    def report(self) -> str:
        """The line, with the traceback below it."""
        return "\n".join(filter(None, (str(self), self.trace)))


def note_plugin(module: str) -> None:
    """Note a module that is loaded as a plug-in, so that `blamed` knows its frames."""
    package = module.partition(".")[0]
    if package not in PACKAGES:
        _plugins.add(package)


def blamed(error: BaseException) -> PluginError | None:
    """Return an error as the plug-in's through whose frames it came; None if it came through none or is a signal's."""
    if is_interrupt(error):
        return None
    frames = _frames(error.__traceback__)
    if isinstance(error, PluginError) and not (frames and _package(frames[-1]) in _plugins):
        return error
    for frame in frames:
        if _package(frame) in _plugins:
            failed = PluginError(f"{_module(frame)}:{frame.f_code.co_qualname} failed", error)
            failed.__cause__ = error
            return failed
    return None


def is_interrupt(error: BaseException) -> bool:
    """Whether a signal's handler raised KeyboardInterrupt, and not a plug-in."""
    if not isinstance(error, KeyboardInterrupt):
        return False
    frames = _frames(error.__traceback__)
    return not frames or _package(frames[-1]) in PACKAGES or _default_handler_is_set()


def _default_handler_is_set() -> bool:
    """Whether Python itself raises KeyboardInterrupt, without a frame by which it could be told apart."""
    return signal.getsignal(signal.SIGINT) is signal.default_int_handler


def own_traceback(error: BaseException) -> TracebackType | None:
    """Return a traceback from the plug-in's own frame on; of what comes with deltaswarm and fails, the whole one."""
    steps = list(_steps(error.__traceback__))
    for step in steps:
        if _package(step.tb_frame) in _plugins:
            return step
    return error.__traceback__ if steps and _package(steps[-1].tb_frame) in PACKAGES else None


def described(error: BaseException) -> str:
    """Describe an error in one line of printable characters."""
    try:
        text = str(error)
    except Exception:
        text = "(without a text)"
    line = " ".join(": ".join(filter(None, (type(error).__name__, text.strip()))).split())
    line = "".join(character if character.isprintable() else "?" for character in line[: MAX_DESCRIBED + 1])
    return line if len(line) <= MAX_DESCRIBED else f"{line[: MAX_DESCRIBED - 3]}..."


def defined_at(function: object) -> str:
    """Return `file:line` of the definition of a function or class, for people."""
    if code := getattr(function, "__code__", None):
        return f"{code.co_filename}:{code.co_firstlineno}"
    import inspect  # slow to import, and needed for classes alone

    try:
        return f"{inspect.getsourcefile(function)}:{inspect.findsource(function)[1] + 1}"  # type: ignore[arg-type]
    except (OSError, TypeError):
        return "not written in Python"


def distinct(traces: Mapping[str, str]) -> dict[str, list[str]]:
    """Return who has each traceback, by the traceback; those that differ in the exception's text alone count as one."""
    shown: dict[str, str] = {}
    whose: dict[str, list[str]] = {}
    for name, trace in traces.items():
        frames = "\n".join(line for line in trace.splitlines() if line.startswith("  "))
        whose.setdefault(shown.setdefault(frames, trace), []).append(name)
    return whose


def _steps(own: TracebackType | None) -> Iterator[TracebackType]:
    while own is not None:
        yield own
        own = own.tb_next


def _frames(own: TracebackType | None) -> list[FrameType]:
    return [step.tb_frame for step in _steps(own)]


def _module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _package(frame: FrameType) -> str:
    return _module(frame).partition(".")[0]


def _where(error: BaseException) -> str:
    """Return `file:line` of the plug-in's last frame; of a syntax error, its own."""
    if own := [step for step in _steps(own_traceback(error)) if _package(step.tb_frame) in _plugins]:
        return f"{own[-1].tb_frame.f_code.co_filename}:{own[-1].tb_lineno}"
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}:{error.lineno}"
    return ""


def _trace(error: BaseException) -> str:
    own = own_traceback(error)
    if own is not None and own.tb_next is None and _package(own.tb_frame) in PACKAGES and error.__context__ is None:
        return ""
    frames = [frame.f_code for frame in _frames(own)]
    callers = {step.tb_frame.f_code for step in takewhile(lambda step: step is not own, _steps(error.__traceback__))}
    # An error that is raised once more still has the frames of the last time below those of this time.
    limit = next((at for at, code in enumerate(frames) if code in callers), None)
    report = traceback.TracebackException(type(error), error, own, limit=limit, compact=True)
    lines = "".join(report.format()).rstrip().splitlines()
    if len(lines) > FIRST_LINES + LAST_LINES:
        left_out = f"  ... {len(lines) - FIRST_LINES - LAST_LINES} lines ..."
        lines = [*lines[:FIRST_LINES], left_out, *lines[-LAST_LINES:]]
    return "\n".join(lines)
