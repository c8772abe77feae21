"""Limits of a user or container on open files, processes and threads (Linux)."""

import errno
import math
import os
import re
import resource
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, CommandError

DESCRIPTORS, DESCRIPTORS_PER_AGENT = 70, 3.3
"""Open files that the orchestrator, whose need is the largest, has at once at most; measured with 10 to 300 agents."""

THREADS, THREADS_PER_AGENT = 30, 4
"""Threads of a run, each of which counts as a process; two pages and the start of one more process included."""

CGROUP_LIST, CGROUPS, PROCESSES = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"), Path("/proc")

LIMITS: dict[int | None, str] = {
    errno.EMFILE: "this process may not open more files (`ulimit -n`)",
    errno.ENFILE: "this machine has no room for more open files",
    errno.EAGAIN: "no more processes or threads may be started (`ulimit -u`, or the container's pids limit)",
    errno.ENOMEM: "this machine has no memory left",
}
"""What errors of the system mean, by number."""

NO_THREAD = "can't start new thread"
"""Text of the RuntimeError that Python raises."""


@dataclass(frozen=True)
class Limit:
    """How much of a resource a run needs, and how much this process and its children may still use."""

    name: str
    needed: int
    allowed: float
    """Infinite where nothing is limited."""
    advice: str

    @property
    def shown(self) -> str:
        return "any number" if self.allowed == math.inf else f"{self.allowed:.0f}"

    @property
    def is_enough(self) -> bool:
        return self.allowed >= self.needed


def limits(agents: int, linked: int = 0) -> list[Limit]:
    """Return the limits that matter to a run; `allowed` is what the hard limits leave.

    `agents` run on this machine, `linked` agents on others: each is a link, and so an open file, of the world.
    """
    return [
        Limit(
            "open files",
            DESCRIPTORS + math.ceil(DESCRIPTORS_PER_AGENT * agents) + linked,
            _hard_limit(resource.RLIMIT_NOFILE),
            "raise the hard limit (`ulimit -Hn`; limits.conf), or take fewer agents",
        ),
        Limit(
            "processes and threads",
            THREADS + THREADS_PER_AGENT * agents,
            min(_free_of_user(), _free_of_container()),
            "raise the limit (`ulimit -Hu`; pids limit of the container), end other processes, or take fewer agents",
        ),
    ]


def make_room(agents: int, linked: int = 0) -> None:
    """Raise the soft limits of this process and its children to what a run needs, or refuse it."""
    descriptors, threads = limits(agents, linked)
    for limit in (descriptors, threads):
        if not limit.is_enough:
            raise CommandError(
                f"a run with {agents + linked} agents needs {limit.needed} {limit.name}, and {limit.shown} are "
                f"allowed: {limit.advice}",
                FAILED,
            )
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= soft < descriptors.needed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors.needed, hard))
    _, hard = resource.getrlimit(resource.RLIMIT_NPROC)  # of processes that others start too
    resource.setrlimit(resource.RLIMIT_NPROC, (hard, hard))


def reached(error: BaseException) -> str | None:
    """Return which limit of this machine an error is about; None if it is about something else."""
    number = error.errno if isinstance(error, OSError) else None
    if isinstance(error, MemoryError):
        number = errno.ENOMEM
    elif isinstance(error, RuntimeError) and NO_THREAD in str(error):
        number = errno.EAGAIN
    elif of_rust := re.search(r"\(os error (\d+)\)", str(error)):
        number = int(of_rust[1])
    return LIMITS.get(number)


def _hard_limit(resource_number: int) -> float:
    _, hard = resource.getrlimit(resource_number)
    return math.inf if hard == resource.RLIM_INFINITY else hard


def _free_of_user() -> float:
    """Return how many more threads this user may have; the kernel does not limit those of root."""
    allowed = math.inf if os.getuid() == 0 else _hard_limit(resource.RLIMIT_NPROC)
    return allowed if allowed == math.inf else max(0.0, allowed - sum(_threads_of_user()))


def _threads_of_user() -> Iterator[int]:
    for process in PROCESSES.glob("[0-9]*"):
        try:
            if process.stat().st_uid == os.getuid():
                yield len(os.listdir(process / "task"))
        except OSError:
            pass  # it has just ended


def _free_of_container() -> float:
    """Return how many more threads the control groups of this process may have, of either version."""
    free = math.inf
    for line in CGROUP_LIST.read_text(encoding="utf-8").splitlines() if CGROUP_LIST.exists() else ():
        _, controllers, path = line.split(":", 2)
        if controllers not in ("", "pids"):
            continue
        folder = (CGROUPS / controllers).joinpath(path.lstrip("/"))
        for group in (folder, *folder.parents):
            try:
                allowed, used = (
                    (group / name).read_text(encoding="utf-8").strip() for name in ("pids.max", "pids.current")
                )
            except OSError:
                continue  # a group without this controller, the root, or not visible here
            if allowed != "max":
                free = min(free, max(0.0, int(allowed) - int(used)))
    return free
