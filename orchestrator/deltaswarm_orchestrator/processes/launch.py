"""The processes of one run: start all of them, and shut them down with no orphans."""

import shutil
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from deltaswarm_orchestrator.processes.boards import Boards
from deltaswarm_orchestrator.processes.elsewhere import AgentsElsewhere
from deltaswarm_orchestrator.processes.process import Part, RunPart, wait_for
from deltaswarm_orchestrator.processes.starter import END_WITHIN_S, LEASE, Starter, room_for
from deltaswarm_orchestrator.processes.station import STATION, StationChannel, write_briefing
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.results.run_tables import write_json
from deltaswarm_scenario.fault import FREEZE
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checkpoint
from deltaswarm_wire.access import user_name
from deltaswarm_wire.controller_metrics import declared
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER, WORLD
from deltaswarm_wire.orders import KILL, START, STOP, ProcessOrder
from deltaswarm_wire.session import RouterLink

SECRETS = "secrets"
"""The folder of the passwords in the run folder, until the router has read them, so that a kill leaves none behind."""

FROZEN_LEASE_MS = 24 * 3600 * 1000
"""An agent that a fault has frozen may be silent for a long wall time, and keeps its link."""


@dataclass(eq=False)
class Swarm:
    """World, operator, station pages and agents of one run, as a context manager that leaves no process behind."""

    scenario: Scenario
    run: str
    """The run's name on the network."""
    folder: Path
    """The run's folder, which holds `scenario.toml`."""
    zenoh: Sequence[tuple[str, str]] = ()
    boards: Boards | None = None
    remote: AgentsElsewhere | None = None
    """The agents, if they run on other machines."""
    was_stopped: Callable[[], object] = lambda: None
    """Returns something true once the user has asked to stop."""
    checkpoint_steps: int = 0
    resumed: Resumed | None = None
    station: StationChannel | None = None
    """The page of the person who watches and commands."""
    conductor: StationChannel | None = None
    """The page of the experiment's conductor, to which the operator mirrors the person's."""

    def __post_init__(self) -> None:
        self.endpoint = ""
        """Endpoint at which the parts on this machine connect."""
        self.endpoints: list[str] = []
        """All endpoints on which the router listens."""
        scenario, logs = self.scenario, self.folder / "logs"
        if any(fault.kind == FREEZE for fault in scenario.fault):
            self.zenoh = [(LEASE, str(FROZEN_LEASE_MS)), *self.zenoh]
        self.zenoh = [*room_for(scenario.agents.count), *self.zenoh]
        self._pages: set[StationChannel] = set()
        self._restarts = Counter(self.resumed.restarts if self.resumed else {})
        self._starter = Starter(logs, scenario.control.mode, scenario.run.start_timeout_s, self.was_stopped)
        self.parts = self._starter.parts
        logs.mkdir(parents=True, exist_ok=True)
        self._passwords: dict[str, str] = {}
        self._remove_secrets()
        (self.folder / SECRETS).mkdir(mode=0o700)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.end(at_once=kind is KeyboardInterrupt)

    def start_world(self, listen: str, *, record: bool = False, time_phases: bool = False) -> None:
        """Start the world and wait until its router listens at `listen`, and for boards if there are any.

        With `time_phases` it adds to `world.json` where the steps' wall time goes.
        """
        secrets, boards = self.folder / SECRETS, self.boards
        credentials, tls, elsewhere = secrets / "credentials", None, None
        if boards:
            tls, elsewhere = boards.tls, boards.listen
        elif self.remote:
            tls, elsewhere = self.remote.write_worlds(secrets), self.remote.listen
        options = {
            "--scenario": self.folder / "scenario.toml",
            "--credentials": credentials,
            "--listen": [listen, elsewhere],
            "--out": self.folder,
            "--run": self.run,
            "--expect": [OPERATOR, RECORDER],
            "--ca": tls.ca if tls else None,
            "--certificate": tls.certificate if tls else None,
            "--key": tls.key if tls else None,
            "--boards": ",".join(map(str, boards.agents)) if boards else None,
            "--checkpoint": self.checkpoint_steps,
            "--resume": self.resumed.step if self.resumed else None,
            "--station": self.station is not None,
            "--metric": [one.name for one in declared(self.scenario.control.mode)],
            "--truth": record,
            "--time-phases": time_phases,
            "--wire": record and self.scenario.record == "wire",
            "--zenoh": self._overrides,
        }
        self.endpoints = self._starter.start_and_read(WORLD, 0, options).split()
        self.endpoint = self.endpoints[0]
        pairs = (line.partition(":") for line in credentials.read_text(encoding="utf-8").splitlines())
        self._passwords = {user: password for user, _, password in pairs}
        self._remove_secrets()  # at once: an orchestrator that is killed could not do so later

    def start_operator(self, *, publish_all: bool, is_restart: bool = False) -> None:
        """Start the operator; a restarted one continues where the killed one stopped."""
        scenario, station = self.scenario, self.station
        has_briefing = station is not None or scenario.has_console
        options = {
            "--threshold-hz": scenario.operator.threshold_hz,
            "--step-s": scenario.run.step_s,
            "--out": self.folder,
            "--publish-all": publish_all,
            "--checkpoint": self.checkpoint_steps,
            "--go-on": is_restart or self.resumed is not None,
            "--markers": station.markers or None if station else None,
            "--briefing": write_briefing(self.folder, scenario, station) if has_briefing else None,
            **self._link_options,
        }
        ends = {"--channel-fd": station, "--conductor-fd": self.conductor}
        channels = {option: page.operators_end for option, page in ends.items() if page is not None}
        self._starter.start(OPERATOR, 0, options, password=self.password(OPERATOR), channels=channels)

    def start_station(self, station: StationChannel | None = None, number: int = 0) -> str:
        """Start or restart the process of a page, by default the operator's station (0); return the page's URL."""
        station = station or self.station
        assert station is not None
        self._pages.add(station)
        options = {"--listen": station.listen, "--watchers": number == 0}
        urls = self._starter.start_and_read(
            STATION, number, options, password=station.token, channels={"--channel-fd": station.stations_end}
        )
        url, station.watch_url = urls.split() if number == 0 else (urls, "")
        station.listen = f"{station.listen.rpartition(':')[0]}:{urlsplit(url).port}"  # a restarted one keeps it
        return url

    def follow(self, station: StationChannel, conductor: StationChannel | None) -> None:
        """Take channels to pages that are served elsewhere."""
        self.conductor = conductor
        self._pages |= {station} | ({conductor} if conductor else set())

    def give_up_station(self) -> None:
        """Close the station's end of the channel, so that the operator notices and no pause lasts forever."""
        if self.station is not None:
            self.station.stations_end.close()

    def start_agents(self, agents: Iterable[int] | None = None) -> None:
        """Start all agents that do not run on boards, or only `agents`; each gets its own id, password and log.

        In a resumed run, "all" means the agents of the checkpoint, each in its saved state.
        """
        if self.remote:
            self.remote.start(self.run, self.endpoints[-1], self._overrides, self.was_stopped)
            return
        resumed = self.resumed if agents is None else None
        if agents is None:
            everyone = resumed.agents if resumed else range(self.scenario.agents.count)
            agents = [agent for agent in everyone if self.boards is None or agent not in self.boards.agents]
        for agent in agents:
            options = {
                "--id": agent,
                "--settings": self.folder / "agents" / f"{agent}.toml",  # written by the world
                "--restart": self._restarts[agent],
                "--checkpoints": self.folder / checkpoint.FOLDER if self.checkpoint_steps else None,
                "--resume": resumed.step if resumed else None,
                **self._link_options,
            }
            self._starter.start(AGENT, agent, options, password=self.password(user_name(AGENT, agent)))

    def password(self, user: str) -> str:
        return self._passwords[user]

    def recorder_link(self) -> RouterLink:
        return RouterLink(self.endpoint, RECORDER, self.password(RECORDER), overrides=tuple(self.zenoh))

    @property
    def _link_options(self) -> dict[str, object]:
        return {"--low-latency": True, "--run": self.run, "--connect": self.endpoint, "--zenoh": self._overrides}

    @property
    def _overrides(self) -> list[str]:
        return [f"{key}={value}" for key, value in self.zenoh]

    def write_pids(self) -> None:
        """Write `logs/pids.json`, which maps parts to process ids, for users who inspect or kill a process."""
        write_json(self.folder / "logs" / "pids.json", {part.name: part.pid for part in self.parts})

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

    def ended(self) -> list[RunPart]:
        """Return the parts that have ended, in the order in which they did; then those on other machines."""
        if self.remote:
            self.remote.look()
        elsewhere = self.remote.parts if self.remote else ()
        return [*self._starter.ended(), *(part for part in elsewhere if part.exit_code is not None)]

    @property
    def agents(self) -> Sequence[RunPart]:
        """All processes of agents that this run has started, here or on other machines."""
        return self.remote.agents if self.remote else [part for part in self.parts if part.role == AGENT]

    def part(self, role: str, number: int = 0) -> Part:
        """Return the newest process of a part; station 0 is the operator's."""
        return next(part for part in reversed(self.parts) if (part.role, part.number) == (role, number))

    def stop_world(self) -> None:
        """Ask the world to end the run with the current step."""
        self.part(WORLD).send(signal.SIGTERM)

    def end(self, *, at_once: bool = False) -> None:
        """End all parts that still run: by SIGTERM, then by SIGKILL; with `at_once`, by SIGKILL alone."""
        for page in self._pages:
            page.operators_end.close()  # so that stations can tell a run that is over from an operator that restarts
        try:
            self._starter.end(at_once=at_once)
            if self.remote:
                self.remote.end(at_once=at_once)
        finally:
            for page in self._pages:
                page.close()
            self._remove_secrets()

    def _remove_secrets(self) -> None:
        shutil.rmtree(self.folder / SECRETS, ignore_errors=True)
