"""`deltaswarm bench` as a process: whatever ends it, one line at most is said, and nothing stays behind."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.support.swarms import PATIENCE_S, wait_until
from tests.support.sweeping import all_gone, marked, marked_command
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

BENCHMARKS = (sys.executable, "-m", "benchmarks")
FLOOR = "from deltaswarm_orchestrator.bench import floors; floors.{}(2, 10**9)"


def measuring_process(mark: str) -> int:
    """The process that measures, as soon as it is its own: just forked, it or Python's tracker looks as its parent."""
    return int(wait_until(lambda: next(filter(_measures, marked(mark)), None), "the process of the measurement"))


def _measures(pid: int) -> bool:
    with suppress(OSError):
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def count_is(mark: str, process: subprocess.Popen[str], count: int) -> None:
    wait_until(lambda: len(marked(mark)) >= count or process.poll() is not None, f"{count} processes")
    assert process.poll() is None, process.communicate()


def check_interrupted(process: subprocess.Popen[str], mark: str, folder: Path) -> None:
    printed, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, printed, errors) == (130, "", "deltaswarm: interrupted\n")
    all_gone(mark)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM, signal.SIGHUP]))
@pytest.mark.parametrize(
    ("measurement", "processes"),
    [("processes --sizes 3 --steps 100000", 7), ("station --agents 3 --steps 100000", 8)],
)
def test_a_signal_ends_a_measured_run(tmp_path: Path, measurement: str, processes: int, number: signal.Signals) -> None:
    """To the command alone; its parts and its folder go as well."""
    with marked_command(*BENCHMARKS, *measurement.split(), TMPDIR=str(tmp_path)) as (process, mark):
        count_is(mark, process, processes)
        process.send_signal(number)
        check_interrupted(process, mark, tmp_path)


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGHUP]))
def test_a_terminals_signal_while_a_measuring_process_starts(tmp_path: Path, number: signal.Signals) -> None:
    """It reaches the whole group, also a process that is importing its modules."""
    with marked_command(*BENCHMARKS, "scale", TMPDIR=str(tmp_path)) as (process, mark):
        child = measuring_process(mark)
        wait_until(lambda: "numpy" in Path(f"/proc/{child}/maps").read_text(), "the process's imports")
        os.killpg(process.pid, number)
        check_interrupted(process, mark, tmp_path)


@pytest.mark.parametrize(
    ("arguments", "processes"),
    [
        ((*BENCHMARKS, "scale"), 2),
        ((*BENCHMARKS, "station", "--agents", "3", "--steps", "100000"), 8),
        ((sys.executable, "-c", FLOOR.format("sockets_steps_per_s")), 4),
        ((sys.executable, "-c", FLOOR.format("zenoh_steps_per_s")), 4),
    ],
    ids=["scale", "station", "sockets", "zenoh"],
)
def test_nothing_outlives_a_killed_measurement(tmp_path: Path, arguments: tuple[str, ...], processes: int) -> None:
    """By kill -9, after which it can do nothing itself, not even for what has half started and complains."""
    with marked_command(*arguments, TMPDIR=str(tmp_path)) as (process, mark):
        count_is(mark, process, processes)
        process.kill()
        all_gone(mark)


def test_a_measuring_process_that_was_killed_is_one_line(tmp_path: Path) -> None:
    """As the kernel does when memory is short."""
    with marked_command(*BENCHMARKS, "scale", TMPDIR=str(tmp_path)) as (process, mark):
        os.kill(measuring_process(mark), signal.SIGKILL)
        printed, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, printed) == (1, "")
    assert errors == "deltaswarm: a process of the measurement ended with exit code -9\n"


def test_a_run_too_short_to_be_watched_has_no_traceback(tmp_path: Path) -> None:
    """A single step of a single agent: what was not measured is null."""
    done = subprocess.run(
        [*BENCHMARKS, "processes", "--sizes", "1", "--steps", "1"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
