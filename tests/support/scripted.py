"""A program of the tests that plays a robot: it prints rows of its track, and takes words on standard input."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

from tests.support.swarms import PATIENCE_S, wait_until


class Scripted:
    """One under way. `track` has its rows, each a list of numbers."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.track: list[list[float]] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.track.append(json.loads(line))

    def tell(self, word: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(word + "\n")
        self.process.stdin.flush()

    def hears_what_was_sent(self) -> None:
        """Wait until nothing that was sent before now is still on its way; it hears all there is before each row."""
        rows = len(self.track) + 2
        wait_until(lambda: len(self.track) >= rows, "two further rows of the vehicle")

    def end(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)


One = TypeVar("One", bound=Scripted)


@contextmanager
def scripted(kind: type[One], module: str, *arguments: object) -> Iterator[One]:
    """One that is gone afterwards."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    one = kind(process)
    try:
        yield one
    finally:
        one.end()
