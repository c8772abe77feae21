"""Dask clusters for tests: a scheduler and workers, each a process of its own."""

import json
import os
import subprocess
import sys
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.swarms import kill, wait_until
from tests.support.sweeping import MARK, marked

pytest.importorskip("distributed")


class Cluster:
    """A scheduler and its workers; `inside` is the command that runs another one elsewhere."""

    WORKER_OPTIONS = ("--nthreads", "1", "--no-nanny")

    def __init__(self, folder: Path, host: str = "127.0.0.1", inside: Sequence[str] = ()) -> None:
        self.folder = folder
        self.mark = uuid.uuid4().hex
        place = ["--host", host, "--port", "0", "--scheduler-file", self.file]
        self.scheduler = self._start(inside, "scheduler", *place)
        wait_until(self._address, "the scheduler")
        self.workers: list[subprocess.Popen[bytes]] = []

    @property
    def file(self) -> str:
        """Where the scheduler says where it is."""
        return str(self.folder / "scheduler.json")

    @property
    def address(self) -> str:
        """Of the scheduler."""
        return str(self._address())

    def _address(self) -> str | None:
        try:
            return str(json.loads(Path(self.file).read_text())["address"])
        except (OSError, ValueError):
            return None

    def add_worker(self, inside: Sequence[str] = (), **environment: str) -> subprocess.Popen[bytes]:
        """One more worker, called w0, w1 and so on, which nobody starts again."""
        place = ["--local-directory", str(self.folder), "--name", f"w{len(self.workers)}"]
        worker = self._start(inside, "worker", self.address, *self.WORKER_OPTIONS, *place, **environment)
        self.workers.append(worker)
        log = self.folder / "worker.log"
        wait_until(lambda: log.read_text().count("Registered to:") == len(self.workers), "the worker")
        return worker

    def _start(self, inside: Sequence[str], part: str, *arguments: str, **environment: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{part}.log").open("ab") as log:
            return subprocess.Popen(
                [*inside, sys.executable, "-m", f"distributed.cli.dask_{part}", "--no-dashboard", *arguments],
                stdout=log,
                stderr=log,
                cwd=self.folder,
                env={**os.environ, MARK: self.mark, **environment},
            )

    def agents(self) -> list[int]:
        """Processes on the workers, besides the workers themselves."""
        parts = {process.pid for process in (self.scheduler, *self.workers)}
        return [pid for pid in marked(self.mark) if pid not in parts]

    def end(self) -> None:
        """Every process of it, and what they started."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()
        kill(marked(self.mark))


@contextmanager
def dask_cluster(folder: Path, host: str = "127.0.0.1", inside: Sequence[str] = ()) -> Iterator[Cluster]:
    """A scheduler without workers; nothing of it is left, whatever the test does."""
    folder.mkdir()
    made_here = Cluster(folder, host, inside)
    try:
        yield made_here
    finally:
        made_here.end()


def nothing_is_left(cluster: Cluster, folder: Path) -> None:
    """Neither processes nor files of agents are left on workers whose TMPDIR is `temporary` in the folder."""
    wait_until(lambda: not cluster.agents(), "the end of the agents")
    wait_until(lambda: not os.listdir(folder / "temporary"), "no more files of agents")
