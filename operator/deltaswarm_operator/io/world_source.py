"""The operator's source in a world: reports that the world hands on, its clock, turns, and checkpoints."""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_operator.io.arrivals import ArrivalKind, Arrivals
from deltaswarm_operator.io.console_server import ConsoleServer, SavedConsole
from deltaswarm_operator.io.files import OperatorFiles
from deltaswarm_operator.io.process import ClosedStep, End, OperatorConfig, StepSource
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_wire.checkpoint import is_due
from deltaswarm_wire.child import WORLD_LOST
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.commands import Pace, Turn, encode_pace, encode_turn
from deltaswarm_wire.keys import OPERATOR, WORLD, Keys
from deltaswarm_wire.operator_messages import Workload, decode_clock, encode_workload
from deltaswarm_wire.orders import encode_taken
from deltaswarm_wire.session import client_pairs, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.operator")

SAVE_EVERY_S, SAVE_EVERY_STEPS = 1.0, 100
"""Interval of saving the counts, whichever comes first; the world need not keep older reports."""

PUBLISH_EVERY_S = 0.5
"""Interval of published workloads [wall s], unless all are published."""


@dataclass(frozen=True, kw_only=True)
class WorldSourceConfig(OperatorConfig):
    publish_all: bool = False
    """Publish the workload of every step, for a recorder."""
    checkpoint_steps: int = 0
    """Interval of checkpoints in steps; 0: never."""
    briefing: Briefing | None = None
    """Run details for an operator with a station or script."""


class WorldSource(StepSource):
    """The world of one run. It ends after the last clock, or when the world has gone."""

    COLUMNS = Workload._fields
    COMPLETE_AT = End.LAST_CLOCK
    REFUSED = "cannot join the world at {endpoint} (is it running, is the password right?)"
    REFUSED_CODE = WORLD_LOST

    def __init__(self, config: WorldSourceConfig) -> None:
        self.config: WorldSourceConfig = config
        self.arrivals = Arrivals()
        self.pairs = client_pairs(config.link)
        self.is_awaited = config.briefing is not None and config.briefing.is_awaited
        self._console: ConsoleServer | None = None
        self._publish_due = self._save_due = 0.0
        self._has_warned = False
        self._keys = Keys(config.run)
        self._token: zenoh.LivelinessToken | None = None

    def join(self, session: zenoh.Session, output: OperatorFiles) -> Console | SavedConsole | None:
        """Subscribe to reports and clock; resume from what a killed operator has saved."""
        config, keys = self.config, self._keys
        meter, console = (None, None) if output.state is None else output.state
        self.meter: WorkloadMeter = meter or WorkloadMeter(config.settings, config.step_s)
        self.meter.resume()
        self._saved = self.meter.step
        self._session = session
        self._output = output
        self._subscribers = [
            session.declare_subscriber(keys.forwarded, self.enqueue(ArrivalKind.REPORT)),
            session.declare_subscriber(keys.clock, self.enqueue(ArrivalKind.CLOCK)),
            session.liveliness().declare_subscriber(keys.token(WORLD), self.enqueue(ArrivalKind.TOKEN), history=True),
        ]
        self._workload = self._publisher(keys.workload, "Workload")
        self._taken = self._publisher(keys.taken(OPERATOR), "Taken")
        awaited = [self._taken, self._workload] if config.publish_all else [self._taken]
        if config.briefing is not None:
            self._turns, self._paces = self._publisher(keys.turn, "Turn"), self._publisher(keys.pace, "Pace")
            awaited += [self._turns, self._paces]
            console = console or Console(config.briefing)
        self._unheard = {str(publisher.key_expr): publisher for publisher in awaited}
        """Publishers without a subscriber; the operator is not ready before this is empty."""
        return cast(Console | SavedConsole | None, console if config.briefing is not None else None)

    def start(self, console: ConsoleServer | None) -> None:
        """Wait until every publisher has a subscriber."""
        self._console = console
        listen = self.enqueue(ArrivalKind.LISTENER)
        self._matching = [publisher.declare_matching_listener(listen) for publisher in self._unheard.values()]
        if self.config.publish_all:
            log.info("waiting for a subscriber to %s", self._keys.workload)
        self._declare_ready()

    def _publisher(self, key: str, message: str) -> zenoh.Publisher:
        return self._session.declare_publisher(
            key,
            encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{message}.v1"),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def _declare_ready(self) -> None:
        """Declare the token once every publisher has a subscriber: from now on everything sent is counted."""
        for key, publisher in tuple(self._unheard.items()):
            if cast(zenoh.MatchingStatus, publisher.matching_status).matching:  # its own stub says bool
                del self._unheard[key]
        if self._token is None and not self._unheard:
            if self.config.publish_all:  # a killed operator may not have sent all that it saved
                for row in self._output.rows_before:
                    self._workload.put(encode_workload(_workload(row)))
            self._taken.put(encode_taken(self._saved))
            if self._console is not None:
                self._console.start()
            self._token = self._session.liveliness().declare_token(self._keys.token(OPERATOR))
            log.info("the operator is ready" + (f", from step {self._saved + 1} on" if self._saved >= 0 else ""))

    def send_turn(self, turn: Turn) -> None:
        self._turns.put(encode_turn(turn))

    def send_pace(self, pace: Pace) -> None:
        self._paces.put(encode_pace(pace))

    def wait_s(self) -> float:
        return SAVE_EVERY_S

    def take(self, arrival: ArrivalKind, sample: Any) -> ClosedStep | End | None:
        if arrival is ArrivalKind.REPORT:
            reason = self.meter.receive_forwarded(sample.payload.to_bytes())
            if reason is not None:
                self._warn(f"report: {reason}")
        elif arrival is ArrivalKind.CLOCK:
            return self._take_clock(sample.payload.to_bytes())
        elif arrival is ArrivalKind.LISTENER:
            self._declare_ready()
        elif arrival is ArrivalKind.TOKEN and sample.kind == zenoh.SampleKind.DELETE:
            return self._end_without_world()
        return None

    def _take_clock(self, data: bytes) -> ClosedStep | End | None:
        try:
            clock = decode_clock(data)
            if clock.step == self.meter.step and self.meter.is_over:
                return End.LAST_CLOCK  # sent again: the operator that had closed it was killed
            workload = self.meter.close_step(clock, len(self.arrivals))
        except (WireError, ValueError) as error:
            self._warn(f"clock: {error}")
            return None
        return ClosedStep(clock, workload, self.meter.reports_of_closed_step, workload)

    def _end_without_world(self) -> End:
        """The run is complete if the world went while this operator replaced one that had closed the last step."""
        return End.LAST_CLOCK if self.meter.is_over else End.WORLD_GONE

    def on_wakeup(self, *, is_idle: bool) -> End | None:
        if not is_idle:
            return None
        if time.monotonic() >= self._save_due:
            self._save()
        if not self._session.info.routers_zid():
            return self._end_without_world()  # the world went before its token appeared
        return None

    def after(self, step: ClosedStep) -> None:
        clock = step.clock
        if self.config.publish_all or clock.last or time.monotonic() >= self._publish_due:
            self._publish_due = time.monotonic() + PUBLISH_EVERY_S
            self._workload.put(encode_workload(step.workload))
        has_checkpoint = is_due(clock.step, self.config.checkpoint_steps)
        is_much = clock.step >= self._saved + SAVE_EVERY_STEPS
        if clock.last or has_checkpoint or is_much or time.monotonic() >= self._save_due:
            self._save(has_checkpoint)

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

    def save_act(self) -> None:
        """Save what the person has done, or else the operator that replaces a killed one cuts it off."""
        if self._console is not None:
            self._output.save((self.meter, self._console.state()))

    def release(self) -> None:
        """Undeclare the token, so that the world does not wait for this operator."""
        if self._token is not None:
            self._token.undeclare()

    @property
    def totals(self) -> dict[str, Any]:
        return {"digest": self.meter.digest_hex, **self.meter.totals, "told_s": self.meter.told_s}

    def _warn(self, reason: str) -> None:
        if not self._has_warned:
            self._has_warned = True
            log.warning("dropped a sample: %s (more are only counted)", reason)


def _workload(row: Sequence[str]) -> Workload:
    return Workload(*(parse(text) for parse, text in zip(Workload.__annotations__.values(), row, strict=True)))
