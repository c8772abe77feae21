"""The operator's process: takes what its source brings, closes steps, and serves the console of its person.

A source is a world or the open air. Only this file and the two sources use Zenoh.
"""

import logging
import queue
import signal
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.arrivals import BY, ArrivalKind, Arrivals
from deltaswarm_operator.io.console_server import ANSWER_WITHIN_S, Channel, ConsoleServer, Outlet, SavedConsole
from deltaswarm_operator.io.files import OperatorFiles
from deltaswarm_operator.io.markers import markers_to
from deltaswarm_operator.io.page import Page
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire.child import ENDED_BY_CONDUCTOR, FAILED, WORLD_LOST, ended_by
from deltaswarm_wire.commands import Pace, Turn
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_wire.session import Pairs, RouterLink, closing, configured, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.operator")


@dataclass(frozen=True, kw_only=True)
class OperatorConfig:
    run: str
    link: RouterLink
    settings: OperatorSettings
    step_s: float
    out: Path
    """Folder for the operator's table and totals."""
    go_on: bool = False
    """Resume the counts of a killed operator."""
    station: socket.socket | None = None
    """The operator's end of the socket pair, if there is a station."""
    conductor: socket.socket | None = None
    """The same for the page of the experiment's conductor."""
    listen: str | None = None
    """HOST:PORT of a station that the operator starts itself; None: it starts none."""
    markers: str = ""
    """Where to publish the person's acts and questions as they happen: HOST:PORT, `lsl`, or nowhere if empty."""


class End(Enum):
    LAST_CLOCK = "the last step is closed"
    WORLD_GONE = "the world is gone before its last step"
    STOPPED = "stopped by a signal"
    ENDED = "the conductor ended the run"
    FAILED = "the operator failed"


class ClosedStep(NamedTuple):
    clock: Clock
    workload: Workload
    reports: tuple[Report, ...]
    row: Sequence[Any]


class StepSource(ABC):
    """Where reports and time come from, and where turns go. Its methods run in the main thread."""

    COLUMNS: ClassVar[Sequence[str]]
    COMPLETE_AT: ClassVar[End]
    """The end that leaves a complete run."""
    NEEDS_TABLE: ClassVar[bool] = True
    """Whether the operator ends if its table cannot be written."""
    REFUSED: ClassVar[str] = "cannot open a session"
    """The message if the session does not open."""
    REFUSED_CODE: ClassVar[int] = FAILED
    """The exit code then."""

    config: OperatorConfig
    arrivals: Arrivals
    pairs: Pairs
    is_awaited = False
    """Whether every turn is sent, because somebody waits for it."""

    def enqueue(self, arrival: ArrivalKind) -> Any:
        """Make a callback that queues a sample, in the thread that reads the link.

        By default each subscriber has its own thread, and a clock could overtake earlier reports.
        """
        put = self.arrivals.put
        return zenoh.handlers.Callback(lambda sample: put(arrival, sample), indirect=False)

    @abstractmethod
    def join(self, session: zenoh.Session, output: OperatorFiles) -> Console | SavedConsole | None:
        """Subscribe and declare publishers; return the console, if the operator has one."""

    @abstractmethod
    def start(self, console: ConsoleServer | None) -> None:
        """Begin, and start the console once its turns are received."""

    @abstractmethod
    def send_turn(self, turn: Turn) -> None:
        """Send a turn of the operator."""

    def send_pace(self, pace: Pace) -> None:  # noqa: B027 (a source may have no pace)
        """Send the pace that the person wants."""

    @abstractmethod
    def wait_s(self) -> float:
        """Return the longest time until `on_wakeup` must be called again [s]."""

    @abstractmethod
    def take(self, arrival: ArrivalKind, sample: Any) -> ClosedStep | End | None:
        """Take what has arrived."""

    @abstractmethod
    def on_wakeup(self, *, is_idle: bool) -> ClosedStep | End | None:
        """Handle time-outs; called after each arrival, with `is_idle` after a time-out without one."""

    @abstractmethod
    def after(self, step: ClosedStep) -> None:
        """Do what follows a step that the table and the console have taken in."""

    def save_act(self) -> None:  # noqa: B027 (only a world's operator is replaced)
        """Save what the person has done, before the page shows it."""

    def release(self) -> None:  # noqa: B027 (only a world waits for its operator)
        """Let go of the world after its last step."""

    @property
    @abstractmethod
    def totals(self) -> dict[str, Any]:
        """The metrics of the whole run."""


class OperatorProcess:
    def __init__(
        self, source: StepSource, session: zenoh.Session, output: OperatorFiles, station: socket.socket | None = None
    ) -> None:
        self._source = source
        self._output = output
        self._is_writing = True
        self._server: ConsoleServer | None = None
        config = source.config

        def channel(end: socket.socket | None, intents: ArrivalKind) -> Channel | None:
            return None if end is None else Channel(end, lambda intent: source.arrivals.put(intents, intent))

        console = source.join(session, output)
        if console is not None:
            self._server = ConsoleServer(
                config.run,
                console,
                config.out,
                Outlet(source.send_turn, source.send_pace, source.is_awaited),
                channel(station, ArrivalKind.INTENT),
                conductor=channel(config.conductor, ArrivalKind.CONDUCT),
                markers=markers_to(config.markers, config.run) if config.markers else None,
            )
        source.start(self._server)

    def run(self) -> End:
        """Process arrivals in order until the end; return why the operator ends."""
        source, server = self._source, self._server
        while True:
            wait_s, console_s = source.wait_s(), None if server is None else server.wait_s
            event, is_idle = None, False
            try:
                arrival, sample = source.arrivals.get(wait_s if console_s is None else min(wait_s, console_s))
            except queue.Empty:
                is_idle = True
            else:
                if arrival is ArrivalKind.STOP:
                    return End.STOPPED
                if arrival not in BY:
                    event = source.take(arrival, sample)
                elif server is not None:
                    if server.on_intent(sample, BY[arrival]):
                        source.save_act()
                    server.show()
                    if server.console.is_ended:
                        return End.ENDED
            event = event or source.on_wakeup(is_idle=is_idle)
            if isinstance(event, End):
                return event
            if event is not None:
                self._close(event)
                if event.clock.last:
                    return End.LAST_CLOCK
            elif server is not None and (is_idle or server.is_due):
                server.show()

    def _close(self, step: ClosedStep) -> None:
        """Write a closed step down and answer it. In open air a full disk ends the table, and nothing else."""
        if self._is_writing:
            try:
                self._output.row(step.row)
            except OSError as error:
                if self._source.NEEDS_TABLE:
                    raise
                log.error("writing to %s stopped: %s", self._source.config.out, error)
                self._is_writing = False
        if self._server is not None:
            self._server.close_step(step.clock, step.workload, step.reports)
        self._source.after(step)

    def answer_to_the_end(self) -> None:
        """After the last step, release the world and wait for the person's open answers."""
        # The run is complete, even if this process is killed while its person answers.
        self._output.totals(self._totals_at(End.LAST_CLOCK))
        server = self._server
        if server is None:
            return
        self._source.release()
        deadline = time.monotonic() + ANSWER_WITHIN_S
        while server.is_asking and time.monotonic() < deadline:
            try:
                arrival, sample = self._source.arrivals.get(server.wait_s or 0.0)
            except queue.Empty:
                server.show()
                continue
            if arrival in BY:
                server.on_intent(sample, BY[arrival])
                server.show()
            if arrival is ArrivalKind.STOP or server.console.is_ended:
                break

    def _totals_at(self, end: End) -> dict[str, Any]:
        ending = {"complete": end is self._source.COMPLETE_AT, "end": end.value}
        return ending | self._source.totals | ({} if self._server is None else self._server.console.totals)

    def finish(self, end: End) -> None:
        if self._server is not None:
            self._server.finish()
        self._output.finish(self._totals_at(end))


def run_operator(source: StepSource) -> int:
    """Run the operator. Exit code: 0 after a complete run, else one of `deltaswarm_wire.child`.

    Call it in the main thread: it stops on SIGTERM, SIGINT and SIGHUP unless they are ignored.

    Raises:
        FileExistsError: the folder holds an operator's table already.
        ValueError: the user's own Zenoh settings are refused.
        OSError: the station does not start, or a table that the run needs cannot be written.
    """
    zenoh.init_log_from_env_or("error")
    signals: list[int] = []

    def stop(number: int, _: object) -> None:
        signals.append(number)
        source.arrivals.stop()  # after what has already arrived

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, stop)
    config = source.config
    settings = configured(zenoh.Config, source.pairs, config.link)
    with ExitStack() as stack:
        station = config.station
        if config.listen is not None:
            page = stack.enter_context(Page(config.listen))
            station = page.end
            print(page.url, flush=True)
        try:
            session = stack.enter_context(closing(zenoh.open(settings), log.warning))
        except zenoh.ZError as error:
            log.critical("%s: %s", source.REFUSED.format(endpoint=config.link.endpoint), error)
            return source.REFUSED_CODE
        try:
            end = _run_session(source, session, station)
        except OSError as error:
            if source.NEEDS_TABLE:
                raise
            log.critical("the table in %s is incomplete: %s", config.out, error)
            return FAILED
    if end is source.COMPLETE_AT:
        return 0
    return {
        End.WORLD_GONE: WORLD_LOST,
        End.ENDED: ENDED_BY_CONDUCTOR,
        End.STOPPED: ended_by(signals[0] if signals else 0),
    }.get(end, FAILED)


def _run_session(source: StepSource, session: zenoh.Session, station: socket.socket | None) -> End:
    with OperatorFiles(source.config.out, source.COLUMNS, go_on=source.config.go_on) as output:
        process = OperatorProcess(source, session, output, station)
        end = End.FAILED
        try:
            end = process.run()
            if end is End.LAST_CLOCK:
                process.answer_to_the_end()
        finally:
            process.finish(end)
    totals = source.totals
    level = logging.INFO if end is source.COMPLETE_AT else logging.ERROR
    log.log(level, "%s: %d steps, %d messages, %d lost", end.value, *map(totals.get, ("steps", "messages", "lost")))
    return end
