"""An operator's console behind a station, without a world: the test closes its steps, a thread serves its page."""

import contextlib
import queue
import threading
from pathlib import Path
from typing import Any

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.console_server import Channel, ConsoleServer, Outlet
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from tests.support.station_feed import Feed

EVENT = 7
"""The event that every report names."""


class AtTheConsole:
    """Serves a page as the operator's process does, and writes its tables."""

    def __init__(self, feed: Feed, briefing: Briefing, folder: Path, run: str = "a-run") -> None:
        self.console = Console(briefing)
        self.step = -1
        self._inbox = queue.SimpleQueue[bytes | None]()
        self._lock = threading.Lock()
        self._is_over = False
        put: Any = lambda _: None  # noqa: E731 (no world takes turns or the pace)
        self._server = ConsoleServer(run, self.console, folder, Outlet(put, put), Channel(feed.socket, self._inbox.put))
        self._server.start()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close_step(self, *, last: bool = False) -> None:
        """Close a step, in which one agent reports an event."""
        with self._lock:
            self.step += 1
            time_s = self.step * self.console.briefing.step_s
            event = Event(EVENT, 50.0, 50.0)
            told = Report(1, self.step, self.step, "attending", 50.0, 50.0, 0, (event,), (), ())
            workload = Workload(self.step, time_s, 1, 1, 0.0, 0.0, 0.0, 0, 0, 0)
            self._server.close_step(Clock(self.step, time_s, last), workload, (told,))

    @property
    def is_asking(self) -> bool:
        """Whether a question is open, or an input may be on the way."""
        with self._lock:
            return self._server.is_asking

    def finish(self) -> None:
        """Serve what has arrived, and complete the tables."""
        self._is_over = True
        self._thread.join()
        self._server.finish()

    def _serve(self) -> None:
        while not self._is_over or not self._inbox.empty():
            with contextlib.suppress(queue.Empty):
                intent = self._inbox.get(timeout=0.05)
                with self._lock:
                    self._server.on_intent(intent)
            with self._lock:
                self._server.show()
