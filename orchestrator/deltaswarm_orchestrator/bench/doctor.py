"""What a machine needs for a swarm, what it has, and how to get what is missing."""

import json
import os
import platform
import resource
import socket
import sys
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version

from deltaswarm_orchestrator.exits import complain

NEEDED = {
    "cryptography": (42, 0),
    "eclipse-zenoh": (1, 10),
    "foxglove-schemas-protobuf": (0, 4),
    "mcap": (1, 6),
    "mcap-protobuf-support": (0, 6),
    "msgpack": (1, 0),
    "numpy": (1, 26),
    "orjson": (3, 10),
    "packaging": (24, 0),
    "protobuf": (5, 29),
    "rich": (13, 7),
    "tomli-w": (1, 0),
    "zstandard": (0, 22),
}
"""By hand and not from this package's metadata, which takes a package to be read; a test holds them together."""

DESCRIPTORS_WANTED = 1024
CONNECT_WITHIN_S = 5.0


INSTALL_STUDY = "pip install 'deltaswarm[study]'"

FOR_STUDIES = {"jinja2": (3, 1), "markupsafe": (2, 1), "matplotlib": (3, 9), "pandas": (2, 2), "scipy": (1, 15)}
"""The same for the extra `study`, without which runs work, but no sweeps, studies and reports."""


@dataclass(frozen=True)
class Finding:
    """One thing looked at; `advice` says what to do where it is not well."""

    name: str
    found: str
    is_well: bool
    advice: str = ""


def examine() -> list[Finding]:
    """Look at this machine."""
    packages = [_package(name, least) for name, least in NEEDED.items()]
    return [_python(), *packages, _studies(), _cores(), _descriptors(), _loopback(), _start_method()]


def _python() -> Finding:
    well = sys.version_info >= (3, 11)
    return Finding("Python", platform.python_version(), well, "Python 3.11 or newer is needed")


def _package(name: str, least: tuple[int, int]) -> Finding:
    wanted = ".".join(map(str, least))
    advice = f"python -m pip install '{name}>={wanted}'"
    try:
        found = version(name)
    except PackageNotFoundError:
        return Finding(name, "not installed", False, advice)
    numbers = tuple(int(part) for part in found.split(".")[:2] if part.isdecimal())
    return Finding(name, found, numbers >= least, advice)


def _studies() -> Finding:
    lacking = [name for name, least in FOR_STUDIES.items() if not _package(name, least).is_well]
    found = f"not here (without {', '.join(lacking)}): {INSTALL_STUDY}" if lacking else "can be done"
    return Finding("sweeps and studies", found, True)


def _cores() -> Finding:
    cores = len(os.sched_getaffinity(0))
    return Finding("cores", str(cores), cores >= 2, "a swarm runs on one core too, at about half the speed")


def _descriptors() -> Finding:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    advice = f"ulimit -n {DESCRIPTORS_WANTED} (the hard limit is {hard})"
    return Finding("file descriptors", str(soft), soft >= DESCRIPTORS_WANTED, advice)


def loopback_problem() -> str | None:
    """Why 127.0.0.1 cannot be bound and connected to; None if it can. All parts of a run meet there."""
    try:
        with (
            socket.create_server(("127.0.0.1", 0)) as server,
            socket.create_connection(server.getsockname(), CONNECT_WITHIN_S),
        ):
            return None
    except OSError as error:
        return error.strerror or str(error)


def _loopback() -> Finding:
    problem = loopback_problem()
    found = f"127.0.0.1: {problem}" if problem else "127.0.0.1 listens and connects"
    return Finding("loopback", found, problem is None, "ip link set lo up (as root)")


def _start_method() -> Finding:
    import multiprocessing

    well = "forkserver" in multiprocessing.get_all_start_methods()
    return Finding("fork server", "available" if well else "missing", well, "Linux or another Unix is needed")


def to_json(findings: list[Finding]) -> str:
    """As JSON."""
    return json.dumps([asdict(finding) for finding in findings])


def text(findings: list[Finding]) -> str:
    """For people: what is not well comes with its advice."""
    width = max(len(finding.name) for finding in findings)
    return "\n".join(
        f"{'ok     ' if f.is_well else 'MISSING'} {f.name:{width}}  {f.found}{'' if f.is_well else f'  ->  {f.advice}'}"
        for f in findings
    )


def can_start_parts() -> bool:
    """Whether the parts of a run could reach each other; says so if not."""
    if problem := loopback_problem():
        complain(f"the parts of a run meet at 127.0.0.1, which does not work here ({problem}); run `deltaswarm doctor`")
    return problem is None
