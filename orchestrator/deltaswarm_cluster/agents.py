"""The agents of a run on other machines, as the orchestrator sees them: parts that start, end and leave logs."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import tomli_w

from deltaswarm_cluster.actor import AgentFiles, AgentsJob, Update, WorkerLostError
from deltaswarm_cluster.plan import Worker, spans
from deltaswarm_orchestrator.processes.certificates import LOCAL_HOSTS, Authority, check_host, pem_of
from deltaswarm_orchestrator.processes.elsewhere import SCHEDULER, WORKER
from deltaswarm_orchestrator.processes.process import UNKNOWN, RunPart
from deltaswarm_orchestrator.processes.starter import END_WITHIN_S, LaunchError, StoppedError
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.access import user_name
from deltaswarm_wire.files import write_secret
from deltaswarm_wire.keys import AGENT, WORLD
from deltaswarm_wire.session import Tls

CERTIFICATE_DAYS = 365
"""The links are cut when certificates expire, so they outlast any run."""

POLL_S = 0.05
DOUBT_S = 1.0
"""Time after which a supervisor that seems lost counts as lost [s]; meanwhile the scheduler may prove to be lost."""

STOP_WITHIN_S = END_WITHIN_S + 5.0
"""Maximum wait for all supervisors to have ended their agents [s]."""


@dataclass(frozen=True, repr=False)
class Credentials:
    """The certificates of one run, which are made for it and are worth nothing after it.

    The authority's key is never written. World and agents trust this authority alone.
    """

    authority: Authority
    host: str
    """The name or address by which agents know the world's machine."""

    @classmethod
    def create(cls, host: str) -> "Credentials":
        """Create the authority of a run.

        Raises:
            ValueError: the host is not a name or address.
        """
        check_host(host)
        return cls(Authority.create(CERTIFICATE_DAYS), host)

    @property
    def ca(self) -> bytes:
        """The authority's certificate (PEM)."""
        return pem_of(self.authority.key, self.authority.certificate)[1]

    def of_agents(self, agents: Iterable[int]) -> dict[int, tuple[bytes, bytes]]:
        """Make private key and certificate (PEM) of each agent."""
        return {agent: pem_of(*self.authority.sign(user_name(AGENT, agent), CERTIFICATE_DAYS)) for agent in agents}

    def write_worlds(self, folder: Path) -> Tls:
        """Write the world's files into a private folder, from which they can go once the router has read them.

        Raises:
            OSError: the folder cannot be written.
        """
        hosts = tuple(dict.fromkeys((*LOCAL_HOSTS, self.host)))
        key, certificate = pem_of(*self.authority.sign(WORLD, CERTIFICATE_DAYS, hosts))
        ca = folder / "ca.pem"
        files = {ca: self.ca, folder / f"{WORLD}.pem": certificate, folder / f"{WORLD}.key": key}
        for file, content in files.items():
            write_secret(file, content)
        return Tls(*map(str, files))


class Supervisor(Protocol):
    """One worker, which supervisors agents."""

    worker: Worker

    def start(self, job: AgentsJob) -> None:
        """Begin to start the agents of a job."""

    def is_started(self) -> bool:
        """Whether the supervisor has the job.

        Raises:
            WorkerLostError: the supervisor did not take it.
        """

    def poll(self) -> Update | None:
        """Return what has happened, or None if nothing new has arrived.

        Raises:
            WorkerLostError: the supervisor is lost.
        """

    def stop(self) -> None:
        """Ask the supervisor to end its agents.

        Raises:
            WorkerLostError: the supervisor is lost.
        """

    def close(self) -> None:
        """Release the supervisor, which then ends what it still runs and removes the agents' files."""


class Cluster(Protocol):
    """The machines on which agents can run."""

    @property
    def problem(self) -> str:
        """Why the whole cluster is lost, or "" while it is not."""

    def check_controller(self, mode: str) -> None:
        """Check that all workers have a controller's files as this machine has them. Raises InputsChangedError."""


@dataclass(frozen=True)
class DaskPlacement:
    """The supervisors of a run's agents."""

    cluster: Cluster
    blocks: Mapping[Supervisor, Sequence[int]]
    """The agents of each supervisor."""
    listen: str
    """Where the world listens for them."""
    credentials: Credentials

    @property
    def workers(self) -> dict[str, list[int]]:
        """The agents of each worker, as the manifest lists them."""
        return {str(supervisor.worker): [*block] for supervisor, block in self.blocks.items()}

    def check_controller(self, mode: str) -> None:
        """Check that all workers have the controller's files as this machine has them. Raises InputsChangedError."""
        self.cluster.check_controller(mode)

    def agents(self, scenario: Scenario, logs: Path) -> "RemoteAgents":
        """Return the agents at their places, not started yet; their logs come into the folder `logs`."""
        return RemoteAgents(scenario, self, logs)


class RemoteAgent(RunPart):
    """An agent's process on another machine."""

    def __init__(self, number: int, log_file: Path) -> None:
        super().__init__(AGENT, number, log_file)
        self.code: int | None = None
        self.lost_with = ""
        """The machine that it was lost with."""

    @property
    def exit_code(self) -> int | None:
        """The exit code: None while the agent runs, UNKNOWN if its worker is lost."""
        return self.code

    def how_it_ended(self, when: str = "") -> str:
        """Describe in one line how it ended."""
        if self.lost_with:
            return f"{self.name} was lost{when and f' {when}'} with {self.lost_with}"
        return super().how_it_ended(when)


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

    def __init__(self, scenario: Scenario, placement: DaskPlacement, logs: Path) -> None:
        self.placement = placement
        self._scenario, self._logs = scenario, logs
        self._scheduler = Machine(SCHEDULER, 0, "the Dask scheduler")
        numbers = [agent for block in placement.blocks.values() for agent in block]
        self._agents = {agent: RemoteAgent(agent, self._log(agent)) for agent in numbers}
        self._machines = {
            supervisor: Machine(WORKER, number, f"the Dask worker {supervisor.worker}")
            for number, supervisor in enumerate(placement.blocks)
        }
        self._live: set[Supervisor] = set()
        """Supervisors that have started their agents, which have not all ended."""
        self._missed_at: dict[Supervisor, float] = {}
        """Since when a supervisor has seemed lost."""

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
            LaunchError: a supervisor was lost, or did not take its agents in time.
            StoppedError: the user asked to stop.
        """
        scenario = self._scenario
        for supervisor, block in self.placement.blocks.items():
            secrets = self.placement.credentials.of_agents(block)
            agents = {
                agent: AgentFiles(tomli_w.dumps(checked.plain(scenario.for_agent(agent))), certificate, key)
                for agent, (key, certificate) in secrets.items()
            }
            timeout_s = scenario.run.start_timeout_s
            ca = self.placement.credentials.ca
            supervisor.start(AgentsJob(run, endpoint, scenario.control.mode, timeout_s, ca, agents, tuple(zenoh)))
        deadline = time.monotonic() + scenario.run.start_timeout_s
        while waiting := [supervisor for supervisor in self.placement.blocks if supervisor not in self._live]:
            if was_stopped():
                raise StoppedError
            if time.monotonic() > deadline:
                raise LaunchError(
                    f"the Dask worker {waiting[0].worker} did not start its agents within "
                    f"{scenario.run.start_timeout_s:g} s; is it busy with other tasks?"
                )
            time.sleep(POLL_S)
            self._live.update([supervisor for supervisor in waiting if self._is_started(supervisor)])

    def _is_started(self, supervisor: Supervisor) -> bool:
        try:
            return supervisor.is_started()
        except WorkerLostError as error:
            if problem := self.placement.cluster.problem:
                raise LaunchError(f"the Dask scheduler was lost before all agents had started: {problem}") from None
            raise LaunchError(f"the Dask worker {supervisor.worker} could not start its agents: {error}") from None

    def look(self) -> None:
        """Take the updates of all supervisors: ends, logs, and supervisors that are lost."""
        if self._live and (problem := self.placement.cluster.problem):
            self._scheduler.problem = f" with all agents: {problem}"
            for supervisor in list(self._live):
                self._lose(supervisor, "")
            return
        for supervisor in list(self._live):
            try:
                update = supervisor.poll()
            except WorkerLostError as error:
                now = time.monotonic()
                if now - self._missed_at.setdefault(supervisor, now) >= DOUBT_S:
                    self._lose(supervisor, f": {error}" if str(error) else "")
                continue
            self._missed_at.pop(supervisor, None)
            if update is not None:
                self._take(supervisor, update)

    def _take(self, supervisor: Supervisor, update: Update) -> None:
        for agent, text in update.logs.items():
            with self._log(agent).open("ab") as file:
                file.write(text)
        for agent, end in update.ended.items():
            self._agents[agent].code, self._agents[agent].outlasted = end
        if update.failed:
            self._lose(supervisor, f": {update.failed}")
        elif update.is_over:
            self._live.discard(supervisor)

    def _lose(self, supervisor: Supervisor, why: str) -> None:
        """Note that a supervisor is lost with the agents that had not ended; its own line names them."""
        self._live.discard(supervisor)
        machine = self._machines[supervisor]
        lost = [agent for agent in self.placement.blocks[supervisor] if self._agents[agent].code is None]
        for agent in lost:
            self._agents[agent].code, self._agents[agent].ends_as_planned = UNKNOWN, True
            self._agents[agent].lost_with = (self._scheduler if self._scheduler.problem else machine).name
        if not self._scheduler.problem and lost:
            machine.problem = f" with {spans(lost)}{why}"

    def end(self, *, at_once: bool = False) -> None:
        """End all agents and take their last words; with `at_once`, without waiting for these."""
        try:
            if not at_once:
                self._stop()
        finally:
            for supervisor in self.placement.blocks:
                supervisor.close()

    def _stop(self) -> None:
        self.look()
        for supervisor in list(self._live):
            try:
                supervisor.stop()
            except WorkerLostError:
                self._lose(supervisor, "")
        deadline = time.monotonic() + STOP_WITHIN_S
        while self._live and time.monotonic() < deadline:
            time.sleep(POLL_S)
            self.look()
