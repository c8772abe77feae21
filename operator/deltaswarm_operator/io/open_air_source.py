"""The operator's source in open air: reports and liveliness of boards, by its own clock, and commands on the radio."""

import logging
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

from deltaswarm_operator.core.base import Base
from deltaswarm_operator.core.command_log import CommandLog
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.presence import OpenAirMeter
from deltaswarm_operator.io.arrivals import ArrivalKind, BoundedArrivals, sender_of, whose_key
from deltaswarm_operator.io.command_options import CommandOptions
from deltaswarm_operator.io.console_server import ConsoleServer
from deltaswarm_operator.io.files import OperatorFiles
from deltaswarm_operator.io.process import ClosedStep, End, OperatorConfig, StepSource
from deltaswarm_wire.commands import BASE_ID, Turn
from deltaswarm_wire.envelope import Sent, encode_sent
from deltaswarm_wire.keys import AGENT, RADIO, Keys, parse_token
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_wire.session import Pairs, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.operator")

WAKES_EVERY_S = 1.0
"""Longest wait of the main thread, so that a signal just before the wait is handled soon."""

MAX_REPORTS_OF_ONE = 16
"""The console takes this many of one agent's newest reports per step: without admission control anyone may send."""


@dataclass(frozen=True, kw_only=True)
class OpenAirConfig(OperatorConfig):
    pairs: Pairs
    status_every_s: float
    command_options: CommandOptions | None = None
    """A console with commands, a station or both."""


class OpenAirSource(StepSource):
    """Boards in open air, until a signal. Times count from the operator's start [s]."""

    COLUMNS = (*Workload._fields, "agents_alive", "agents_ill")
    COMPLETE_AT = End.STOPPED
    NEEDS_TABLE = False

    def __init__(self, config: OpenAirConfig) -> None:
        self.config: OpenAirConfig = config
        self.arrivals: BoundedArrivals = BoundedArrivals()
        self.pairs = config.pairs
        self.meter = OpenAirMeter(config.settings, config.step_s)
        self._warned: set[int | None] = set()
        self._start_s = time.monotonic()
        self._status_due_s = config.status_every_s
        self._base: Base | None = None
        self._command_log: CommandLog | None = None
        self._reports: dict[int, deque[Report]] = {}
        """The newest reports of each agent since the last step, for the console."""

    def join(self, session: zenoh.Session, output: OperatorFiles) -> Console | None:
        keys = Keys(self.config.run)
        self._start_s = time.monotonic()
        self._subscribers = [
            session.declare_subscriber(keys.all_reports, self.enqueue(ArrivalKind.REPORT)),
            session.declare_subscriber(keys.all_health, self.enqueue(ArrivalKind.HEALTH)),
            session.liveliness().declare_subscriber(
                keys.token(AGENT, "*"), self.enqueue(ArrivalKind.TOKEN), history=True
            ),
        ]
        options = self.config.command_options
        if options is None:
            return None
        self._radio = session.declare_publisher(
            keys.agent(BASE_ID, RADIO),
            encoding=zenoh.Encoding("application/msgpack;deltaswarm.Radio.v1"),
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.BEST_EFFORT,
        )
        started = int(time.time())  # Unix time: a restarted operator numbers frames higher
        self._base = Base(options.board_step_s, started)
        self._command_log = CommandLog(options.briefing.forms, options.sign, time.time)
        return Console(options.briefing, self._command_log, in_air=True)

    def start(self, console: ConsoleServer | None) -> None:
        """Start the console at once: nobody waits for it."""
        if console is not None:
            console.start()
        log.info("the operator monitors run %s", self.config.run)

    def send_turn(self, turn: Turn) -> None:
        if self._base is not None:
            self._base.send(turn.commands, self._now_s())

    def wait_s(self) -> float:
        now_s = self._now_s()
        frame_s = None if self._base is None else self._base.wait_s(now_s)
        wait_s = min(WAKES_EVERY_S, self.meter.wait_s(now_s))
        return wait_s if frame_s is None else min(wait_s, frame_s)

    def take(self, arrival: ArrivalKind, sample: Any) -> None:
        if arrival is ArrivalKind.TOKEN:
            self._take_token(sample)
            return
        agent = sender_of(sample)
        data = sample.payload.to_bytes()
        if arrival is ArrivalKind.REPORT:
            sent = sample.attachment
            reason = self._take_report(agent, data, None if sent is None else sent.to_bytes())
        else:
            reason = self._take_health(agent, data)
        if reason is not None and agent not in self._warned:
            self._warned.add(agent)
            log.warning("dropped a sample on %s: %s (more are only counted)", whose_key(agent), reason)

    def on_wakeup(self, *, is_idle: bool) -> ClosedStep | None:
        """Send the frame that is due, and close the step that is over. A report counts when it arrives.

        The step in a report is by its board's clock.
        """
        now_s = self._now_s()
        if self._base is not None and self.config.command_options and (frame := self._base.frame(now_s)) is not None:
            base_m = self.config.command_options.briefing.base_m
            self._radio.put(frame, attachment=encode_sent(Sent(now_s, *base_m)) if base_m else None)
        workload = self.meter.close_second(now_s, len(self.arrivals))
        if workload is None:
            return None
        arrived = [report._replace(step=workload.step) for of_one in self._reports.values() for report in of_one]
        self._reports.clear()
        row = (*workload, len(self.meter.alive), len(self.meter.faulty))
        return ClosedStep(Clock(workload.step, workload.time_s, False), workload, tuple(arrived), row)

    def after(self, step: ClosedStep) -> None:
        now_s = self._now_s()
        if now_s >= self._status_due_s:
            self._status_due_s = now_s + self.config.status_every_s
            log.info("%s", self._line(step.workload))

    @property
    def totals(self) -> dict[str, Any]:
        refused = {whose_key(agent): count for agent, count in self.arrivals.refused.items()}
        totals = {"refused": self.arrivals.refused.total(), **self.meter.totals, "refused_on": refused}
        if self._base is not None and self._command_log is not None:
            totals |= {"commands": self._command_log.described(self._now_s()), "frames": self._base.frames}
        return totals

    def _now_s(self) -> float:
        return time.monotonic() - self._start_s

    def _line(self, workload: Workload) -> str:
        alive = self.meter.alive
        doubled = self.meter.doubled
        totals = self.meter.totals
        faulty = "; ".join(f"{agent}: {fault}" for agent, fault in self.meter.faulty.items())
        return (
            f"{len(alive)} agents alive ({', '.join(map(str, alive)) or 'nobody'}), "
            + (f"not well ({faulty}), " if faulty else "")
            + (f"doubled ({', '.join(map(str, doubled))}), " if doubled else "")
            + f"{workload.rate_1s_hz:.1f} messages/s, {workload.rate_60s_hz:.1f} over a minute, "
            f"{totals['messages']} in all, {totals['lost']} lost, {self.arrivals.refused.total()} refused"
        )

    def _take_report(self, agent: int | None, data: bytes, sent: bytes | None) -> str | None:
        before = self.meter.is_doubled(agent)
        reason = self.meter.hear(agent, data, sent, self._now_s())
        if reason is None and agent is not None and self._base and (report := self.meter.agents[agent].newest):
            self._reports.setdefault(agent, deque(maxlen=MAX_REPORTS_OF_ONE)).append(report)
        if (is_doubled := self.meter.is_doubled(agent)) != before:
            what = "several processes report as agent %d: does another board have its number?"
            log.warning(what if is_doubled else "only one process reports as agent %d again", agent)
        return reason

    def _take_health(self, agent: int | None, data: bytes) -> str | None:
        before = self.meter.fault_of(agent)
        reason = self.meter.on_health(agent, data)
        fault = self.meter.fault_of(agent)
        if bool(fault) != bool(before):
            log.warning("agent %d is %s", agent, f"not well: {fault}" if fault else "well")
        return reason

    def _take_token(self, sample: zenoh.Sample) -> None:
        source = parse_token(str(sample.key_expr))
        if source is None:
            return
        is_there = sample.kind == zenoh.SampleKind.PUT
        (self.meter.came if is_there else self.meter.went)(source[1])
        log.info("agent %d is %s", source[1], "present" if is_there else "gone")
