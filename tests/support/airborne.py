"""An operator without a world for tests: a real process."""

import csv
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.support.fields import RUN
from tests.support.swarms import PATIENCE_S, wait_until


class Operator:
    """One under way."""

    def __init__(self, process: subprocess.Popen[bytes], folder: Path) -> None:
        self.process = process
        self.out = folder / "operator"
        self._said, self._printed = folder / "operator.err", folder / "operator.out"

    @property
    def said(self) -> str:
        """What it has written to standard error."""
        return self._said.read_text()

    @property
    def page(self) -> str:
        """The address of its station's page, once it has printed it."""
        return wait_until(lambda: self._printed.read_text().strip(), f"a page: {self.said}")

    def wait_for(self, text: str, within_s: float = PATIENCE_S) -> None:
        """Until it has said this."""
        wait_until(lambda: text in self.said, f"the operator says {text!r}: {self.said}", within_s)

    def end(self, by: signal.Signals = signal.SIGTERM) -> tuple[list[dict[str, str]], dict[str, Any]]:
        """Its table and its totals."""
        self.process.send_signal(by)
        assert self.process.wait(PATIENCE_S) == 0, self.said
        with (self.out / "operator.csv").open(newline="") as table:
            return list(csv.DictReader(table)), json.loads((self.out / "operator.json").read_text())


@contextmanager
def operating(folder: Path, *arguments: str) -> Iterator[Operator]:
    """An operator that is gone afterwards."""
    command = [sys.executable, "-P", "-m", "deltaswarm_orchestrator", "operator", "--no-world", "--run", RUN]
    with (folder / "operator.err").open("wb") as said, (folder / "operator.out").open("wb") as printed:
        command += ["--out", str(folder / "operator"), "--step-s", "0.2", "--status-every-s", "0.2", *arguments]
        process = subprocess.Popen(command, stdout=printed, stderr=said)
    try:
        yield Operator(process, folder)
    finally:
        process.kill()
        process.wait()
