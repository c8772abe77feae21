"""The orchestrator's subscriptions: progress for the user, and everything that the recorder writes.

The only file of the orchestrator that uses Zenoh.
"""

import queue
import time
from collections import defaultdict, deque
from logging import WARNING
from typing import Self

from deltaswarm_orchestrator.live.observers import Seen
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_scenario.truth import Truth, decode_truth, decode_wire
from deltaswarm_wire.checkpoint import is_due
from deltaswarm_wire.digest import RADIO
from deltaswarm_wire.keys import RECORDER, WORLD, Keys
from deltaswarm_wire.operator_messages import (
    Report,
    Workload,
    decode_clock,
    decode_forwarded,
    decode_report,
    decode_status,
    decode_workload,
)
from deltaswarm_wire.orders import NOTE, ProcessOrder, decode_order, encode_done, encode_taken
from deltaswarm_wire.session import (
    RouterLink,
    client_pairs,
    configured,
    use_one_worker_thread,
    without_sources,
)

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

BATCH_S = 0.1
"""Maximum time spent on samples at a time [s], so that signals, orders and dying parts are noticed."""

CONFIRM_STEPS = 100
"""Steps between acknowledgements to the world, which does not run far ahead of them, so the queue stays short."""


class Observer(Seen):
    """Receives status, workload and orders; with a sink also truth, reports, clock and, for `wire`, raw samples.

    The sink already has the steps before `first_step`, and saves every `checkpoint_steps` steps.

    Raises:
        ConnectionError: the world cannot be reached.
    """

    def __init__(
        self,
        run: str,
        link: RouterLink,
        sink: Sink | None,
        *,
        wire: bool,
        first_step: int = 0,
        checkpoint_steps: int = 0,
    ) -> None:
        super().__init__(messages=None if sink is None else 0)
        self.heard_at = time.monotonic()
        """When the world's last status arrived (monotonic wall time [s])."""
        self.orders: deque[ProcessOrder] = deque()
        """Orders of the world for agents' processes. The world waits for each: `confirm` it when done."""
        self._last_step: int | None = None
        self._keys = keys = Keys(run)
        self._sink = sink
        self._queue: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._truths: dict[int, Truth] = {}
        self._reports: dict[int, list[Report]] = defaultdict(list)
        self.newest_step = first_step - 1
        """The newest step whose workload has arrived; `first_step` - 1 before the first one."""
        self._open_step, self._acknowledged = first_step, first_step - 1
        self._checkpoint_steps = checkpoint_steps
        try:
            self._session = zenoh.open(configured(zenoh.Config, client_pairs(link), link))
        except zenoh.ZError as error:
            reason = without_sources(str(error))
            raise ConnectionError(f"the recorder cannot join the world at {link.endpoint}: {reason}") from None
        wanted = [keys.status, keys.counted, keys.orders]
        if sink is not None:
            wanted += [keys.clock, keys.truth, keys.forwarded]
            wanted += [keys.wire] if wire else []
        # Called in the thread that reads the link: with a thread per subscriber the clock could overtake the rest.
        put = zenoh.handlers.Callback(self._put, indirect=False)
        self._subscribers = [self._session.declare_subscriber(key, put) for key in wanted]
        self._done, self._taken = (
            self._session.declare_publisher(
                key,
                encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{kind}.v1"),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            for key, kind in ((keys.done, "Done"), (keys.taken(RECORDER), "Taken"))
        )
        self._token: zenoh.LivelinessToken | None = self._session.liveliness().declare_token(keys.token(RECORDER))

    def _put(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if key == self._keys.status:  # note it on arrival: it may wait in the queue for long
            self.heard_at = time.monotonic()
        self._queue.put((key, sample.payload.to_bytes()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._session.close()

    def work(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s` for a sample, then take queued ones for up to BATCH_S; return False if none came."""
        try:
            self._receive(*self._queue.get(timeout=timeout_s))
        except queue.Empty:
            return False
        until = time.monotonic() + BATCH_S
        while time.monotonic() < until and not self._queue.empty():
            self._receive(*self._queue.get_nowait())
        return True

    @property
    def records(self) -> bool:
        """Whether there is a sink that takes everything that happens."""
        return self._sink is not None

    @property
    def has_all(self) -> bool:
        """Whether the run has ended and everything this observer takes has arrived."""
        if self._sink is None:
            return self.status is not None and self.status.phase == "ended"
        return self._last_step is not None and self.newest_step >= self._last_step

    def confirm(self, order: ProcessOrder) -> None:
        self._done.put(encode_done(order.number))

    def leave_when_done(self) -> None:
        """Tell the world that everything has been taken, once that is so, by withdrawing the liveliness token."""
        if self.has_all:
            self.leave()

    def leave(self) -> None:
        if self._token is not None:
            self._token.undeclare()
            self._token = None

    def _receive(self, key: str, data: bytes) -> None:
        keys = self._keys
        if key == keys.truth:
            truth = decode_truth(data)
            self._truths[truth.step] = truth
        elif key == keys.clock:
            self._close_step(decode_clock(data).step, decode_clock(data).last)
        elif key == keys.forwarded:
            forwarded = decode_forwarded(data)
            if forwarded.step >= self._open_step:  # older ones are sent again for a restarted operator
                self._reports[forwarded.step].append(decode_report(forwarded.report))
        elif key == keys.wire and self._sink is not None:
            step, samples = decode_wire(data)
            for agent, kind, sample in samples:
                (self._sink.radio if kind == RADIO else self._sink.report_bytes)(step, agent, sample)
        elif key == keys.status:
            self.status = decode_status(data)
        elif key == keys.orders:
            order = decode_order(data)
            if self._sink is not None:
                self._sink.log(WARNING, WORLD, order.text, order.time_s)
            if order.action != NOTE:
                self.orders.append(order)
        elif key == keys.counted:
            self._receive_workload(decode_workload(data))

    def _receive_workload(self, workload: Workload) -> None:
        if workload.step <= self.newest_step:
            return  # sent again by a restarted operator
        self.newest_workload, self.newest_step = workload, workload.step
        if self._sink is not None:
            self.messages = (self.messages or 0) + workload.messages
            self._sink.workload(workload)
            self._acknowledge()

    def _close_step(self, step: int, last: bool) -> None:
        if step < self._open_step:
            return  # sent again for a restarted operator
        truth = self._truths.pop(step, None)
        reports = sorted(self._reports.pop(step, []), key=lambda report: (report.agent, report.sequence))
        if self._sink is not None and truth is not None:
            self.newest_truth = truth
            self._sink.step(truth, reports)
        self._open_step = step + 1
        if last:
            self._last_step = step
        self._acknowledge()

    def _acknowledge(self) -> None:
        """Acknowledge the taken steps from time to time, and each checkpoint once the sink has saved it to disk."""
        step = self._open_step - 1
        if step <= self._acknowledged:
            return
        if is_due(step, self._checkpoint_steps):
            if self.newest_step < step or self._sink is None:
                return
            self._sink.save()
        elif self._last_step is None and step < self._acknowledged + CONFIRM_STEPS:
            return
        self._acknowledged = step
        self._taken.put(encode_taken(step))
