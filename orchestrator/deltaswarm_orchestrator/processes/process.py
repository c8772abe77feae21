"""One started process, watched through its own pidfd, because the fork server may be stopped or killed."""

import os
import re
import select
import signal
import time
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from shutil import disk_usage

from deltaswarm_orchestrator.base.kernel import is_stopped
from deltaswarm_orchestrator.processes.fork_server import wake_fork_server
from deltaswarm_wire.child import ENDED_BY_CONDUCTOR, GAVE_UP, LIMIT_REACHED, NO_ROOM, WORLD_LOST, ended_by
from deltaswarm_wire.keys import AGENT

LOG_TAIL_LINES = 12
UNKNOWN = 255
"""Exit code of a process whose fork server cannot tell how it ended."""

HOW = {
    UNKNOWN: "ended for an unknown reason",
    WORLD_LOST: "lost its world",
    LIMIT_REACHED: "ended because this machine or user may have no more processes, threads, open files or memory",
}
"""Meaning of some exit codes, to follow the part's name in a sentence."""

LAST_WORDS = re.compile(
    r"^\S+ \S+ CRITICAL deltaswarm\.(\w+): (.*)((?:\nTraceback .*(?:\n(?!\d{4}-\d\d-\d\d ).*)*)?)", re.MULTILINE
)
"""The log line in which a part, named by its role, says why it fails, and the traceback below it, if there is one."""

ENDED_BY = {ended_by(number): number.name for number in signal.Signals}
"""The signals that parts heed, by the exit codes with which they then end."""

POLL_S, SHORT_POLL_S = 0.2, 0.01
EXIT_CODE_WITHIN_S = 3.0
"""Maximum wait for the fork server to tell a process's exit code [s]."""


def _free(folder: Path) -> str:
    try:
        return f"{disk_usage(folder).free:,} bytes are free there"
    except OSError as error:
        return str(error.strerror)


class RunPart:
    """A part of a run, on this machine or on another: how it ended, and its log here."""

    def __init__(self, role: str, number: int, log_file: Path, log_begins_at: int = 0) -> None:
        self.role = role
        self.number = number
        self.log_file = log_file
        self._log_begins_at = log_begins_at
        self.name = f"{role} {number}" if role == AGENT or number else role
        self.ends_as_planned = False
        """Whether its end needs no line: a fault of the scenario killed it, it was stopped when the run ended, or it
        was lost with its machine, which has a line."""
        self.was_asked_to_end = False
        """Whether the orchestrator has sent it SIGTERM."""
        self.outlasted = ""
        """State of its process when the orchestrator ended it after the run; empty if it had ended by itself."""
        self.seen = ""
        """Where the run was when its end was seen; the world may know the step."""

    @property
    def exit_code(self) -> int | None:
        """The exit code: None while the part runs, negative the signal that killed it, UNKNOWN if not known."""
        raise NotImplementedError

    def how_it_ended(self, when: str = "") -> str:
        """Describe in one line how the part ended, and when, if that is known."""
        code, when = self.exit_code or 0, when and f" {when}"
        if code == NO_ROOM:
            folder = self.log_file.parents[1]
            return f"{self.name} could not write into {folder}: {_free(folder)}"
        if self.was_ended_here:
            return f"{self.name} stopped answering{when} ({self.outlasted}); the orchestrator ended it after the run"
        if code < 0:
            return f"{self.name} was killed by {signal.Signals(-code).name}{when}"
        if code in ENDED_BY:
            return f"{self.name} was ended by {ENDED_BY[code]}{when}"
        words, _ = self._last_words()
        if code == GAVE_UP and words:  # what happened first is what the part waited for in vain
            return f"{words}: {self.name} ended the run{when}"
        cause = words and f": {words}"
        return f"{self.name} {HOW.get(code, f'ended with exit code {code}')}{when}{cause}"

    @property
    def was_ended_here(self) -> bool:
        """Whether a signal of the orchestrator ended it, after the run."""
        code = self.exit_code or 0
        return bool(self.outlasted) and (code < 0 or code in ENDED_BY)

    @property
    def has_failed(self) -> bool:
        """Whether it has ended with an error that neither the scenario nor the orchestrator caused."""
        if self.exit_code in (None, 0, ENDED_BY_CONDUCTOR) or self.ends_as_planned:
            return False
        return not (self.was_asked_to_end and self.exit_code in (ended_by(signal.SIGTERM), -signal.SIGTERM))

    @property
    def trace(self) -> str:
        """The traceback below its last words, such as a plug-in's; "" without one."""
        return self._last_words()[1].strip("\n")

    def log_tail(self) -> str:
        """Return the last lines of the log, for an error message; empty if they tell no more than `how_it_ended`."""
        words, _ = self._last_words()
        if words and self._log().rstrip().endswith(words):
            return ""
        return "\n".join(f"    {line}" for line in self._log().splitlines()[-LOG_TAIL_LINES:])

    def _last_words(self) -> tuple[str, str]:
        """Return why it failed, in its own words, and the traceback below; empty if it has not said so."""
        said = [(words, below) for role, words, below in LAST_WORDS.findall(self._log()) if role == self.role]
        return said[-1] if said else ("", "")

    def _log(self) -> str:
        """Return the log of this process, to which an earlier process of the same part may have written, too."""
        try:
            return self.log_file.read_bytes()[self._log_begins_at :].decode(errors="replace")
        except OSError:
            return ""


class Part(RunPart):
    """One started process of this machine."""

    def __init__(
        self, role: str, number: int, process: ForkServerProcess, log_file: Path, log_begins_at: int = 0
    ) -> None:
        super().__init__(role, number, log_file, log_begins_at)
        self.is_stopped = False
        """Whether a fault of the scenario has stopped the process (SIGSTOP)."""
        self.pid = process.pid or 0
        self._process = process
        try:
            self.pidfd: int | None = os.pidfd_open(self.pid)
        except ProcessLookupError:
            self.pidfd = None
        self._ended_at: float | None = None
        self._code: int | None = None

    @property
    def exit_code(self) -> int | None:
        """The exit code: None while the process runs, negative the signal that killed it, UNKNOWN if not known.

        It may stay None for EXIT_CODE_WITHIN_S after the end, until the fork server tells it.
        """
        if self.pidfd is not None and not _is_over(self.pidfd):
            return None
        self._ended_at = self._ended_at or time.monotonic()
        if self._code is None:
            code = self._process.exitcode
            self._code = code if code != UNKNOWN else self._code_of_orphan()
        if self._code is None:
            wake_fork_server()  # it cannot tell while it is stopped
            return UNKNOWN if time.monotonic() > self._ended_at + EXIT_CODE_WITHIN_S else None
        return self._code

    def _code_of_orphan(self) -> int | None:
        """Return the exit code of a process whose fork server has ended too, once this process has adopted it."""
        if self.pidfd is None:
            return None
        try:
            end = os.waitid(os.P_PIDFD, self.pidfd, os.WEXITED | os.WNOHANG)
        except ChildProcessError:
            return None
        return end and (end.si_status if end.si_code == os.CLD_EXITED else -end.si_status)

    @property
    def was_stopped(self) -> bool:
        """Whether a signal that is no fault of the scenario keeps the process stopped."""
        return not self.is_stopped and is_stopped(self.pid)

    def note_state(self) -> None:
        """Note what the process does, before it is ended."""
        self.outlasted = "its process was stopped, as by SIGSTOP" if self.was_stopped else "its process ran on"

    def send(self, number: signal.Signals) -> None:
        self.was_asked_to_end |= number == signal.SIGTERM
        if self.pidfd is not None:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self.pidfd, number)

    def close(self) -> None:
        if self.pidfd is not None:
            os.close(self.pidfd)
            self.pidfd = None


def wait_for(parts: Iterable[Part], within_s: float) -> list[Part]:
    """Wait until all parts have ended, at most `within_s` [s]; return those that have not."""
    deadline = time.monotonic() + within_s
    while running := [part for part in parts if part.exit_code is None]:
        left_s = deadline - time.monotonic()
        if left_s <= 0:
            return running
        there = [part for part in running if part._ended_at is None]
        poll = select.poll()
        for part in there:
            poll.register(part.pidfd or -1, select.POLLIN)
        poll.poll(1000 * min(left_s, POLL_S if len(there) == len(running) else SHORT_POLL_S))
    return []


def _is_over(pidfd: int) -> bool:
    poll = select.poll()
    poll.register(pidfd, select.POLLIN)
    return bool(poll.poll(0))
