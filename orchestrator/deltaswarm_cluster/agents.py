"""The agents of a run on other machines, as the orchestrator sees them: parts that start, end and leave logs."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from deltaswarm_cluster import host as news
from deltaswarm_cluster.host import Job
from deltaswarm_cluster.plan import WorkerLostError, spans
from deltaswarm_orchestrator.processes.certificates import LOCAL_HOSTS, Authority, pem_of
from deltaswarm_orchestrator.processes.elsewhere import SCHEDULER, WORKER
from deltaswarm_orchestrator.processes.process import UNKNOWN, RunPart
from deltaswarm_orchestrator.processes.starter import BEFORE_READY, END_WITHIN_S, LaunchError, StoppedError
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.access import user_name
from deltaswarm_wire.files import write_secret
from deltaswarm_wire.keys import AGENT, WORLD
from deltaswarm_wire.session import Tls, host_and_port

if TYPE_CHECKING:
    from deltaswarm_cluster.dask_cluster import DaskCluster, DaskHost

CERTIFICATE_DAYS = 365
"""The links are cut when certificates expire, so they outlast any run."""

POLL_S = 0.05
DOUBT_S = 1.0
"""Time after which a host that seems lost counts as lost [s]; meanwhile the scheduler may prove to be lost."""

STOP_WITHIN_S = END_WITHIN_S + 5.0
"""Maximum wait for all hosts to have ended their agents [s]."""


@dataclass(frozen=True)
class DaskPlacement:
    cluster: "DaskCluster"
    blocks: "Mapping[DaskHost, Sequence[int]]"
    """The agents of each host."""
    listen: str
    """Where the world listens for them."""

    @property
    def workers(self) -> dict[str, list[int]]:
        return {str(host.worker): [*block] for host, block in self.blocks.items()}

    def check_controller(self, mode: str) -> None:
        self.cluster.check_controller(mode)

    def agents(self, scenario: Scenario, logs: Path) -> "RemoteAgents":
        return RemoteAgents(scenario, self, logs)


class RemotePart(RunPart):
    """An agent on another machine, the worker there, or the scheduler that leads to all workers."""

    exit_code: int | None = None
    lost = ""
    """With whom it was lost, to follow "was lost" in a sentence; empty if it was not."""

    def how_it_ended(self, when: str = "") -> str:
        return f"{self.name} was lost{when and f' {when}'}{self.lost}" if self.lost else super().how_it_ended(when)

    def lose(self, lost: str) -> None:
        self.exit_code, self.lost = UNKNOWN, lost


def _machine(role: str, number: int, name: str) -> RemotePart:
    part = RemotePart(role, number, Path())  # its log is on its own machine
    part.name = name
    return part


class RemoteAgents:
    """All agents of a run at their places; their logs come into the folder `logs`.

    Their certificates are made for this run and are worth nothing after it. The authority's key is never written. World
    and agents trust this authority alone.
    """

    def __init__(self, scenario: Scenario, placement: DaskPlacement, logs: Path) -> None:
        self.listen = placement.listen
        """The endpoint at which the world listens for them."""
        self._cluster, self._blocks = placement.cluster, placement.blocks
        self._scenario, self._logs = scenario, logs
        self._authority = Authority.create(CERTIFICATE_DAYS)
        self._scheduler = _machine(SCHEDULER, 0, "the Dask scheduler")
        self._machines = {
            host: _machine(WORKER, number, f"the Dask worker {host.worker}") for number, host in enumerate(self._blocks)
        }
        numbers = [agent for block in self._blocks.values() for agent in block]
        self._agents = {agent: RemotePart(AGENT, agent, self._log(agent)) for agent in numbers}
        self._live: set[DaskHost] = set()
        """Hosts whose agents have not all ended."""
        self._up: set[DaskHost] = set()
        """Hosts that have begun to start their agents."""
        self._missed_at: dict[DaskHost, float] = {}
        """Since when a host has seemed lost."""

    def _log(self, agent: int) -> Path:
        return self._logs / f"{AGENT}-{agent}.log"

    @property
    def parts(self) -> list[RunPart]:
        return [self._scheduler, *self._machines.values(), *self._agents.values()]

    @property
    def agents(self) -> list[RunPart]:
        return [*self._agents.values()]

    def write_worlds(self, folder: Path) -> Tls:
        hosts = tuple(dict.fromkeys((*LOCAL_HOSTS, host_and_port(self.listen)[0])))
        key, certificate = pem_of(*self._authority.sign(WORLD, CERTIFICATE_DAYS, hosts))
        contents = {"ca.pem": self._ca, f"{WORLD}.pem": certificate, f"{WORLD}.key": key}
        for name, content in contents.items():
            write_secret(folder / name, content)
        return Tls(*(str(folder / name) for name in contents))

    @property
    def _ca(self) -> bytes:
        return pem_of(self._authority.key, self._authority.certificate)[1]

    def start(self, run: str, endpoint: str, zenoh: Sequence[str], was_stopped: Callable[[], object]) -> None:
        """Start all agents, each with its own certificate, at the world's endpoint."""
        scenario = self._scenario
        options = {"--run": run, "--connect": endpoint, "--zenoh": list(zenoh)}
        within_s = scenario.run.start_timeout_s
        for host, block in self._blocks.items():
            files = [self._files_of(agent) for agent in block]
            host.start(Job(scenario.control.mode, within_s, options, self._ca.decode(), files))
            self._live.add(host)
        deadline = time.monotonic() + within_s
        while waiting := [host for host in self._blocks if host not in self._up]:
            if was_stopped():
                raise StoppedError
            if time.monotonic() > deadline:
                name = self._machines[waiting[0]].name
                raise LaunchError(
                    f"{name} did not start its agents within {within_s:g} s; is it busy with other tasks?"
                )
            time.sleep(POLL_S)
            self.look()
            for machine in (self._scheduler, *self._machines.values()):
                if machine.lost:
                    raise LaunchError(machine.how_it_ended(BEFORE_READY))

    def _files_of(self, agent: int) -> tuple[int, str, str, str]:
        key, certificate = pem_of(*self._authority.sign(user_name(AGENT, agent), CERTIFICATE_DAYS))
        settings = tomli_w.dumps(checked.plain(self._scenario.for_agent(agent)))
        return agent, settings, certificate.decode(), key.decode()

    def look(self) -> None:
        if self._live and (problem := self._cluster.problem):
            self._scheduler.lose(f" with all agents: {problem}")
            for host in [*self._live]:
                self._lose(host, "")
        for host in [*self._live]:
            try:
                items = host.poll()
            except WorkerLostError as error:
                now = time.monotonic()
                if now - self._missed_at.setdefault(host, now) >= DOUBT_S:
                    self._lose(host, str(error))
            else:
                self._missed_at.pop(host, None)
                for item in items:
                    self._take(host, *item)

    def _take(self, host: "DaskHost", kind: str, *items: Any) -> None:
        if kind == news.UP:
            self._up.add(host)
        elif kind == news.LOG:
            agent, text = items
            with self._log(agent).open("ab") as file:
                file.write(text.encode(errors="surrogateescape"))
        elif kind == news.ENDED:
            agent, code, outlasted = items
            self._agents[agent].exit_code, self._agents[agent].outlasted = code, outlasted
        elif kind == news.FAILED:
            self._lose(host, *items)
        else:
            self._live.discard(host)

    def _lose(self, host: "DaskHost", why: str) -> None:
        """Note that a host is lost with the agents that had not ended; its machine's line names them."""
        self._live.discard(host)
        machine = self._machines[host]
        lost = [agent for agent in self._blocks[host] if self._agents[agent].exit_code is None]
        for agent in lost:
            self._agents[agent].lose(f" with {(self._scheduler if self._scheduler.lost else machine).name}")
            self._agents[agent].ends_as_planned = True
        if not self._scheduler.lost and lost:
            machine.lose(f" with {spans(lost)}{why and f': {why}'}")

    def end(self, *, at_once: bool = False) -> None:
        try:
            if not at_once:
                self._stop()
        finally:
            for host in self._blocks:
                host.close()

    def _stop(self) -> None:
        self.look()
        self._live &= self._up  # nobody waits for a busy worker
        for host in [*self._live]:
            try:
                host.stop()
            except WorkerLostError:
                self._lose(host, "")
        deadline = time.monotonic() + STOP_WITHIN_S
        while self._live and time.monotonic() < deadline:
            time.sleep(POLL_S)
            self.look()
