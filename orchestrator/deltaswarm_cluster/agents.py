"""The agents of a run on other machines, as the orchestrator sees them: parts that start, end and leave logs."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import tomli_w

from deltaswarm_cluster.credentials import Credentials
from deltaswarm_cluster.host_job import AgentFiles, HostJob, HostLostError, News
from deltaswarm_cluster.plan import Worker, spans
from deltaswarm_orchestrator.processes.elsewhere import SCHEDULER, WORKER
from deltaswarm_orchestrator.processes.process import UNKNOWN, RunPart
from deltaswarm_orchestrator.processes.starter import END_WITHIN_S, LaunchError, StoppedError
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.keys import AGENT
from deltaswarm_wire.session import Tls

POLL_S = 0.05
DOUBT_S = 1.0
"""Time for which a host must have seemed lost to count as lost [s]: until then the scheduler may prove to be lost."""

STOP_WITHIN_S = END_WITHIN_S + 5.0
"""Maximum wait for all hosts to have ended their agents [s]."""


class Host(Protocol):
    """One worker, which hosts agents."""

    worker: Worker

    def start(self, job: HostJob) -> None:
        """Begin to start the agents of a job."""

    def is_started(self) -> bool:
        """Whether the host has the job.

        Raises:
            HostLostError: the host did not take it.
        """

    def news(self) -> News | None:
        """Return what has happened, or None if nothing new has arrived.

        Raises:
            HostLostError: the host is lost.
        """

    def stop(self) -> None:
        """Ask the host to end its agents.

        Raises:
            HostLostError: the host is lost.
        """

    def close(self) -> None:
        """Let go of the host, which then ends what it still runs and removes the agents' files."""


class Cluster(Protocol):
    """The machines on which agents can run."""

    @property
    def problem(self) -> str:
        """Why the whole cluster is lost, or "" while it is not."""


@dataclass(frozen=True)
class Placement:
    """The hosts of a run's agents."""

    cluster: Cluster
    blocks: Mapping[Host, Sequence[int]]
    """The agents of each host."""
    listen: str
    """Where the world listens for them."""
    credentials: Credentials

    @property
    def workers(self) -> dict[str, list[int]]:
        """The agents of each worker, as the manifest lists them."""
        return {str(host.worker): [*block] for host, block in self.blocks.items()}

    def agents(self, scenario: Scenario, logs: Path) -> "RemoteAgents":
        """Return the agents at their places, not started yet; their logs come into the folder `logs`."""
        return RemoteAgents(scenario, self, logs)


class RemoteAgent(RunPart):
    """An agent's process on another machine."""

    def __init__(self, number: int, log_file: Path) -> None:
        super().__init__(AGENT, number, log_file)
        self.code: int | None = None

    @property
    def exit_code(self) -> int | None:
        """The exit code: None while the agent runs, UNKNOWN if its worker is lost."""
        return self.code


class Machine(RunPart):
    """A worker, or the scheduler that leads to all of them; it has no exit code but UNKNOWN, and no log here."""

    def __init__(self, role: str, number: int, name: str) -> None:
        super().__init__(role, number, Path())
        self.name = name
        self.problem = ""
        """What was lost with it, to follow "was lost" in a sentence; empty while it is well."""

    @property
    def exit_code(self) -> int | None:
        """UNKNOWN once it is lost."""
        return UNKNOWN if self.problem else None

    def how_it_ended(self, when: str = "") -> str:
        """Describe in one line what became of it."""
        return f"{self.name} was lost{when and f' {when}'}{self.problem}"

    def log_tail(self) -> str:
        """Return nothing: its log is on its own machine."""
        return ""


class RemoteAgents:
    """All agents of a run at their places; their logs come into the folder `logs`."""

    def __init__(self, scenario: Scenario, placement: Placement, logs: Path) -> None:
        self.placement = placement
        self._scenario, self._logs = scenario, logs
        self._scheduler = Machine(SCHEDULER, 0, "the Dask scheduler")
        numbers = [agent for block in placement.blocks.values() for agent in block]
        self._agents = {agent: RemoteAgent(agent, self._log(agent)) for agent in numbers}
        self._machines = {
            host: Machine(WORKER, number, f"the Dask worker {host.worker}")
            for number, host in enumerate(placement.blocks)
        }
        self._live: set[Host] = set()
        """Hosts that have started their agents, which have not all ended."""
        self._missed_at: dict[Host, float] = {}
        """Since when a host has seemed lost."""

    def _log(self, agent: int) -> Path:
        return self._logs / f"{AGENT}-{agent}.log"

    @property
    def listen(self) -> str:
        """The endpoint at which the world listens for them."""
        return self.placement.listen

    def write_worlds(self, folder: Path) -> Tls:
        """Write the world's certificate into a private folder.

        Raises:
            OSError: the folder cannot be written.
        """
        return self.placement.credentials.write_worlds(folder)

    @property
    def parts(self) -> list[RunPart]:
        """The machines and the agents, as of the last look."""
        return [self._scheduler, *self._machines.values(), *self._agents.values()]

    @property
    def agents(self) -> list[RunPart]:
        """The agents."""
        return [*self._agents.values()]

    def start(self, run: str, endpoint: str, zenoh: Sequence[str], was_stopped: Callable[[], object]) -> None:
        """Start all agents, each with its own certificate, at the world's endpoint.

        Raises:
            LaunchError: a host was lost, or did not take its agents in time.
            StoppedError: the user asked to stop.
        """
        scenario = self._scenario
        for host, block in self.placement.blocks.items():
            secrets = self.placement.credentials.of_agents(block)
            agents = {
                agent: AgentFiles(tomli_w.dumps(checked.plain(scenario.for_agent(agent))), certificate, key)
                for agent, (key, certificate) in secrets.items()
            }
            timeout_s = scenario.run.start_timeout_s
            ca = self.placement.credentials.ca
            host.start(HostJob(run, endpoint, scenario.control.mode, timeout_s, ca, agents, tuple(zenoh)))
        deadline = time.monotonic() + scenario.run.start_timeout_s
        while waiting := [host for host in self.placement.blocks if host not in self._live]:
            if was_stopped():
                raise StoppedError
            if time.monotonic() > deadline:
                raise LaunchError(
                    f"the Dask worker {waiting[0].worker} did not start its agents within "
                    f"{scenario.run.start_timeout_s:g} s; is it busy with other tasks?"
                )
            time.sleep(POLL_S)
            self._live.update([host for host in waiting if self._is_started(host)])

    def _is_started(self, host: Host) -> bool:
        try:
            return host.is_started()
        except HostLostError as error:
            if problem := self.placement.cluster.problem:
                raise LaunchError(f"the Dask scheduler was lost before all agents had started: {problem}") from None
            raise LaunchError(f"the Dask worker {host.worker} could not start its agents: {error}") from None

    def look(self) -> None:
        """Take the news of all hosts: ends, logs, and hosts that are lost."""
        if self._live and (problem := self.placement.cluster.problem):
            self._scheduler.problem = f" with all agents: {problem}"
            for host in list(self._live):
                self._lose(host, "")
            return
        for host in list(self._live):
            try:
                news = host.news()
            except HostLostError as error:
                now = time.monotonic()
                if now - self._missed_at.setdefault(host, now) >= DOUBT_S:
                    self._lose(host, f": {error}" if str(error) else "")
                continue
            self._missed_at.pop(host, None)
            if news is not None:
                self._take(host, news)

    def _take(self, host: Host, news: News) -> None:
        for agent, text in news.logs.items():
            with self._log(agent).open("ab") as file:
                file.write(text)
        for agent, code in news.ended.items():
            self._agents[agent].code = code
        if news.failed:
            self._lose(host, f": {news.failed}")
        elif news.is_over:
            self._live.discard(host)

    def _lose(self, host: Host, why: str) -> None:
        """Note that a host is lost with the agents that had not ended; its own line names them."""
        self._live.discard(host)
        lost = [agent for agent in self.placement.blocks[host] if self._agents[agent].code is None]
        for agent in lost:
            self._agents[agent].code, self._agents[agent].ends_as_planned = UNKNOWN, True
        if not self._scheduler.problem and lost:
            self._machines[host].problem = f" with {spans(lost)}{why}"

    def end(self, *, at_once: bool = False) -> None:
        """End all agents and take their last words; with `at_once`, without waiting for these."""
        try:
            if not at_once:
                self._stop()
        finally:
            for host in self.placement.blocks:
                host.close()

    def _stop(self) -> None:
        self.look()
        for host in list(self._live):
            try:
                host.stop()
            except HostLostError:
                self._lose(host, "")
        deadline = time.monotonic() + STOP_WITHIN_S
        while self._live and time.monotonic() < deadline:
            time.sleep(POLL_S)
            self.look()
