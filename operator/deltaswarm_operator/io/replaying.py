"""`python -m deltaswarm_operator.io.replaying`: feed the station's page of a finished run, from a file of its steps.

The file is a stream of MessagePack values: the briefing, then each step: clock, workload, encoded reports, items read,
acts.
"""

import argparse
import contextlib
import json
import queue
import socket
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgpack

from deltaswarm_operator.core.replay import RecordedStep, Replay
from deltaswarm_operator.io.console_server import HELLO_EVERY_S, SHOW_EVERY_S, Channel
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_wire import checked
from deltaswarm_wire.arguments import Parser, whole
from deltaswarm_wire.codec import MAX_ORDINARY_BYTES
from deltaswarm_wire.operator_messages import Clock, Workload, decode_report


def parser() -> argparse.ArgumentParser:
    made = Parser(prog="python -m deltaswarm_operator.io.replaying", description="Feed the page of a finished run.")
    made.add_argument("--steps", type=Path, required=True, metavar="FILE", help="as `deltaswarm replay` makes them")
    made.add_argument("--worth", type=Path, metavar="FILE", help="what orders were worth, as `deltaswarm value` says")
    made.add_argument("--run", default="run", help="the run's name on the page")
    made.add_argument(
        "--channel-fd", type=whole(0), required=True, metavar="N", help="its end of the station's channel"
    )
    return made


def read(file: Path) -> tuple[Briefing, list[RecordedStep]]:
    """Read briefing and steps from a file. Raises ValueError: the file is malformed or has no step."""
    with file.open("rb") as stream:
        values = msgpack.Unpacker(stream, max_buffer_size=16 * MAX_ORDINARY_BYTES)
        try:
            briefing = checked.load(Briefing, next(values, None))
            steps = [
                RecordedStep(
                    Clock(*clock), Workload(*workload), tuple(map(decode_report, reports)), tuple(read), tuple(acts)
                )
                for clock, workload, reports, read, acts in values
            ]
        except (TypeError, msgpack.UnpackException) as error:
            raise ValueError(f"{file}: {error}") from None
    if not steps:
        raise ValueError(f"{file} must hold at least one step (got none)")
    return briefing, steps


def feed(run: str, replay: Replay, end: socket.socket) -> None:
    intents = queue.SimpleQueue[bytes | None]()
    channel = Channel(end, intents.put)
    hello_due = 0.0
    asked: bytes | None = b""
    while asked is not None:
        now_s = time.monotonic()
        replay.tick(now_s)
        if now_s >= hello_due:
            hello_due = now_s + HELLO_EVERY_S
            channel.send(replay.hello(run))
        for message in (replay.show(), *replay.newly_read()):
            channel.send(message)
        with contextlib.suppress(queue.Empty):
            asked = intents.get(timeout=SHOW_EVERY_S)
            for message in replay.intend(asked) if asked is not None else ():
                channel.send(message)


def main(argv: Sequence[str] | None = None) -> int:
    arguments = parser().parse_args(argv)
    briefing, steps = read(arguments.steps)
    worth = json.loads(arguments.worth.read_text(encoding="utf-8"))["texts"] if arguments.worth else {}
    feed(arguments.run, Replay(briefing, steps, worth), socket.socket(fileno=arguments.channel_fd))
    return 0


if __name__ == "__main__":
    sys.exit(main())
