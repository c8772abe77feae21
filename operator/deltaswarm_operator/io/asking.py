"""Ask the unanswered questions of a finished run."""

import contextlib
import queue
import time
from pathlib import Path

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.console_server import ANSWER_WITHIN_S, Channel, ConsoleServer, Outlet
from deltaswarm_scenario.operator_settings import Briefing


def ask(
    briefing: Briefing,
    out: Path,
    channel: Channel,
    intents: "queue.SimpleQueue[bytes | None]",
) -> None:
    """Ask what a briefing asks for after a run, until all is answered, the time is over or the station has gone.

    Args:
        briefing: its probes are what is asked.
        out: the folder for the answers, `probes.csv`; its name stands for the run.
        channel: to the station; what it takes is in `intents`.
        intents: see there.
    """
    console = Console(briefing)
    server = ConsoleServer(out.name, console, out, Outlet(lambda _: None, lambda _: None), channel)
    console.conclude()
    console.probes.end(briefing.duration_s, time.monotonic())
    deadline = time.monotonic() + ANSWER_WITHIN_S
    try:
        while server.is_asking and time.monotonic() < deadline:
            server.show()
            with contextlib.suppress(queue.Empty):
                server.on_intent(intents.get(timeout=server.wait_s))
    finally:
        server.finish()
