"""The orchestrator's own ear on the fabric: progress for people, and all that the recorder writes.

The one file of the orchestrator that touches Zenoh.
"""

import queue
from collections import defaultdict, deque
from logging import WARNING
from types import TracebackType
from typing import Self

from deltaswarm_orchestrator.sink import Sink
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.keys import RADIO, RECORDER, WORLD, Keys, parse_agent_key
from deltaswarm_wire.messages import (
    Report,
    Status,
    Workload,
    decode_clock,
    decode_forwarded,
    decode_report,
    decode_status,
    decode_workload,
)
from deltaswarm_wire.orders import NOTE, ProcessOrder, decode_order, encode_done
from deltaswarm_wire.session import RouterLink, client_pairs, configured, use_one_worker_thread, without_sources
from deltaswarm_wire.truth import Truth, decode_truth

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

QUEUE_SAMPLES = 20_000
"""Beyond so many samples in hand the fabric has to wait for the recorder."""


class Observer:
    """Hears status and workload; with a sink also truth, reports, clock and, for `wire`, radio frames.

    With `uplink` the reports are those that the world lets arrive; raw ones are heard for `wire` alone.

    Raises:
        ConnectionError: there is no way to the world.
    """

    def __init__(self, run: str, link: RouterLink, sink: Sink | None, *, wire: bool, uplink: bool = False) -> None:
        self.status: Status | None = None
        self.newest_workload: Workload | None = None
        self.orders: deque[ProcessOrder] = deque()
        """What the world wants done to processes, and waits for; `confirm` each."""
        self._last_step: int | None = None
        self._keys = keys = Keys(run)
        self._sink = sink
        self._wire = wire
        self._uplink = uplink
        self._queue: queue.Queue[tuple[str, bytes]] = queue.Queue(QUEUE_SAMPLES)
        self._truths: dict[int, Truth] = {}
        self._reports: dict[int, list[Report]] = defaultdict(list)
        self._open_step = 0
        try:
            self._session = zenoh.open(configured(zenoh.Config, client_pairs(link), link))
        except zenoh.ZError as error:
            reason = without_sources(str(error))
            raise ConnectionError(f"the recorder cannot join the world at {link.endpoint}: {reason}") from None
        self._done = self._session.declare_publisher(
            keys.done,
            encoding=zenoh.Encoding("application/msgpack;deltaswarm.Done.v1"),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        wanted = [keys.status, keys.workload, keys.orders]
        if sink is not None:
            wanted += [keys.clock, keys.truth, keys.forwarded if uplink else keys.all_reports]
        if wire:
            wanted += [keys.all_radio, keys.all_reports] if uplink else [keys.all_radio]
        # In the thread that reads the link: else each subscriber has its own, and the clock overtakes.
        put = zenoh.handlers.Callback(self._put, indirect=False)
        self._subscribers = [self._session.declare_subscriber(key, put) for key in wanted]
        self._token: zenoh.LivelinessToken | None = self._session.liveliness().declare_token(keys.token(RECORDER))

    def _put(self, sample: zenoh.Sample) -> None:
        self._queue.put((str(sample.key_expr), sample.payload.to_bytes()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.close()

    def work(self, timeout_s: float) -> bool:
        """Take what has arrived, after waiting at most `timeout_s` for the first; False if nothing came."""
        try:
            self._take(*self._queue.get(timeout=timeout_s))
            for _ in range(QUEUE_SAMPLES):
                self._take(*self._queue.get_nowait())
        except queue.Empty:
            return False
        return True

    @property
    def has_all(self) -> bool:
        """Whether the run has ended, as far as can be heard, and nothing more is to come."""
        if self._sink is None:
            return self.status is not None and self.status.phase == "ended"
        newest = self.newest_workload
        return self._last_step is not None and newest is not None and newest.step >= self._last_step

    def confirm(self, order: ProcessOrder) -> None:
        """Tell the world that an order is carried out."""
        self._done.put(encode_done(order.number))

    def leave_when_done(self) -> None:
        """Once nothing more is to come, tell the world that all has been taken."""
        if self.has_all and self._token is not None:
            self._token.undeclare()
            self._token = None

    def _take(self, key: str, data: bytes) -> None:
        keys = self._keys
        if key == keys.truth:
            truth = decode_truth(data)
            self._truths[truth.step] = truth
        elif key == keys.clock:
            self._close(decode_clock(data).step, decode_clock(data).last)
        elif key == keys.forwarded:
            self._take_report(decode_forwarded(data).report)
        elif key == keys.status:
            self.status = decode_status(data)
        elif key == keys.orders:
            order = decode_order(data)
            if self._sink is not None:
                self._sink.log(WARNING, WORLD, order.text, order.time_s)
            if order.action != NOTE:
                self.orders.append(order)
        elif key == keys.workload:
            self.newest_workload = decode_workload(data)
            if self._sink is not None:
                self._sink.workload(self.newest_workload)
        else:
            self._take_from_agent(key, data)

    def _take_from_agent(self, key: str, data: bytes) -> None:
        source = parse_agent_key(key)
        if source is None or self._sink is None:
            return
        agent, leaf = source
        if leaf == RADIO:
            self._sink.radio(self._open_step, agent, data)
            return
        if self._wire:
            self._sink.report_bytes(self._open_step, agent, data)
        if not self._uplink:
            self._take_report(data, agent)

    def _take_report(self, data: bytes, agent: int | None = None) -> None:
        """A report that reaches the operator; with an agent, that on whose key it came."""
        try:
            report = decode_report(data)
        except WireError:
            return  # the operator counts it as rejected
        if agent is None or report.agent == agent:
            self._reports[self._open_step].append(report)

    def _close(self, step: int, last: bool) -> None:
        truth = self._truths.pop(step, None)
        reports = sorted(self._reports.pop(self._open_step, []), key=lambda report: (report.agent, report.sequence))
        if self._sink is not None and truth is not None:
            self._sink.step(truth, reports)
        self._open_step = step + 1
        if last:
            self._last_step = step
