"""Start single processes of a run from the fork server."""

import multiprocessing
import multiprocessing.process
import os
import select
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import limits
from deltaswarm_orchestrator.base.advice import option_words
from deltaswarm_orchestrator.base.kernel import adopt_orphans, end_orphans
from deltaswarm_orchestrator.base.signals import spared_by_ctrl_c
from deltaswarm_orchestrator.processes import entry_point
from deltaswarm_orchestrator.processes.entry_point import FORK_SERVER, Inherited
from deltaswarm_orchestrator.processes.fork_server import (
    bare_main_module,
    fork_server_problem,
    kill_fork_server,
    place_sockets,
    safe_path,
    wake_fork_server,
)
from deltaswarm_orchestrator.processes.process import UNKNOWN, Part, wait_for
from deltaswarm_orchestrator.processes.station import STATION
from deltaswarm_wire.keys import AGENT, OPERATOR, WORLD
from deltaswarm_wire.plugins import CONTROLLERS

MODULES = {role: f"deltaswarm_{role}.__main__" for role in (AGENT, WORLD, OPERATOR)}
MODULES[STATION] = "deltaswarm_operator.station.__main__"
REPLAY = "replay"
"""The role of who feeds a page with what was recorded."""
MODULES[REPLAY] = "deltaswarm_operator.io.replaying"
"""The main module of each role. Parts are referred to by module name and not imported here."""

PRELOADED = [
    "deltaswarm_orchestrator.processes.fork_server_setup",
    "zenoh",
    "msgpack",
    MODULES[AGENT],
    entry_point.__name__,
]
"""Imported once by the fork server and shared by all agents, as is a shipped controller."""

Options = Mapping[str, object]
"""Options of a command line: True is a flag, a list repeats its option, None and False leave it out."""

STARTED: set[Any] = getattr(multiprocessing.process, "_children", set())
"""Python's own list of started processes. Each start polls all of them, which costs seconds in a thousand starts. Parts
are taken off the list, since `Part` watches them and `Starter.end` ends them."""

NO_CHANNELS: Mapping[str, socket.socket] = {}

BEFORE_READY = "before it was ready"
END_WITHIN_S = 5.0
PYTHON_S = 8.0
"""Time that a process may take to import its modules, on top of its start timeout [s]."""

WAKE_EVERY_S = 0.5
"""Interval at which a fork server that is starting a process is continued, in case somebody has stopped it [s]."""

FORK_SERVERS = 4
"""Attempts to start a process, each after the first one with a new fork server."""

HANDSHAKE_MS = 60_000
"""Time in which a client must have joined the router; Zenoh's 10 s are too short when a thousand do so at once."""

LEASE, ZENOH_LEASE_MS = "transport/link/tx/lease", 10_000
"""Zenoh's setting for the silence after which a link is lost, and its default."""

LEASE_MS_PER_AGENT = 60

OTHER_SESSIONS = 64
"""Room for sessions besides the agents': operator, recorder, and processes replaced before the router notices."""


class LaunchError(Exception):
    """A required part did not start, or ended too early; `log` has its last log lines, if it has any."""

    def __init__(self, text: str, log: str = "") -> None:
        super().__init__(text)
        self.reason, self.log = text, log

    def __str__(self) -> str:
        return f"{self.reason}:\n{self.log}" if self.log else self.reason


class StoppedError(Exception):
    """The user asked to stop before the run had begun."""


class Starter:
    """Starts processes that end with this one, and that log into the folder `logs`.

    The controller `mode` is loaded once for all agents if it is shipped. Parts have `timeout_s` to become ready,
    besides importing [s]. `was_stopped` returns something true once the user has asked to stop.
    """

    def __init__(self, logs: Path, mode: str, timeout_s: float, was_stopped: Callable[[], object]) -> None:
        if problem := fork_server_problem():
            raise LaunchError(problem)
        adopt_orphans(do_so=True)  # without it, the exit codes of all parts would be lost with the fork server
        self.parts: list[Part] = []
        self._ended: list[Part] = []
        self._ends = select.epoll()
        """Of the processes that have not been seen to end. The kernel tells ends in their order."""
        self._logs = logs
        self._controller, _, _ = CONTROLLERS.shipped.get(mode, "").partition(":")
        self._timeout_s = timeout_s
        self._was_stopped = was_stopped
        self._context = multiprocessing.get_context("forkserver")
        place_sockets()
        self._lifeline, self._kept_end = multiprocessing.Pipe(duplex=False)

    def ended(self) -> list[Part]:
        by_handle = {part.pidfd: part for part in self.parts}
        self._ended += [by_handle[handle] for handle, _ in self._ends.poll(0, len(by_handle) + 1)]
        return [part for part in self._ended if part.exit_code is not None]

    def end(self, *, at_once: bool = False) -> None:
        """End all parts that still run, and what they started; with `at_once` by SIGKILL alone, not SIGTERM first."""
        for part in wait_for(self.parts, 0):
            part.note_state()
            if part.is_stopped:
                part.ends_as_planned = True
                part.send(signal.SIGKILL)  # a stopped process cannot act on SIGTERM
        try:
            if not at_once:
                for part in wait_for(self.parts, 0):
                    part.send(signal.SIGTERM)
                    part.send(signal.SIGCONT)  # wakes a process that the user has stopped
                wait_for(self.parts, END_WITHIN_S / 2)
        finally:  # a second signal may end the wait
            for part in wait_for(self.parts, 0):
                part.send(signal.SIGKILL)
            wait_for(self.parts, END_WITHIN_S)
            if server := FORK_SERVER._forkserver_pid:  # none has started if the world could not
                end_orphans(server)  # what a controller has started
            if any(part.exit_code == UNKNOWN for part in self.parts):
                kill_fork_server()  # it no longer answers; it, or a caller waiting for it, would be left behind
            for part in self.parts:
                part.close()
            self._ends.close()
            self._kept_end.close()
            self._lifeline.close()
            adopt_orphans(do_so=False)

    def start(
        self,
        role: str,
        number: int,
        options: Options,
        *,
        password: str = "",
        ready: Connection | None = None,
        channels: Mapping[str, socket.socket] = NO_CHANNELS,
    ) -> Part:
        """Start a part with its password, if it has one, and its ends of channels between operator and pages.

        It says on `ready` that it is ready. A fork server that ends meanwhile is replaced.
        """
        log_file = self._logs / f"{role}-{number}.log"
        log_begins_at = log_file.stat().st_size if log_file.exists() else 0
        inherited = Inherited(self._lifeline, ready, channels)
        process = self._context.Process(
            target=entry_point.main,
            args=(MODULES[role], option_words(options), password, log_file, inherited),
            kwargs={"in_background": role != WORLD},
            name=f"deltaswarm-{role}-{number}",
            daemon=True,
        )
        with bare_main_module(), safe_path(), spared_by_ctrl_c():
            self._context.set_forkserver_preload([*PRELOADED, *([self._controller] if self._controller else [])])
            self._start(process)
        STARTED.discard(process)
        self.parts.append(part := Part(role, number, process, log_file, log_begins_at))
        if part.pidfd is None:
            self._ended.append(part)
        else:
            self._ends.register(part.pidfd, select.EPOLLIN | select.EPOLLONESHOT)
        return part

    def _start(self, process: ForkServerProcess) -> None:
        for tries_left in reversed(range(FORK_SERVERS)):
            try:
                with self._start_deadline():
                    process.start()
                return
            except (OSError, EOFError, ValueError) as error:
                limit = limits.reached(error)
                if limit or not tries_left:
                    why = limit or f"the fork server ended ({error!r})"
                    raise LaunchError(f"{process.name} cannot be started: {why}") from None
            if self._was_stopped():
                raise StoppedError
            if server := FORK_SERVER._forkserver_pid:
                kill_fork_server()
                end_orphans(server, [part.pid for part in self.parts])  # a process that it could not tell of
            place_sockets()

    def start_and_read(
        self,
        role: str,
        number: int,
        options: Options,
        *,
        password: str = "",
        channels: Mapping[str, socket.socket] = NO_CHANNELS,
    ) -> str:
        """Start a part that says where it listens once it is ready; return that line."""
        reader, writer = multiprocessing.Pipe(duplex=False)
        part = self.start(role, number, options, password=password, ready=writer, channels=channels)
        writer.close()
        text = b""
        deadline = time.monotonic() + self._timeout_s + PYTHON_S
        with reader:
            while not text.endswith(b"\n"):
                if self._was_stopped():
                    raise StoppedError
                if time.monotonic() > deadline:
                    raise LaunchError(f"{part.name} was not ready within {self._timeout_s:g} s")
                if wait([reader], 0.1):
                    if not (more := os.read(reader.fileno(), 4096)):
                        break
                    text += more
        if not text.strip():
            wait_for([part], END_WITHIN_S)
            raise LaunchError(part.how_it_ended(BEFORE_READY), part.log_tail())
        return text.decode().strip()

    @contextmanager
    def _start_deadline(self) -> Iterator[None]:
        """Continue a stopped fork server, which would block the caller forever; kill it if a start takes too long."""
        started = threading.Event()
        deadline = time.monotonic() + self._timeout_s + PYTHON_S

        def watch() -> None:
            while not started.wait(WAKE_EVERY_S):
                wake_fork_server()
                if time.monotonic() > deadline:
                    kill_fork_server()
                    return

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            started.set()
            thread.join()


def room_for(agents: int) -> list[tuple[str, str]]:
    """Return Zenoh settings for router and clients that let all agents join at once.

    Zenoh's defaults are 1,000 sessions, 100 handshakes at a time, and links that are lost after 10 s of silence, in
    which a process may get no turn while very many others start.
    """
    sessions = str(agents + OTHER_SESSIONS)
    rooms = [(f"transport/unicast/{name}", sessions) for name in ("max_sessions", "accept_pending")]
    if agents * LEASE_MS_PER_AGENT > ZENOH_LEASE_MS:
        rooms.append((LEASE, str(agents * LEASE_MS_PER_AGENT)))
    return rooms + [(f"transport/unicast/{side}_timeout", str(HANDSHAKE_MS)) for side in ("open", "accept")]
