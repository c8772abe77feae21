"""`python -m tests.support.seats FOLDER FD KEY=VALUE ...`: a run in one process with a person at the other end of FD.

It goes on with the journal that it finds.
"""

import json
import queue
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_operator.io.console_server import Channel
from deltaswarm_orchestrator.base.exits import Reporter
from deltaswarm_orchestrator.run.at_station import Arrivals, Seat
from deltaswarm_orchestrator.run.journal import Header, Journal
from deltaswarm_orchestrator.run.lifecycle import run
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.page_messages import MAX_DATAGRAM_BYTES
from deltaswarm_scenario.person_tables import PERSON
from tests.support.swarms import BOUND_S, PATIENCE_S

MAX_PICTURE_BYTES = 1 << 20


def main() -> int:
    folder, end, *overrides = sys.argv[1:]
    arrivals: Arrivals = queue.SimpleQueue()
    channel = Channel(socket.socket(fileno=int(end)), lambda data: arrivals.put((PERSON, data)))
    file = Path(folder) / "journal"
    header, rows = Journal.read(file) or (Header.now("run", "same"), ())
    shutil.rmtree(Path(folder) / "run.part", ignore_errors=True)
    seat = Seat("run", channel, arrivals, speed=0.0, journal=Journal(file, header, rows))
    options = RunOptions(out=Path(folder) / "run", in_process=True, seat=seat)
    return run(load_scenario("smoke", overrides), options, Reporter()).code


@dataclass
class Page:
    """What a person at the other end sees and does."""

    end: socket.socket
    process: subprocess.Popen[bytes]

    def hear(self, is_it: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the next message that is it; say that the page is there."""
        deadline = time.monotonic() + BOUND_S
        while time.monotonic() < deadline:
            message: dict[str, Any] = json.loads(self.end.recv(MAX_PICTURE_BYTES))
            if message["type"] == "picture":
                self.say("beat")
            if is_it(message):
                return message
        raise TimeoutError

    def see(self, is_it: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        return self.hear(lambda message: message["type"] == "picture" and is_it(message))

    def say(self, kind: str, **intent: Any) -> None:
        data = json.dumps({"type": kind, "from": 1, **intent}).encode()
        assert len(data) <= MAX_DATAGRAM_BYTES
        self.end.send(data)

    def ended(self) -> int:
        """Return the exit code, once it has ended."""
        return self.process.wait(BOUND_S)

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextmanager
def seated(folder: Path, *overrides: str) -> Iterator[Page]:
    """Do a run, or go on with one that was killed."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(PATIENCE_S)
    command = [sys.executable, "-m", "tests.support.seats", str(folder), str(theirs.fileno()), *overrides]
    with ours, subprocess.Popen(command, pass_fds=[theirs.fileno()]) as process:
        theirs.close()
        try:
            yield Page(ours, process)
        finally:
            process.kill()


if __name__ == "__main__":
    sys.exit(main())
