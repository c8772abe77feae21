"""`python -m deltaswarm_operator.io.replaying`: the station's page for a finished run, from a file of its steps.

The file is a stream of MessagePack values: the briefing, then each step: clock, workload, encoded reports, items read.
"""

import argparse
import contextlib
import socket
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import msgpack

from deltaswarm_operator.core.replay import RecordedStep, Replay
from deltaswarm_operator.io.channel import Channel
from deltaswarm_operator.station import __main__ as station
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_wire import checked
from deltaswarm_wire.codec import MAX_ORDINARY_BYTES
from deltaswarm_wire.command_line import Parser
from deltaswarm_wire.operator_messages import Clock, Workload, decode_report

SHOW_EVERY_S = 0.1
HELLO_EVERY_S = 1.0


def parser() -> argparse.ArgumentParser:
    """Make the argument parser of a replay."""
    made = Parser(prog="deltaswarm replay", description="Show a finished run on the station's page.")
    made.add_argument("steps", type=Path, metavar="FILE", help="the run's steps, as `deltaswarm replay` makes them")
    made.add_argument("--run", default="run", help="the run's name on the page")
    made.add_argument("--listen", default="127.0.0.1:0", metavar="HOST:PORT", help="where the page is served")
    return made


def read(file: Path) -> tuple[Briefing, list[RecordedStep]]:
    """Read briefing and steps from a file. Raises ValueError: the file is malformed or has no step."""
    with file.open("rb") as stream:
        values = msgpack.Unpacker(stream, max_buffer_size=16 * MAX_ORDINARY_BYTES)
        try:
            briefing = checked.load(Briefing, next(values, None))
            steps = [
                RecordedStep(Clock(*clock), Workload(*workload), tuple(map(decode_report, reports)), tuple(read))
                for clock, workload, reports, read in values
            ]
        except (TypeError, msgpack.UnpackException) as error:
            raise ValueError(f"{file}: {error}") from None
    if not steps:
        raise ValueError(f"{file} must hold at least one step (got none)")
    return briefing, steps


class ReplayDriver:
    """Drives a replay through a channel, in a separate thread, until the station has gone."""

    def __init__(self, run: str, replay: Replay, end: socket.socket) -> None:
        self._run = run
        self._replay = replay
        self._lock = threading.Lock()
        self._has_ended = threading.Event()
        self._news = threading.Event()
        self._channel = Channel(end, self._take)
        self._thread = threading.Thread(target=self._drive, daemon=True)
        self._thread.start()

    def _take(self, intent: bytes | None) -> None:
        if intent is None:
            self._has_ended.set()
        else:
            with self._lock:
                for answer in self._replay.intend(intent):
                    self._channel.send(answer)
        self._news.set()

    def _drive(self) -> None:
        hello_due = 0.0
        while not self._has_ended.is_set():
            with self._lock:
                self._replay.tick(time.monotonic())
                if time.monotonic() >= hello_due:
                    hello_due = time.monotonic() + HELLO_EVERY_S
                    self._channel.send(self._replay.hello(self._run))
                self._channel.send(self._replay.show())
                for told in self._replay.news():
                    self._channel.send(told)
            self._news.wait(SHOW_EVERY_S)
            self._news.clear()


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the replay until interrupted. Exit code: 2 for bad arguments, else the station's."""
    arguments = parser().parse_args(argv)
    try:
        briefing, steps = read(arguments.steps)
    except (OSError, ValueError) as error:
        print(f"deltaswarm replay: {error}", file=sys.stderr)
        return 2
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ReplayDriver(arguments.run, Replay(briefing, steps), ours)
    with contextlib.suppress(KeyboardInterrupt):
        return station.main(["--channel-fd", str(theirs.detach()), "--listen", arguments.listen])
    return 0


if __name__ == "__main__":
    sys.exit(main())
