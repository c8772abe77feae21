"""However a run is stopped, and whatever state its processes are in: it ends in time and says why."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from deltaswarm_orchestrator.base import disk, kernel
from deltaswarm_orchestrator.processes import launch, starter
from deltaswarm_orchestrator.processes.process import Part, wait_for
from deltaswarm_orchestrator.recording import ACTIONS
from deltaswarm_orchestrator.results.folder import RunFolder
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.keys import AGENT
from tests.support.swarms import (
    BOUND_S,
    COMMAND,
    SMOKE_PROCESSES,
    UNHURRIED,
    RunningSwarm,
    is_running,
    parent_of,
    running,
    sets,
    wait_until,
)
from tests.support.tiers import first_of, nightly

pytestmark = pytest.mark.processes

ENDLESS = sets("run.step_timeout_s=1", "run.duration_s=1000000")
STEADY = (*ENDLESS, *UNHURRIED)
"""A run that takes its time to start, and does not end by itself."""
IMPATIENT = (*ENDLESS, *sets("run.start_timeout_s=12"))
"""A run that gives up parts that do not start."""


def pid_of(swarm: RunningSwarm, log: str) -> int | None:
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdecimal() and os.readlink(folder / "fd" / "2") == str(swarm.part / "logs" / log):
                return int(folder.name)
        except OSError:
            continue
    return None


def ends_by_itself(swarm: RunningSwarm) -> tuple[int, str]:
    """Exit code and standard error of a run that nobody helps, within the bound."""
    began = time.monotonic()
    code, _, errors = swarm.finish()
    assert time.monotonic() - began < BOUND_S
    assert "Traceback" not in errors
    return code, errors


def maps(swarm: RunningSwarm, name: str) -> Callable[[], bool]:
    return lambda: name in Path(f"/proc/{swarm.process.pid}/maps").read_text()


EARLY: dict[str, Callable[[RunningSwarm], Callable[[], object]]] = {
    "importing": lambda swarm: maps(swarm, "msgpack"),
    "a folder": lambda swarm: swarm.part.exists,
    "a world": lambda swarm: lambda: pid_of(swarm, "world-0.log"),
    "agents": lambda swarm: lambda: pid_of(swarm, "agent-0.log"),
}


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM]))
@pytest.mark.parametrize("moment", ["importing", "agents", *nightly("a folder", "a world")])
def test_a_signal_while_it_starts_ends_it_with_a_line(moment: str, number: signal.Signals, tmp_path: Path) -> None:
    """Wherever it has come to: exit code 130, a line and no traceback, no process, no table of zeros."""
    with running(tmp_path / "run", *STEADY) as swarm:
        wait_until(EARLY[moment](swarm), moment)
        os.kill(swarm.process.pid, number)
        code, printed, errors = swarm.finish()
    assert code == 130
    assert "Traceback" not in errors
    assert number.name in errors
    steps = 0 if not (swarm.out / "summary.json").exists() else swarm.summary()["steps"]
    if not steps:
        assert printed == ""
        assert len(errors.splitlines()) <= 2, errors
    assert pid_of(swarm, "world-0.log") is None
    assert not swarm.part.exists()


def test_a_world_that_stops_as_it_starts_is_given_up(tmp_path: Path) -> None:
    """It has not told where it listens, and never will."""
    with running(tmp_path / "run", *IMPATIENT) as swarm:
        world = wait_until(lambda: pid_of(swarm, "world-0.log"), "the world")
        os.kill(world, signal.SIGSTOP)
        code, errors = ends_by_itself(swarm)
    assert code == 1
    assert "world" in errors
    wait_until(lambda: not is_running(world), "the end of the world")


@pytest.mark.parametrize("stopped", first_of([["world"], ["world", "operator"], ["operator"]]))
def test_who_is_silent_is_given_up_and_named(stopped: list[str], tmp_path: Path) -> None:
    """If the operator is stopped as well, nobody but the orchestrator would notice that the world is silent."""
    with running(tmp_path / "run", *STEADY) as swarm:
        pids = swarm.wait_until_under_way()
        for part in stopped:
            swarm.signal(part, signal.SIGSTOP)
        code, errors = ends_by_itself(swarm)
    assert code == 1
    why, *later = swarm.manifest()["why"]
    assert stopped[0] in why
    assert all(line.startswith("operator lost its world ") for line in later)  # if the machine is busy
    assert why in errors
    wait_until(lambda: not any(map(is_running, pids.values())), "the end of all")


def test_a_part_that_starts_when_its_run_has_ended_says_nothing(tmp_path: Path) -> None:
    """Its folder has another name by then: it ends, without a traceback on the terminal."""
    source = (
        "from multiprocessing import Pipe; from pathlib import Path;"
        "from deltaswarm_orchestrator.processes import entry_point;"
        f"log = Path({str(tmp_path / 'gone' / 'log')!r});"
        "entry_point.main('json', [], '', log, entry_point.Inherited(Pipe()[0]), in_background=False)"
    )
    ended = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (1, "", "")


def test_no_stopped_process_outlives_a_killed_orchestrator(tmp_path: Path) -> None:
    """All others are stopped, the fork server too, and none of ours is left to wake them."""
    with running(tmp_path / "run", *STEADY) as swarm:
        pids = swarm.wait_until_under_way()
        everyone = (parent_of(pids["world"]), *pids.values())
        for pid in everyone:
            os.kill(pid, signal.SIGSTOP)
        swarm.process.kill()
        wait_until(lambda: not any(map(is_running, everyone)), "the end of all", BOUND_S)


def test_a_researchers_page_that_is_killed_costs_nothing_else(tmp_path: Path) -> None:
    """It has a name of its own, beside the station's."""
    pages = ("--researcher", "--station", "--speed", "0")
    with running(tmp_path / "run", "--set", "run.duration_s=200", *pages, *UNHURRIED) as swarm:
        swarm.wait_until_under_way(SMOKE_PROCESSES + 2)
        swarm.signal("station 1", signal.SIGKILL)
        swarm.end_well()
    [why] = swarm.manifest()["why"]
    assert why.startswith("station 1 was killed by SIGKILL")


def test_a_second_signal_waits_for_nothing(tmp_path: Path) -> None:
    """All is stopped, so that an orderly end would take its time."""
    with running(tmp_path / "run", *STEADY) as swarm:
        pids = swarm.wait_until_under_way()
        for part in pids:
            swarm.signal(part, signal.SIGSTOP)
        swarm.interrupt()
        os.kill(swarm.process.pid, signal.SIGTERM)  # the kernel may make one of two pending SIGINTs, not of two kinds
        began = time.monotonic()
        code, _, errors = swarm.finish()
        assert time.monotonic() - began < BOUND_S
    assert code == 130
    assert "Traceback" not in errors
    wait_until(lambda: not any(map(is_running, pids.values())), "the end of all")


def test_a_second_signal_cuts_the_orderly_end_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part that does not heed the request does not outlive who asked twice."""

    def wait_in_vain(parts: list[Part], within_s: float) -> list[Part]:
        if within_s == starter.END_WITHIN_S / 2:
            raise KeyboardInterrupt
        return wait_for(parts, within_s)

    monkeypatch.setattr(starter, "wait_for", wait_in_vain)
    with swarm_of("signal.signal(signal.SIGTERM, signal.SIG_IGN)", tmp_path) as (swarm, process):
        with pytest.raises(KeyboardInterrupt):
            swarm.end()
        assert process.wait() == -signal.SIGKILL


def test_a_part_that_is_stopped_ends_as_asked(tmp_path: Path) -> None:
    """When the others are gone nobody else could wake it, should the orchestrator be killed meanwhile."""
    with swarm_of("", tmp_path) as (swarm, process):
        process.send_signal(signal.SIGSTOP)
        swarm.end()
        assert process.wait() == -signal.SIGTERM


def test_a_swarm_that_started_nothing_ends_no_other_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a container, processes of a session that began outside have session 0."""
    monkeypatch.setattr(starter.FORK_SERVER, "_forkserver_pid", None)
    with swarm_of("", tmp_path) as (swarm, process):
        found = [[], [(process.pid, os.getpid(), 0)]]
        monkeypatch.setattr(kernel, "_processes", found.pop)
        swarm.parts.clear()
        swarm.end()
        assert process.poll() is None
        process.kill()


@contextmanager
def swarm_of(line: str, folder: Path) -> Iterator[tuple[launch.Swarm, subprocess.Popen[bytes]]]:
    """A swarm with one part, which runs this line and waits for signals."""
    source = f"import signal\n{line}\nprint(flush=True)\nwhile True: signal.pause()"
    with subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        swarm = launch.Swarm(load_scenario("smoke"), "short", folder)
        told = SimpleNamespace(pid=process.pid, exitcode=0)
        swarm.parts.append(Part(AGENT, 3, cast(Any, told), folder / "log"))
        yield swarm, process


@pytest.mark.parametrize("stopped", first_of([True, False]))
def test_signals_during_the_conclusion_come_too_late(stopped: bool, tmp_path: Path) -> None:
    """Held up on a file that it reads after the last step, and signalled twice, it still writes what is true."""
    length = () if stopped else ("--set", "run.duration_s=50")
    with running(tmp_path / "run", *STEADY, *length) as swarm:
        wait_until((swarm.part / "manifest.json").exists, "the folder")
        os.mkfifo(swarm.part / ACTIONS)
        if stopped:
            swarm.wait_until_under_way()
            os.kill(swarm.process.pid, signal.SIGINT)
        with os.fdopen(wait_until(lambda: reached(swarm.part / ACTIONS), "the conclusion"), "w"):
            for number in (signal.SIGINT, signal.SIGTERM):
                os.kill(swarm.process.pid, number)
        code, errors = ends_by_itself(swarm)
    manifest, summary = swarm.manifest(), swarm.summary()
    assert code == (130 if stopped else 0), errors
    assert manifest["exit_reason"] == summary["exit_reason"] == ("stopped by SIGINT" if stopped else "finished")
    assert manifest["complete"] == summary["complete"] == summary["valid"] == (not stopped)


def reached(fifo: Path) -> int | None:
    try:
        return os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
    except OSError:
        return None


def with_a_full_pipe(swarm: RunningSwarm) -> None:
    """Whatever it prints has to wait until somebody reads."""
    pipe = os.open(f"/proc/{swarm.process.pid}/fd/1", os.O_WRONLY | os.O_NONBLOCK)
    with suppress(BlockingIOError):
        while os.write(pipe, b"\n" * 4096):
            pass
    os.close(pipe)


def test_a_signal_after_the_conclusion_comes_too_late(tmp_path: Path) -> None:
    """The folder has its name and says that all is well, and so does the exit code; what was found is printed."""
    with running(tmp_path / "run", "--set", "run.duration_s=50") as swarm:
        with_a_full_pipe(swarm)
        wait_until(swarm.out.exists, "the folder's name")
        os.kill(swarm.process.pid, signal.SIGTERM)
        code, printed, errors = swarm.finish()
    assert code == 0, errors
    assert str(swarm.out) in printed
    assert swarm.summary()["valid"]


def test_who_stops_reading_does_not_keep_a_run_that_is_over(tmp_path: Path) -> None:
    """Who asks again is heard, and the exit code is still that of the run."""
    with running(tmp_path / "run", "--set", "run.duration_s=50") as swarm:
        with_a_full_pipe(swarm)
        wait_until(swarm.out.exists, "the folder's name")

        def asked_again() -> bool:
            os.kill(swarm.process.pid, signal.SIGTERM)
            return swarm.process.poll() is not None

        wait_until(asked_again, "the end")
    assert swarm.process.returncode == 0


def test_a_signal_too_late_for_one_thing_is_in_time_for_the_next() -> None:
    """Between two runs of a session."""
    source = (
        "import os, signal\n"
        "from deltaswarm_orchestrator.base.signals import decide, end_at_once_on_signals\n"
        "from deltaswarm_orchestrator.base.signals import heed_signals_again, stoppable\n"
        "end_at_once_on_signals()\n"
        "with stoppable() as stop:\n"
        "    stop.conclude()\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    decide(0)\n"
        "heed_signals_again()\n"
    )
    ended = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True)
    assert ended.returncode == 130
    assert "SIGINT" in ended.stderr


def test_a_signal_ends_a_slow_tick(tmp_path: Path) -> None:
    """A tick of five minutes: the world does not sleep through it, and what happened is in the tables."""
    slow = ("--set", "run.clock=realtime", "--set", f"run.real_time_factor={1 / 300:.6f}")
    with running(tmp_path / "run", *STEADY, *slow, "--set", "events.rate_hz=5") as swarm:
        wait_until(lambda: len(swarm.pids) == SMOKE_PROCESSES, "all processes")
        assert swarm.process.stderr is not None
        swarm.process.stderr.readline()  # how the run goes, in its first step
        swarm.interrupt()
        code, _ = ends_by_itself(swarm)
    assert code == 130
    assert swarm.summary()["steps"] >= 1
    assert (swarm.out / "events.csv").read_text().count("\n") > 1


def in_little_room(size: str, target: Path) -> list[str]:
    """A command prefix that runs another one with a small disk mounted at a folder."""
    return ["unshare", "-m", "sh", "-c", f'mount -t tmpfs -o size={size} tmpfs "{target}" && exec "$@"', "sh"]


def may_mount(target: Path) -> bool:
    return subprocess.run([*in_little_room("100k", target), "true"], capture_output=True).returncode == 0


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Where a small disk may be mounted."""
    target = tmp_path / "small"
    target.mkdir()
    if not may_mount(target):
        pytest.skip("needs to mount a small disk: root in a namespace of its own")
    return target


def fill(small: Path, size: str) -> tuple[str, Path]:
    """A run on a disk of some size that is full early or late: what it says, and a copy of what is left."""
    kept = small.with_name("kept")
    copy = ["sh", "-c", f'"$@"; code=$?; cp -r "{small}" "{kept}"; exit $code', "sh"]
    with running(small / "run", *IMPATIENT, inside=[*in_little_room(size, small), *copy]) as swarm:
        code, errors = ends_by_itself(swarm)
    assert code == 1
    assert str(small / "run") in errors
    assert is_full(errors), errors
    return errors, kept


def is_full(text: str) -> bool:
    return os.strerror(errno.ENOSPC) in text or "bytes are free" in text


@pytest.mark.parametrize("size", ["8k", "60k", *nightly("12k", "52k", "72k", "90k", "110k", "300k")])
def test_a_full_disk_ends_it_with_a_line(size: str, small: Path) -> None:
    """Whatever cannot be written first: it names the file and the cause, and the folder says the same."""
    errors, kept = fill(small, size)
    assert len([line for line in errors.splitlines() if is_full(line)]) == 1, errors
    assert "" not in errors.splitlines()  # where a reason should be
    [left] = kept.iterdir()
    told = subprocess.run([*COMMAND, "info", str(left)], capture_output=True, text=True, check=True).stdout
    assert "incomplete (failed)" in told
    assert is_full(told)


@pytest.mark.parametrize("size", first_of(["36k", "12k", "4k"]))
def test_a_full_disk_ends_a_sweep_with_a_line(size: str, small: Path) -> None:
    """While its file, a run's result or its tables are written: the path, the cause, exit code 1."""
    shorter = ["--repeats", "1", "--prove", "0", "-j", "1", "--set", "run.duration_s=5", "--quiet"]
    command = [*COMMAND, "sweep", "smoke", *shorter, "--out", str(small / "sweep")]
    done = subprocess.run([*in_little_room(size, small), *command], capture_output=True, text=True)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert str(small / "sweep") in done.stderr
    assert is_full(done.stderr)


@pytest.mark.parametrize("size", ["4k", "1m,nr_inodes=1"])
def test_a_disk_without_room_for_a_manifest_ends_it_with_a_line(size: str, small: Path) -> None:
    """What is left pretends to be nothing, and a run with more room may replace it."""
    errors, kept = fill(small, size)
    assert len([line for line in errors.splitlines() if line.startswith("deltaswarm: ")]) == 1, errors
    for left in kept.iterdir():
        told = subprocess.run([*COMMAND, "info", str(left)], capture_output=True, text=True)
        assert told.returncode != 0
        assert "manifest.json" in told.stderr
        RunFolder(kept / "run", force=True).release()


@pytest.mark.parametrize(("free_mb", "is_said"), [(1, True), (1000, False)])
def test_little_room_is_said_at_the_start(
    free_mb: int, is_said: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before hours are spent."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free_mb * 1e6))
    assert bool(disk.shortage(tmp_path, load_scenario("paper-25", []))) == is_said
