"""The operator's process: receives reports and the clock. Only this file and `open_air.py` use Zenoh."""

import logging
import queue
import signal
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import FrameType
from typing import Any, cast

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_operator.io.console_server import ANSWER_WITHIN_S, Channel, ConsoleServer
from deltaswarm_operator.io.files import Output
from deltaswarm_operator.io.markers import markers_to
from deltaswarm_scenario.operator_settings import Briefing, OperatorSettings
from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON
from deltaswarm_wire.checkpoint import is_due
from deltaswarm_wire.child import FAILED, WORLD_LOST
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.commands import encode_pace, encode_turn
from deltaswarm_wire.keys import OPERATOR, WORLD, Keys
from deltaswarm_wire.operator_messages import Workload, decode_clock, encode_workload
from deltaswarm_wire.orders import encode_taken
from deltaswarm_wire.session import RouterLink, client_pairs, configured, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.operator")

SAVE_EVERY_S, SAVE_EVERY_STEPS = 1.0, 100
"""Interval of saving the counts, whichever comes first; the world need not keep older reports."""

PUBLISH_EVERY_S = 0.5
"""Interval of published workloads [wall s], unless all are published."""


@dataclass(frozen=True)
class OperatorConfig:
    """Configuration of the operator's process."""

    run: str
    link: RouterLink
    settings: OperatorSettings
    step_s: float
    out: Path
    """Folder for the operator's table and totals."""
    go_on: bool = False
    """Resume the counts of a killed operator."""
    publish_all: bool = False
    """Publish the workload of every step, for a recorder."""
    checkpoint_steps: int = 0
    """Interval of checkpoints in steps; 0: never."""
    briefing: Briefing | None = None
    """Run details for an operator with a station or script."""
    station: socket.socket | None = None
    """The operator's end of the socket pair, if there is a station."""
    markers: str = ""
    """HOST:PORT or `lsl`: where the person's acts and questions are told as they happen; empty: nowhere."""
    conductor: socket.socket | None = None
    """The same for the page of the experiment's conductor."""


class ItemKind(Enum):
    """Kinds of items in the main thread's inbox."""

    REPORT = "report"
    CLOCK = "clock"
    LISTENER = "listener"
    WORLD_GONE = "world gone"
    INTENT = "intent"
    CONDUCT = "conduct"
    STOP = "stop"


BY = {ItemKind.INTENT: PERSON, ItemKind.CONDUCT: CONDUCTOR}
"""Whose intents these are."""


class End(Enum):
    """Why the operator ends; all reasons but the first leave a run incomplete."""

    LAST_CLOCK = "the last step is closed"
    WORLD_GONE = "the world is gone before its last step"
    STOPPED = "stopped by a signal"
    FAILED = "the operator failed"


ItemQueue = queue.SimpleQueue[tuple[ItemKind, Any]]


class OperatorProcess:
    """One run of the operator over an open session."""

    def __init__(self, config: OperatorConfig, session: zenoh.Session, inbox: ItemQueue, output: Output) -> None:
        saved = (None, None) if output.state is None else output.state
        self.meter, console = saved[0] or WorkloadMeter(config.settings, config.step_s), saved[1]
        self.meter.resume()
        self._saved = self.meter.step
        self._session = session
        self._inbox = inbox
        self._output = output
        self._publish_all = config.publish_all
        self._checkpoint_steps = config.checkpoint_steps
        self._publish_due = self._save_due = 0.0
        self._has_warned = False
        self._keys = keys = Keys(config.run)
        self._token: zenoh.LivelinessToken | None = None
        self._subscribers = [
            session.declare_subscriber(keys.forwarded, self._into_inbox(ItemKind.REPORT)),
            session.declare_subscriber(keys.clock, self._into_inbox(ItemKind.CLOCK)),
            session.liveliness().declare_subscriber(keys.token(WORLD), self._direct(self._on_world), history=True),
        ]
        self._workload = self._publisher(keys.workload, "Workload")
        self._taken = self._publisher(keys.taken(OPERATOR), "Taken")
        awaited = [self._taken, self._workload] if config.publish_all else [self._taken]
        self._console: ConsoleServer | None = None
        if config.briefing is not None:
            turns, paces = self._publisher(keys.turn, "Turn"), self._publisher(keys.pace, "Pace")
            awaited += [turns, paces]
            self._console = ConsoleServer(
                config.run,
                console or Console(config.briefing),
                config.out,
                lambda turn: turns.put(encode_turn(turn)),
                lambda pace: paces.put(encode_pace(pace)),
                lambda intent: inbox.put((ItemKind.INTENT, intent)),
                config.station,
                conductor=None
                if config.conductor is None
                else Channel(config.conductor, lambda intent: inbox.put((ItemKind.CONDUCT, intent))),
                is_awaited=config.briefing.is_awaited,
                markers=markers_to(config.markers, config.run) if config.markers else None,
            )
        self._unheard = {str(publisher.key_expr): publisher for publisher in awaited}
        """Publishers without a subscriber; the operator is not ready before this is empty."""
        listen = self._direct(lambda _: self._inbox.put((ItemKind.LISTENER, None)))
        self._matching = [publisher.declare_matching_listener(listen) for publisher in awaited]
        if config.publish_all:
            log.info("waiting for a subscriber to %s", keys.workload)
        self._declare_ready()

    def _publisher(self, key: str, message: str) -> zenoh.Publisher:
        return self._session.declare_publisher(
            key,
            encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{message}.v1"),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    # In Zenoh's own thread

    @staticmethod
    def _direct(callback: Callable[[Any], None]) -> Any:
        """Make a callback that runs in the thread that reads the link.

        By default each subscriber has its own thread, and a clock could overtake earlier reports.
        """
        return zenoh.handlers.Callback(callback, indirect=False)

    def _into_inbox(self, arrival: ItemKind) -> Any:
        put = self._inbox.put
        return self._direct(lambda sample: put((arrival, sample)))

    def _on_world(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self._inbox.put((ItemKind.WORLD_GONE, None))

    # In the main thread

    def _declare_ready(self) -> None:
        """Declare the token once every publisher has a subscriber: from now on everything sent is counted."""
        for key, publisher in tuple(self._unheard.items()):
            if cast(zenoh.MatchingStatus, publisher.matching_status).matching:  # its own stub says bool
                del self._unheard[key]
        if self._token is None and not self._unheard:
            if self._publish_all:  # a killed operator may not have sent all that it saved
                for row in self._output.rows_before:
                    self._workload.put(encode_workload(_workload(row)))
            self._taken.put(encode_taken(self._saved))
            if self._console is not None:
                self._console.start()
            self._token = self._session.liveliness().declare_token(self._keys.token(OPERATOR))
            log.info("the operator is ready" + (f", from step {self._saved + 1} on" if self._saved >= 0 else ""))

    def run(self) -> End:
        """Process the inbox in order until the end."""
        while True:
            console_s = None if self._console is None else self._console.wait_s
            try:
                arrival, sample = self._inbox.get(timeout=console_s or SAVE_EVERY_S)
            except queue.Empty:
                if self._console is not None:
                    self._console.show()
                if time.monotonic() >= self._save_due:
                    self._save()
                if not self._session.info.routers_zid():
                    return End.WORLD_GONE  # the world went before its token appeared
                continue
            if arrival is ItemKind.REPORT:
                self._take_report(sample)
            elif arrival is ItemKind.CLOCK:
                if self._take_clock(sample.payload.to_bytes()):
                    return End.LAST_CLOCK
            elif arrival is ItemKind.LISTENER:
                self._declare_ready()
            elif arrival in BY:
                if self._console is not None:
                    if self._console.on_intent(sample, BY[arrival]) and self.meter.step >= 0:
                        self._output.save((self.meter, self._console.state()))
                    self._console.show()
            else:
                return End.STOPPED if arrival is ItemKind.STOP else End.WORLD_GONE

    def _take_report(self, sample: zenoh.Sample) -> None:
        reason = self.meter.receive_forwarded(sample.payload.to_bytes())
        if reason is not None:
            self._warn(f"report: {reason}")

    def _take_clock(self, data: bytes) -> bool:
        """Close a step; True if it was the last."""
        try:
            clock = decode_clock(data)
            if clock.step == self.meter.step and self.meter.is_over:
                return True  # sent again: the operator that had closed it was killed
            workload = self.meter.close_step(clock, self._inbox.qsize())
        except (WireError, ValueError) as error:
            self._warn(f"clock: {error}")
            return False
        self._output.row(workload)
        if self._console is not None:
            self._console.close_step(clock, workload, self.meter.reports_of_closed_step)
        if self._publish_all or clock.last or time.monotonic() >= self._publish_due:
            self._publish_due = time.monotonic() + PUBLISH_EVERY_S
            self._workload.put(encode_workload(workload))
        has_checkpoint = is_due(clock.step, self._checkpoint_steps)
        is_much = clock.step >= self._saved + SAVE_EVERY_STEPS
        if clock.last or has_checkpoint or is_much or time.monotonic() >= self._save_due:
            self._save(has_checkpoint)
        return clock.last

    def _save(self, has_checkpoint: bool = False) -> None:
        """Save the counts, and confirm the step to the world."""
        self._save_due = time.monotonic() + SAVE_EVERY_S
        if self.meter.step > self._saved:
            console = None if self._console is None else self._console.state(sync=has_checkpoint)
            self._output.save((self.meter, console))
            if has_checkpoint:
                self._output.checkpoint(self.meter.step, {} if self._console is None else self._console.table_sizes)
            self._saved = self.meter.step
            self._taken.put(encode_taken(self._saved))

    def answer_to_the_end(self) -> None:
        """After the last step, release the world and wait for the person's open answers."""
        console = self._console
        if console is None:
            return
        if self._token is not None:
            self._token.undeclare()
        deadline = time.monotonic() + ANSWER_WITHIN_S
        while console.is_asking and time.monotonic() < deadline:
            try:
                arrival, sample = self._inbox.get(timeout=console.wait_s)
            except queue.Empty:
                console.show()
                continue
            if arrival in BY:
                console.on_intent(sample, BY[arrival])
                console.show()
            elif arrival is ItemKind.STOP:
                break

    def totals_at(self, end: "End") -> dict[str, Any]:
        """Return the metrics of the whole run, and how it ended."""
        ending = {"complete": end is End.LAST_CLOCK, "end": end.value, "digest": self.meter.digest_hex}
        return ending | self.meter.totals | ({} if self._console is None else self._console.totals)

    def finish_console(self) -> None:
        """Complete the tables of the person's acts."""
        if self._console is not None:
            self._console.finish()

    def _warn(self, reason: str) -> None:
        if not self._has_warned:
            self._has_warned = True
            log.warning("dropped a sample: %s (more are only counted)", reason)


def _workload(row: Sequence[str]) -> Workload:
    """Parse a row of the table."""
    return Workload(*(kind(text) for kind, text in zip(Workload.__annotations__.values(), row, strict=True)))


def run_operator(config: OperatorConfig) -> int:
    """Run the operator of one run. Exit code: 0 after the last clock, `WORLD_LOST` if the world went first, else 1.

    Call it in the main thread: it stops on SIGTERM, SIGINT and SIGHUP unless they are ignored.

    Raises:
        FileExistsError: the folder holds an operator's table already.
        ValueError: the user's own Zenoh settings are refused.
    """
    zenoh.init_log_from_env_or("error")
    inbox: ItemQueue = queue.SimpleQueue()
    stop_on_signals(lambda: inbox.put((ItemKind.STOP, None)))  # after what has already arrived
    link = config.link
    settings = configured(zenoh.Config, client_pairs(link), link)
    try:
        session = zenoh.open(settings)
    except zenoh.ZError as error:
        log.error("cannot join the world at %s (is it running, is the password right?): %s", link.endpoint, error)
        return FAILED
    with session, Output(config.out, Workload._fields, go_on=config.go_on) as output:
        process = OperatorProcess(config, session, inbox, output)
        end = End.FAILED
        meter = process.meter
        try:
            end = process.run()
            if end is End.WORLD_GONE and meter.is_over:  # the world went while this operator replaced a killed one
                end = End.LAST_CLOCK
            if end is End.LAST_CLOCK:
                # The run is complete, even if this process is killed while its person answers.
                output.totals(process.totals_at(end))
                process.answer_to_the_end()
        finally:
            process.finish_console()
            output.finish(process.totals_at(end))
    totals = meter.totals
    level = logging.INFO if end is End.LAST_CLOCK else logging.ERROR
    log.log(level, "%s: %d steps, %d messages", end.value, totals["steps"], totals["messages"])
    return {End.LAST_CLOCK: 0, End.WORLD_GONE: WORLD_LOST}.get(end, FAILED)


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` at a signal that is not ignored; `SimpleQueue.put` is safe in a handler."""

    def handle(number: int, frame: FrameType | None) -> None:
        stop()

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handle)
