"""Check whether a machine has what runs need, and say how to get what is missing."""

import multiprocessing
import os
import platform
import socket
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from deltaswarm_orchestrator.base import limits
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_wire.extras import extras, install, needed

CONNECT_WITHIN_S = 5.0


@dataclass(frozen=True)
class CheckResult:
    """The result of one check; `advice` says what to do if it is not well."""

    name: str
    found: str
    is_well: bool
    advice: str = ""


def examine(agents: int) -> list[CheckResult]:
    packages = [_package(name, least) for name, least in needed().items()]
    cores = len(os.sched_getaffinity(0))
    problem = loopback_problem()
    loopback = f"127.0.0.1: {problem}" if problem else "127.0.0.1 listens and connects"
    has_fork_server = "forkserver" in multiprocessing.get_all_start_methods()
    fork_server = "available" if has_fork_server else "missing"
    return [
        CheckResult("Python", platform.python_version(), sys.version_info >= (3, 11), "Python 3.11 or newer is needed"),
        *packages,
        *map(_extra, extras()),
        CheckResult("cores", str(cores), cores >= 2, "a swarm runs on one core too, at about half the speed"),
        *(
            CheckResult(
                limit.name,
                f"{limit.shown} allowed, {limit.needed} needed for {agents} agents",
                limit.is_enough,
                limit.advice,
            )
            for limit in limits.limits(agents)
        ),
        CheckResult("loopback", loopback, problem is None, "ip link set lo up (as root)"),
        CheckResult("fork server", fork_server, has_fork_server, "Linux or another Unix is needed"),
    ]


def _extra(extra: str) -> CheckResult:
    """Tell whether an extra is installed, which not every installation needs."""
    lacking = [name for name, least in needed(extra).items() if not _package(name, least).is_well]
    found = f"not installed (without {', '.join(lacking)}): {install(extra)}" if lacking else "installed"
    return CheckResult(f"extra {extra}", found, True)


def _package(name: str, least: str) -> CheckResult:
    advice = f"python -m pip install '{name}>={least}'"
    try:
        installed = version(name)
    except PackageNotFoundError:
        return CheckResult(name, "not installed", False, advice)
    numbers, wanted = ([int(part) for part in text.split(".")[:3] if part.isdecimal()] for text in (installed, least))
    return CheckResult(name, installed, numbers >= wanted, advice)


def loopback_problem() -> str | None:
    """Say why 127.0.0.1 cannot be bound and connected to; None if it can. All parts of a run meet there."""
    try:
        with (
            socket.create_server(("127.0.0.1", 0)) as server,
            socket.create_connection(server.getsockname(), CONNECT_WITHIN_S),
        ):
            return None
    except OSError as error:
        return error.strerror or str(error)


def check_parts_can_start(agents: int, linked: int = 0) -> None:
    """Check that the parts of a run can start here and reach each other; `linked` agents run on other machines.

    Raises:
        CommandError: they cannot.
    """
    limits.make_room(agents, linked)
    if problem := loopback_problem():
        raise CommandError(
            f"the parts of a run meet at 127.0.0.1, which does not work here ({problem}); run `deltaswarm doctor`",
            FAILED,
        )
