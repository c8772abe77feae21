"""What is decided about a run over many machines before anything starts: who runs where, and what is refused."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.processes.boards import is_any
from deltaswarm_wire.access import TLS
from deltaswarm_wire.session import endpoint_problem, host_and_port, protocol_of

MAX_NAMED = 5
"""Maximum number of workers named in an error."""

NOTHING = "nothing"


class Worker(NamedTuple):
    """A worker of the cluster; two may have the same name, none the same address."""

    name: str
    address: str

    def __str__(self) -> str:
        return self.address if self.name == self.address else f"{self.name} at {self.address}"


class Installed(NamedTuple):
    """What is installed on a machine; a worker must have the same as this one. NOTHING: not installed."""

    deltaswarm: str
    python: str
    """Python's version up to the minor number, such as 3.11."""
    zenoh: str = NOTHING
    code: str = NOTHING
    """Digest of all sources of deltaswarm, which tells different code of one version number apart."""

    def __str__(self) -> str:
        deltaswarm = "no deltaswarm" if self.deltaswarm == NOTHING else f"deltaswarm {self.deltaswarm}"
        code = "" if self.code == NOTHING else f" (code {self.code})"
        zenoh = "" if self.zenoh == NOTHING else f", eclipse-zenoh {self.zenoh}"
        return f"{deltaswarm}{code}, Python {self.python}{zenoh}"


class ClusterError(CommandError):
    """The cluster cannot do this run; nothing has been started or written."""


class WorkerLostError(Exception):
    """A worker no longer answers; the text says why, if that is known."""


def listen_problem(endpoint: str) -> str:
    """Say what an endpoint for agents on other machines must be, or "" if it is well."""
    if protocol_of(endpoint) != TLS:
        return f"must begin with {TLS}/: each agent on another machine has a certificate"
    if problem := endpoint_problem(endpoint, connects=True):
        return problem
    if is_any(host_and_port(endpoint)[0]):
        return "must be this machine's address, at which the workers reach it"
    return ""


def in_order(workers: Iterable[Worker]) -> list[Worker]:
    """Sort workers by name, numbers within names by value, and then by address."""
    return sorted(workers, key=lambda worker: (_parts(worker.name), _parts(worker.address)))


def _parts(text: str) -> list[tuple[int, int, str]]:
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", text) if part]


def divide(agents: Sequence[int], workers: Sequence[Worker]) -> dict[Worker, tuple[int, ...]]:
    """Give each worker a block of agents, in order; blocks differ by at most one agent, and the first are the larger.

    Workers beyond the number of agents get none and are left out.
    """
    size, rest = divmod(len(agents), len(workers))
    blocks, first = {}, 0
    for index, worker in enumerate(workers):
        last = first + size + (index < rest)
        if first < last:
            blocks[worker] = tuple(agents[first:last])
        first = last
    return blocks


def spans(agents: Sequence[int]) -> str:
    """Format ascending numbers: `agents 0-4, 7`, or `agent 7`."""
    runs: list[list[int]] = []
    for agent in agents:
        if runs and runs[-1][1] == agent - 1:
            runs[-1][1] = agent
        else:
            runs.append([agent, agent])
    shown = ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)
    return f"agent{'' if len(agents) == 1 else 's'} {shown}"


def check_installed(here: Installed, workers: Mapping[Worker, Installed]) -> None:
    """Check that all workers, and the scheduler, have what this machine has. Raises ClusterError."""
    if other := {worker: has for worker, has in workers.items() if has != here}:
        lines = [f"    {worker} has {has}" for worker, has in other.items()]
        raise ClusterError(
            f"the Dask cluster must have what this machine has: {here}\n"
            f"{_some(lines)}\n"
            f"    install the same there, for Python {here.python} and from the same sources, and start it again"
        )


def check_reached(endpoint: str, problems: Mapping[Worker, str]) -> None:
    """Check that all workers can connect to where the world will listen; `problems` says why one cannot, if so."""
    if failed := {worker: problem for worker, problem in problems.items() if problem}:
        host, _ = host_and_port(endpoint)
        lines = [f"    {worker}: {problem}" for worker, problem in failed.items()]
        raise ClusterError(
            f"all Dask workers must reach this machine at {host}, where the world will listen\n"
            f"{_some(lines)}\n"
            f"    open the port in firewalls, or give an address and port that they reach: --listen {TLS}/ADDRESS:PORT"
        )


def _some(lines: Sequence[str]) -> str:
    more = len(lines) - MAX_NAMED
    return "\n".join([*lines[:MAX_NAMED], *([f"    and {more} more"] if more > 0 else [])])
