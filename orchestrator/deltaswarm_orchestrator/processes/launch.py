"""The processes of one run: start them from a fork server, and shut them down with no orphans."""

import multiprocessing
import os
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from deltaswarm_orchestrator.base.kernel import adopt_orphans
from deltaswarm_orchestrator.processes import child
from deltaswarm_orchestrator.processes.fork_server import (
    bare_main_module,
    fork_server_problem,
    kill_fork_server,
    safe_path,
)
from deltaswarm_orchestrator.processes.passwords import Passwords
from deltaswarm_orchestrator.processes.process import UNKNOWN, Part, wait_for
from deltaswarm_orchestrator.processes.station import STATION, Station, write_briefing
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.results.run_tables import write_json
from deltaswarm_scenario.fault import FREEZE
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checkpoint
from deltaswarm_wire.access import user_name
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER, WORLD
from deltaswarm_wire.orders import KILL, START, STOP, ProcessOrder
from deltaswarm_wire.plugins import CONTROLLERS
from deltaswarm_wire.session import PASSWORD_VARIABLE, RouterLink, Tls

MODULES = {role: f"deltaswarm_{role}.__main__" for role in (AGENT, WORLD, OPERATOR)}
MODULES[STATION] = "deltaswarm_operator.station.__main__"
"""The main module of each role. Parts are referred to by module name and not imported here."""

PRELOADED = ["deltaswarm_orchestrator.processes.detached", "zenoh", "msgpack", MODULES[AGENT], child.__name__]
"""Imported once by the fork server and shared by all agents, as is a shipped controller."""

END_WITHIN_S = 5.0
PYTHON_S = 8.0
"""Time that a process may take to import its modules, on top of its start timeout [s]."""

FROZEN_LEASE_MS = 24 * 3600 * 1000


class LaunchError(Exception):
    """A required part did not start, or ended too early."""


class StoppedError(Exception):
    """The user asked to stop before the run had begun."""


class Swarm:
    """World, operator, station pages and agents of one run, as a context manager that leaves no process behind."""

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        folder: Path,
        zenoh: Sequence[tuple[str, str]] = (),
        boards: Sequence[int] = (),
        stopped: Callable[[], object] = lambda: None,
        checkpoint_steps: int = 0,
        resumed: Resumed | None = None,
        station: Station | None = None,
    ) -> None:
        self.parts: list[Part] = []
        self.endpoint = ""
        """Endpoint at which the parts on this machine connect."""
        self.endpoints: list[str] = []
        """All endpoints on which the router listens."""
        self._boards = boards
        self._stopped = stopped
        self._scenario = scenario
        self._run = run
        self._folder = folder
        self._zenoh = (*_patience(scenario), *zenoh)
        self._checkpoint_steps, self._resumed = checkpoint_steps, resumed
        self._station = station
        self._pages: set[Station] = set()
        self._restarts = Counter(resumed.restarts if resumed else {})
        self._context = multiprocessing.get_context("forkserver")
        self._lifeline, self._kept_end = multiprocessing.Pipe(duplex=False)
        (folder / "logs").mkdir(parents=True, exist_ok=True)
        self._passwords = Passwords(folder)

    def __enter__(self) -> Self:
        if problem := fork_server_problem():
            raise LaunchError(problem)
        adopt_orphans(do_so=True)  # without it, the exit codes of all parts would be lost with the fork server
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self.end(at_once=kind is KeyboardInterrupt)
        finally:
            adopt_orphans(do_so=False)

    def start_world(
        self,
        scenario_file: Path,
        *,
        listen: str,
        record: bool = False,
        wire: bool = False,
        for_boards: str = "",
        tls: Tls | None = None,
    ) -> None:
        """Start the world and wait until its router listens at `listen`, and at `for_boards` if given.

        Raises:
            LaunchError: the world ended (the text has its last log lines) or was not up in time.
            StoppedError: the user asked to stop.
        """
        argv = ["--scenario", str(scenario_file), "--credentials", str(self._passwords.file), "--listen", listen]
        argv += ["--out", str(self._folder), "--run", self._run, "--expect", OPERATOR, "--expect", RECORDER]
        argv += ["--listen", for_boards] if for_boards else []
        argv += ["--ca", tls.ca, "--certificate", tls.certificate, "--key", tls.key] if tls else []
        argv += [f"--boards={','.join(map(str, self._boards))}"] if self._boards else []
        argv += self._told_of_checkpoints()
        argv += ["--resume", str(self._resumed.step)] if self._resumed else []
        flags = {"--station": self._station, "--truth": record, "--wire": wire}
        argv += [flag for flag, is_set in flags.items() if is_set]
        self.endpoints = self._start_and_hear(WORLD, 0, [*argv, *self._overrides()]).split()
        self.endpoint = self.endpoints[0]
        self._passwords.take()

    def _start_and_hear(
        self, role: str, number: int, argv: list[str], *, password: str = "", channel: socket.socket | None = None
    ) -> str:
        """Start a part that prints where it listens; return that first line. Raises the same as `start_world`."""
        reader, writer = multiprocessing.Pipe(duplex=False)
        part = self._start(role, number, argv, password=password, stdout=writer, channel=channel)
        writer.close()
        with reader:
            line = self._line_of(part, reader).strip()
        if not line:
            wait_for([part], END_WITHIN_S)
            raise LaunchError(f"the {role} did not start:\n{part.log_tail()}")
        return line

    def _line_of(self, part: Part, reader: Connection) -> str:
        """Return the first line that a part prints, or what it had printed of it when it ended."""
        text = b""
        deadline = time.monotonic() + self._scenario.run.start_timeout_s + PYTHON_S
        while not text.endswith(b"\n"):
            if self._stopped():
                raise StoppedError
            if time.monotonic() > deadline:
                raise LaunchError(f"{part.name} was not ready within {self._scenario.run.start_timeout_s:g} s")
            if wait([reader], 0.1):
                if not (more := os.read(reader.fileno(), 4096)):
                    break
                text += more
        return text.decode()

    def start_operator(self, *, publish_all: bool, go_on: bool = False) -> None:
        """Start the operator; with `go_on`, continue where a killed operator stopped."""
        scenario = self._scenario
        argv = ["--threshold-hz", str(scenario.operator.threshold_hz), "--step-s", str(scenario.run.step_s)]
        argv += ["--out", str(self._folder), *(["--publish-all"] if publish_all else [])]
        argv += self._told_of_checkpoints()
        argv += ["--go-on"] if go_on or self._resumed else []
        if self._station or scenario.has_console:
            argv += ["--briefing", str(write_briefing(self._folder, scenario, self._station))]
        channel = self._station.operators_end if self._station else None
        argv = ["--low-latency", *argv, *self._joining()]
        self._start(OPERATOR, 0, argv, password=self.password(OPERATOR), channel=channel)

    @property
    def has_station(self) -> bool:
        """Whether a person may watch and command."""
        return self._station is not None

    def start_station(self, station: Station | None = None, number: int = 0) -> str:
        """Start or restart the process of a page; return the page's URL.

        Args:
            station: the page; default: the operator's station.
            number: number of the page's process; 0 is the operator's station.

        Raises:
            LaunchError: the process did not start; the text has its last log lines.
            StoppedError: the user asked to stop.
        """
        station = station or self._station
        assert station is not None
        self._pages.add(station)
        argv = ["--listen", station.listen]
        url = self._start_and_hear(STATION, number, argv, password=station.token, channel=station.stations_end)
        station.listen = urlsplit(url).netloc  # a restarted station keeps its address
        return url

    def give_up_station(self) -> None:
        """Close the station's end of the channel, so that the operator notices and no pause lasts forever."""
        if self._station is not None:
            self._station.stations_end.close()

    def start_agents(self, agents: Iterable[int] | None = None) -> None:
        """Start all agents that do not run on boards, or only `agents`; each gets its own id, password and log.

        In a resumed run, "all" means the agents of the checkpoint, each in its saved state.
        """
        resumed = self._resumed if agents is None else None
        everyone = resumed.agents if resumed else range(self._scenario.agents.count)
        for agent in (agent for agent in everyone if agent not in self._boards) if agents is None else agents:
            settings = self._folder / "agents" / f"{agent}.toml"  # written by the world
            argv = ["--id", str(agent), "--settings", str(settings), "--low-latency", *self._joining()]
            argv += ["--restart", str(self._restarts[agent])] if self._restarts[agent] else []
            argv += ["--checkpoints", str(self._folder / checkpoint.FOLDER)] if self._checkpoint_steps else []
            argv += ["--resume", str(resumed.step)] if resumed else []
            self._start(AGENT, agent, argv, password=self.password(user_name(AGENT, agent)))

    def password(self, user: str) -> str:
        """Return a user's password; known once the world is up."""
        return self._passwords.of(user)

    def recorder_link(self) -> RouterLink:
        """Return the link by which the orchestrator itself connects."""
        return RouterLink(self.endpoint, RECORDER, self.password(RECORDER), overrides=self._zenoh)

    def _told_of_checkpoints(self) -> list[str]:
        return ["--checkpoint", str(self._checkpoint_steps)] if self._checkpoint_steps else []

    def _joining(self) -> list[str]:
        return ["--run", self._run, "--connect", self.endpoint, *self._overrides()]

    def _overrides(self) -> list[str]:
        return [f"--zenoh={key}={value}" for key, value in self._zenoh]

    def _start(
        self,
        role: str,
        number: int,
        argv: list[str],
        *,
        password: str = "",
        stdout: Connection | None = None,
        channel: socket.socket | None = None,
    ) -> Part:
        log_file = self._folder / "logs" / f"{role}-{number}.log"
        environment = {PASSWORD_VARIABLE: password} if password else {}
        process = self._context.Process(
            target=child.main,
            args=(MODULES[role], argv, environment, log_file, self._lifeline, stdout, role != WORLD, channel),
            name=f"deltaswarm-{role}-{number}",
            daemon=True,
        )
        with bare_main_module(), safe_path(), self._impatience():
            self._context.set_forkserver_preload([*PRELOADED, *self._shipped_controller()])
            try:
                process.start()
            except (OSError, EOFError, ValueError) as error:  # the fork server was killed
                raise LaunchError(f"{role} {number} cannot be started: the fork server ended ({error!r})") from None
        part = Part(role, number, process, log_file)
        self.parts.append(part)
        return part

    @contextmanager
    def _impatience(self) -> Iterator[None]:
        """Kill the fork server if a start takes too long: a stopped fork server would block the caller forever."""
        timer = threading.Timer(self._scenario.run.start_timeout_s + PYTHON_S, kill_fork_server)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _shipped_controller(self) -> list[str]:
        """Return the module of the scenario's controller if it is shipped; only agents load a user's controller."""
        target = CONTROLLERS.get(self._scenario.control.mode)
        return [target.partition(":")[0]] if target else []

    def write_pids(self) -> None:
        """Write `logs/pids.json`, which maps parts to process ids, for users who inspect or kill a process."""
        pids = {part.name: part.pid for part in self.parts}
        write_json(self._folder / "logs" / "pids.json", pids)

    def carry_out(self, order: ProcessOrder) -> None:
        """Start, kill, stop or continue agents' processes as the world orders; the world waits for it."""
        if order.action == START:  # an agent that was dead when the run was resumed has no process here
            self._restarts.update(order.agents)
            self.start_agents(order.agents)
            self.write_pids()
            return
        newest = {part.number: part for part in self.parts if part.role == AGENT}
        parts = [newest[agent] for agent in order.agents]
        if order.action == KILL:
            for part in parts:
                part.ends_as_planned |= part.exit_code is None
                part.send(signal.SIGKILL)
            wait_for(parts, END_WITHIN_S)
        else:
            for part in parts:
                part.is_stopped = order.action == STOP
                part.send(signal.SIGSTOP if part.is_stopped else signal.SIGCONT)

    def ended(self) -> list[Part]:
        """Return the parts whose process has ended."""
        return [part for part in self.parts if part.exit_code is not None]

    def part(self, role: str) -> Part:
        """Return the newest part of a role."""
        return next(part for part in reversed(self.parts) if part.role == role)

    @property
    def station_part(self) -> Part:
        """The newest process of the page for the person who watches and commands."""
        return next(part for part in reversed(self.parts) if (part.role, part.number) == (STATION, 0))

    def stop_world(self) -> None:
        """Ask the world to end the run with the current step."""
        self.part(WORLD).send(signal.SIGTERM)

    def join(self, within_s: float) -> list[Part]:
        """Wait until all parts have ended, at most `within_s` [s]; return those that have not."""
        return wait_for(self.parts, within_s)

    def end(self, *, at_once: bool = False) -> None:
        """End all parts that still run: by SIGTERM, then by SIGKILL; with `at_once`, by SIGKILL alone."""
        for part in self.parts:
            if part.is_stopped:
                part.ends_as_planned = True
                part.send(signal.SIGKILL)  # a stopped process cannot act on SIGTERM
        try:
            if not at_once:
                for part in self.join(0):
                    part.send(signal.SIGTERM)
                    part.send(signal.SIGCONT)  # wakes a process that the user has stopped
                self.join(END_WITHIN_S / 2)
        finally:  # a second signal may end the wait
            for part in self.join(0):
                part.send(signal.SIGKILL)
            self.join(END_WITHIN_S)
            if any(part.exit_code == UNKNOWN for part in self.parts):
                kill_fork_server()  # it no longer answers; it, or a caller waiting for it, would be left behind
            ours: list[Part | Station | Connection] = [*self.parts, *self._pages, self._kept_end, self._lifeline]
            for each in ours:
                each.close()
            self._passwords.remove_file()


def _patience(scenario: Scenario) -> list[tuple[str, str]]:
    """Return Zenoh settings that keep the link of an agent frozen by a fault: it may be silent for a long wall time."""
    frozen = any(fault.kind == FREEZE for fault in scenario.fault)
    return [("transport/link/tx/lease", str(FROZEN_LEASE_MS))] if frozen else []
