"""Limits on open files and processes: known before a run starts, raised where that is allowed, named where not."""

import errno
import math
import resource
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import limits
from deltaswarm_orchestrator.base.exits import CommandError
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test


@pytest.fixture
def soft_and_hard(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[int, tuple[int, int]]:
    """What the system allows, by resource; the test may change it, and finds there what was set."""
    allowed = {
        resource.RLIMIT_NOFILE: (1024, 4096),
        resource.RLIMIT_NPROC: (resource.RLIM_INFINITY, resource.RLIM_INFINITY),
    }
    monkeypatch.setattr(resource, "getrlimit", allowed.__getitem__)
    monkeypatch.setattr(resource, "setrlimit", allowed.__setitem__)
    monkeypatch.setattr(limits, "CGROUP_LIST", Path("/nothing"))
    monkeypatch.setattr("os.getuid", lambda: 1000)
    return allowed


@pytest.mark.parametrize(
    ("agents", "before", "after"),
    [
        (25, (1024, 4096), (1024, 4096)),
        (25, (128, 4096), (153, 4096)),
        (100, (256, 4096), (400, 4096)),
        (300, (1024, 4096), (1060, 4096)),
        (300, (1024, resource.RLIM_INFINITY), (1060, resource.RLIM_INFINITY)),
        (300, (resource.RLIM_INFINITY, resource.RLIM_INFINITY), (resource.RLIM_INFINITY, resource.RLIM_INFINITY)),
    ],
)
def test_a_soft_limit_is_raised_to_what_a_run_needs(
    soft_and_hard: dict[int, tuple[int, int]], agents: int, before: tuple[int, int], after: tuple[int, int]
) -> None:
    """And no further; it is never lowered."""
    soft_and_hard[resource.RLIMIT_NOFILE] = before
    limits.make_room(agents)
    assert soft_and_hard[resource.RLIMIT_NOFILE] == after


def test_a_hard_limit_refuses_the_run_before_it_starts(
    soft_and_hard: dict[int, tuple[int, int]], tmp_path: Path, capsys: Printed
) -> None:
    """With what is needed and what is allowed; nothing is written."""
    soft_and_hard[resource.RLIMIT_NOFILE] = (100, 100)
    assert main(["run", "smoke", "--set", "agents.count=100", "--out", str(tmp_path / "run")]) == 1
    message = capsys.readouterr().err
    assert "400 open files" in message
    assert "100 are allowed" in message
    assert not (tmp_path / "run").exists()
    assert main(["run", "smoke", "--in-process", "--set", "run.duration_s=1", "--out", str(tmp_path / "one")]) == 0


def test_doctor_judges_by_the_scenario(soft_and_hard: dict[int, tuple[int, int]], capsys: Printed) -> None:
    """What is enough for one is too little for another."""
    soft_and_hard[resource.RLIMIT_NOFILE] = (100, 200)
    assert main(["doctor", "smoke"]) == 0
    capsys.readouterr()
    assert main(["doctor", "smoke", "--set", "agents.count=50"]) == 1
    assert "MISSING  open files" in capsys.readouterr().out


def process_of(folder: Path, number: int, threads: int) -> None:
    """A process with so many threads, as the kernel shows it."""
    for thread in range(threads):
        (folder / str(number) / "task" / str(thread)).mkdir(parents=True)


def test_threads_of_the_user_count(
    soft_and_hard: dict[int, tuple[int, int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel counts each thread of the user's processes; those of root are not limited."""
    monkeypatch.setattr(limits, "PROCESSES", tmp_path)
    soft_and_hard[resource.RLIMIT_NPROC] = (50, 100)
    process_of(tmp_path, 7, 30)
    process_of(tmp_path, 8, 12)
    user = tmp_path.stat().st_uid
    monkeypatch.setattr("os.getuid", lambda: user)
    assert sorted(limits._threads_of_user()) == [12, 30]
    monkeypatch.setattr("os.getuid", lambda: user + 1)
    assert not list(limits._threads_of_user())
    monkeypatch.setattr(limits, "_threads_of_user", lambda: iter([30, 12]))
    assert limits.limits(5)[1].allowed == 58
    with pytest.raises(CommandError, match="58 are allowed"):
        limits.make_room(20)
    limits.make_room(5)
    assert soft_and_hard[resource.RLIMIT_NPROC] == (100, 100)
    monkeypatch.setattr("os.getuid", lambda: 0)
    assert limits.limits(5)[1].allowed == math.inf


@pytest.mark.parametrize("version", [1, 2])
def test_the_smallest_limit_of_all_groups_above_a_container_counts(
    soft_and_hard: dict[int, tuple[int, int]], version: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Groups without a limit, without the controller or out of sight limit nothing."""
    groups = tmp_path / ("pids" if version == 1 else "")
    for path, allowed in (("a", "90"), ("a/b", "max"), ("a/b/c", "200")):
        (groups / path).mkdir(parents=True, exist_ok=True)
        (groups / path / "pids.max").write_text(f"{allowed}\n")
        (groups / path / "pids.current").write_text("60\n")
    listing = tmp_path / "cgroup"
    listing.write_text("3:cpu:/x\n8:pids:/a/b/c/d\n" if version == 1 else "0::/a/b/c/d\n")
    monkeypatch.setattr(limits, "CGROUP_LIST", listing)
    monkeypatch.setattr(limits, "CGROUPS", tmp_path)
    assert limits.limits(5)[1].allowed == 30


@in_one_test(
    ("error", "names"),
    [
        (OSError(errno.EMFILE, "Too many open files"), "files"),
        (OSError(errno.ENFILE, "Too many open files in system"), "files"),
        (BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"), "processes"),
        (RuntimeError("can't start new thread"), "threads"),
        (BaseException("OS can't spawn worker thread: Resource temporarily unavailable (os error 11)"), "threads"),
        (Exception("Unable to open listener: Too many open files (os error 24) at io/src/tcp.rs:1"), "files"),
        (MemoryError(), "memory"),
        (OSError(errno.ENOSPC, "No space left on device"), None),
        (RuntimeError("set changed size during iteration"), None),
        (Exception("Connection refused (os error 111)"), None),
    ],
)
def test_errors_are_named_by_the_limit_that_is_reached(error: BaseException, names: str | None) -> None:
    """Of Python, of the system, and of Zenoh, whose threads fail by a panic."""
    named = limits.reached(error)
    assert named is None if names is None else names in (named or "")
