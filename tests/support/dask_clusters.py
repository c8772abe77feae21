"""Dask clusters for tests: a scheduler and workers, each a process of its own."""

import json
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.swarms import PATIENCE_S, wait_until
from tests.support.sweeping import MARK, marked

distributed = pytest.importorskip("distributed")


class Cluster:
    """A scheduler and its workers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.mark = uuid.uuid4().hex
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", self.file)
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

    def add_worker(self, **environment: str) -> subprocess.Popen[bytes]:
        """One more worker, called w0, w1 and so on, which nobody starts again."""
        place = ["--local-directory", str(self.folder), "--name", f"w{len(self.workers)}"]
        worker = self._start("worker", self.address, "--nthreads", "1", "--no-nanny", *place, **environment)
        self.workers.append(worker)
        with distributed.Client(self.address, timeout=PATIENCE_S) as client:
            client.wait_for_workers(len(self.workers), timeout=PATIENCE_S)
        return worker

    def _start(self, part: str, *arguments: str, **environment: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{part}.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.dask_{part}", "--no-dashboard", *arguments],
                stdout=log,
                stderr=log,
                cwd=self.folder,
                env={**os.environ, MARK: self.mark, **environment},
            )

    def end(self) -> None:
        """Every process of it, and what they started."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()
        for pid in marked(self.mark):
            os.kill(pid, signal.SIGKILL)


@contextmanager
def dask_cluster(folder: Path) -> Iterator[Cluster]:
    """A scheduler without workers; nothing of it is left, whatever the test does."""
    folder.mkdir()
    made_here = Cluster(folder)
    try:
        yield made_here
    finally:
        made_here.end()
