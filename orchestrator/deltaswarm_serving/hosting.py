"""The processes of sessions under way: start one, hear of its end, and let it go."""

import asyncio
import json
import os
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from deltaswarm_operator.station.room import Room
from deltaswarm_scenario.page_messages import made
from deltaswarm_sessions import PROCESSES
from deltaswarm_sessions.links import Link
from deltaswarm_sessions.roster import WHOLE

MOVED = json.dumps(made("moved", address="../"))
"""What a page of a session is told that is not under way: the door says why."""


@dataclass
class Plan:
    """What all sessions of a study have in common."""

    file: Path
    out: Path
    language: str = ""
    is_pilot: bool = False
    share: tuple[int, int] = WHOLE
    """Which of how many shares of the numbers are given."""
    is_by_processes: bool = False
    """Whether each agent is a process."""
    options: tuple[str, ...] = ()
    """More options of each session's process."""
    terminal: tuple[int, int] | None = None
    """Standard output and error of the processes; None: each has a log."""

    @property
    def logs(self) -> Path:
        return self.out / "logs"


@dataclass(eq=False)
class Hosted:
    """One session under way: its process, and its pages, which stay when the process is another."""

    link: Link
    pages: Room = field(default_factory=lambda: Room(lambda: None))
    desk: Room = field(default_factory=lambda: Room(lambda: None))
    """The conductor's pages."""
    process: asyncio.subprocess.Process | None = None
    seen_s: float = field(default_factory=time.monotonic)
    """When somebody was at the page last (monotonic)."""
    is_let_go: bool = False
    """Whether its process was ended from here."""
    code: int | None = None
    """How the newest process that has ended did so."""
    _ends: list[socket.socket] = field(default_factory=list)
    _ends_runs: bool = False
    """Whether its process ends a run in order, as nothing can go on within one."""

    async def start(self, plan: Plan, on_end: Callable[["Hosted", int], None]) -> None:
        """Start the process; `on_end` gets its exit code, below 0 if a signal ended it. Raises OSError."""
        pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)]
        theirs = [pair[1] for pair in pairs]
        options = {
            "--session": plan.file,
            "--participant": self.link.number,
            "--out": plan.out,
            "--channel-fd": theirs[0].fileno(),
            "--conductor-fd": theirs[1].fileno(),
            **({"--language": plan.language} if plan.language else {}),
        }
        words = [str(word) for option in options.items() for word in option] + ["--pilot"] * plan.is_pilot
        words += ["--quiet"] if plan.terminal is None else []
        words += ["--agents", PROCESSES] if plan.is_by_processes else []
        log = None if plan.terminal else self._log(plan)
        out, error = plan.terminal or (log, log)
        try:
            self.process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "deltaswarm_serving.hosted", *words, *plan.options),
                pass_fds=[end.fileno() for end in theirs],
                stdin=asyncio.subprocess.DEVNULL,
                stdout=out,
                stderr=error,
                start_new_session=True,  # Ctrl-C is for the service alone
            )
        finally:
            if log is not None:
                os.close(log)
            for end in theirs:
                end.close()
        self._ends, self.is_let_go, self._ends_runs = [pair[0] for pair in pairs], False, plan.is_by_processes
        for room, end in zip((self.pages, self.desk), self._ends, strict=True):
            room.follow(end)
        asyncio.get_running_loop().create_task(self._watch(self.process, on_end))

    def _log(self, plan: Plan) -> int:
        file = plan.logs / f"participant-{self.link.number:03}.log"
        return os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    async def _watch(self, process: asyncio.subprocess.Process, on_end: Callable[["Hosted", int], None]) -> None:
        self.code = code = await process.wait()
        for room in (self.pages, self.desk):
            room.hear()  # what it said last
            room.leave()
        for end in self._ends:
            end.close()
        self.process = None
        on_end(self, code)

    def let_go(self) -> None:
        """End the process; another one goes on where it was, or with the next run if agents are processes."""
        self.is_let_go = True
        if self.process is not None:
            with suppress(ProcessLookupError):
                self.process.send_signal(signal.SIGTERM if self._ends_runs else signal.SIGKILL)

    async def gone(self) -> None:
        """Wait until the process has ended, which takes a while if it ends a run."""
        if (process := self.process) is not None:
            await process.wait()

    def absent_s(self, now_s: float) -> float:
        """Return for how long nobody has been at the page [s]."""
        if self.pages.has_person:
            self.seen_s = now_s
        return now_s - self.seen_s
