"""`python -m deltaswarm_operator.io.asking`: ask the unanswered questions of a finished run."""

import argparse
import contextlib
import queue
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.console_server import ANSWER_WITHIN_S, Channel, ConsoleServer, Outlet
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_wire import checked
from deltaswarm_wire.arguments import Parser, whole
from deltaswarm_wire.reading import read_toml


def parser() -> argparse.ArgumentParser:
    made = Parser(prog="python -m deltaswarm_operator.io.asking", description="Ask questions on the station's page.")
    made.add_argument("--briefing", type=Path, required=True, metavar="FILE", help="its probes are what is asked")
    made.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="for the answers: probes.csv")
    made.add_argument(
        "--channel-fd", type=whole(0), required=True, metavar="N", help="its end of the channel to the station"
    )
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Ask until all is answered, the time is over, the station has gone or a signal ends it."""
    arguments = parser().parse_args(argv)
    briefing = checked.load(Briefing, read_toml(arguments.briefing))
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    intents = queue.SimpleQueue[bytes | None]()
    channel = Channel(socket.socket(fileno=arguments.channel_fd), intents.put)
    with contextlib.suppress(KeyboardInterrupt):
        ask(briefing, arguments.out, channel, intents)
    return 0


def ask(
    briefing: Briefing,
    out: Path,
    channel: Channel,
    intents: "queue.SimpleQueue[bytes | None]",
    was_stopped: Callable[[], object] = lambda: None,
) -> None:
    """Ask what a briefing asks for after a run, until all is answered, the time is over or the station has gone.

    Args:
        briefing: its probes are what is asked.
        out: the folder for the answers, `probes.csv`; its name stands for the run.
        channel: to the station; what it takes is in `intents`.
        intents: see there.
        was_stopped: asking ends once this returns something true.
    """
    console = Console(briefing)
    server = ConsoleServer(out.name, console, out, Outlet(lambda _: None, lambda _: None), channel)
    console.conclude()
    console.probes.end(briefing.duration_s, time.monotonic())
    deadline = time.monotonic() + ANSWER_WITHIN_S
    try:
        while server.is_asking and time.monotonic() < deadline and not was_stopped():
            server.show()
            with contextlib.suppress(queue.Empty):
                server.on_intent(intents.get(timeout=server.wait_s))
    finally:
        server.finish()


if __name__ == "__main__":
    sys.exit(main())
