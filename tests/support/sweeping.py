"""Sweeps for tests: small ones, commands that do them, and what they leave behind."""

import json
import os
import subprocess
import sys
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, Task
from deltaswarm_orchestrator.sweeps.load import make_sweep
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_wire.checked import SettingsError
from tests.support.swarms import COMMAND, PATIENCE_S, is_running, kill, wait_until

MARK = "DELTASWARM_TEST_MARK"
"""Processes inherit it whatever they do to their sessions and groups: by it a test finds all that it caused."""

SHORT: dict[str, Any] = {"run": {"duration_s": 60.0}, "metrics": {"horizon_s": 20.0}}
LOSSES = (0.0, 0.2, 0.4)

TEXT = """
schema = 1
name = "mine"
base = "smoke"

[scenario]
run.duration_s = {duration_s}
metrics.horizon_s = 20.0

[sweep]
repeats = {repeats}
prove = {prove}
series_every_s = 20.0

[sweep.axes]
radio.loss = {losses}
"""


def described(sweep: Mapping[str, Any], **other: Any) -> dict[str, Any]:
    """A sweep's table, over short runs of the small scenario."""
    return {"schema": 1, "name": "mine", "base": "smoke", "scenario": SHORT, "sweep": dict(sweep), **other}


def made(sweep: Mapping[str, Any], **other: Any) -> Sweep:
    """A sweep over short runs of the small scenario."""
    return make_sweep(described(sweep, **other))


def mistakes(table: dict[str, Any]) -> list[str]:
    """What is wrong with a sweep's table."""
    with pytest.raises(SettingsError) as caught:
        make_sweep(table)
    return [str(problem) for problem in caught.value.problems]


def tasks_of(sweep: Sweep, means: str = IN_PROCESS) -> list[Task]:
    """Its runs, to be done."""
    return [Task(job, means) for job in sweep.jobs()]


def written(
    folder: Path, *, duration_s: float = 60.0, repeats: int = 2, prove: int = 0, losses: Sequence[float] = LOSSES
) -> Path:
    """A sweep file: so many variants by radio loss."""
    file = folder / "mine.toml"
    file.write_text(TEXT.format(duration_s=duration_s, repeats=repeats, prove=prove, losses=list(losses)))
    return file


class RunningSweep:
    """`deltaswarm sweep` under way."""

    def __init__(self, process: subprocess.Popen[str], out: Path, mark: str) -> None:
        self.process = process
        self.out = out
        self.mark = mark

    def finished(self) -> int:
        """Runs that are on file."""
        return len(list(self.out.glob("runs/*.json")))

    def wait_for_runs(self, count: int) -> None:
        """Until so many runs are on file."""
        wait_until(lambda: self.finished() >= count or self.process.poll() is not None, f"{count} runs")
        assert self.process.poll() is None, self.process.communicate()

    def finish(self, within_s: float = PATIENCE_S) -> tuple[int, str, str]:
        """Exit code, standard output, standard error."""
        out, err = self.process.communicate(timeout=within_s)
        return self.process.returncode, out, err


@contextmanager
def sweeping(file: Path | str, out: Path, *arguments: str) -> Iterator[RunningSweep]:
    """A sweep by the command line, with nothing left of it afterwards, whatever the test does."""
    with marked_command(*COMMAND, "sweep", str(file), "--out", str(out), *arguments) as (process, mark):
        yield RunningSweep(process, out, mark)


@contextmanager
def marked_command(*command: str, **variables: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A command with more environment variables, and its mark; nothing is left of it, whatever the test does."""
    mark = uuid.uuid4().hex
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, **variables, MARK: mark},
    )
    try:
        yield process, mark
    finally:
        kill(marked(mark))  # before the pipes are read to their end, which an orphan would hold open
        process.communicate()


def sweep(file: Path | str, out: Path, *arguments: str) -> dict[str, Any]:
    """A whole sweep; its manifest. Fails with the sweep's own words if it fails."""
    with sweeping(file, out, *arguments) as running:
        code, printed, errors = running.finish()
        assert code == 0, errors + printed
        all_gone(running.mark)
    return dict(json.loads((out / "manifest.json").read_text()))


def marked(mark: str, *, trackers: bool = False) -> list[int]:
    """The processes, other than this one, that carry a mark; with Python's own resource trackers only if asked for."""
    return [pid for pid in map(int, filter(str.isdigit, os.listdir("/proc"))) if _carries(pid, mark, trackers)]


def _carries(pid: int, mark: str, trackers: bool) -> bool:
    try:
        carries = f"{MARK}={mark}".encode() in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
        # Python's own tracker outlives what it tracks, in the process of the tests itself.
        is_tracker = b"resource_tracker" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
    return carries and (trackers or not is_tracker) and pid != os.getpid() and is_running(pid)


def all_gone(mark: str, within_s: float = PATIENCE_S) -> None:
    """Every process with the mark has ended within the time."""
    wait_until(lambda: not marked(mark), "the end of all processes", within_s)


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Another Python, to its end."""
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False, timeout=PATIENCE_S)
