"""The operator's workload, computed only from arrived messages.

Pure: reports and clocks in, one `Workload` per closed step out. All rates are per simulated second, so they are
independent of the speed of the run.
"""

from collections import Counter, deque
from operator import itemgetter
from typing import Any

from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire.codec import MAX_ID, WireError
from deltaswarm_wire.digest import REPORT, Digest
from deltaswarm_wire.keys import WORLD
from deltaswarm_wire.operator_messages import Clock, Forwarded, Report, Workload, decode_forwarded, decode_report

SHORT_WINDOW_S, LONG_WINDOW_S = 1.0, 60.0

FORWARDER = -1
"""The world's number among senders; it forwards the agents' reports."""

MAX_TOLD = 100_000
"""Maximum number of events whose first report is remembered: in open air a sender may invent events."""

_Held = tuple[int, int, Report, bytes]
"""Agent, sequence, the report, its bytes."""

_agent_and_sequence = itemgetter(0, 1)


class SlidingRate:
    """Messages per second over the last `window_s` of simulated time, or over the time so far if that is less.

    The window is a whole number of steps, at least one.
    """

    def __init__(self, window_s: float, step_s: float) -> None:
        self.steps = max(1, round(window_s / step_s))
        self._step_s = step_s
        self._counts: deque[int] = deque(maxlen=self.steps)
        self._sum = 0

    def add(self, count: int) -> float:
        """Add the count of the next step; return the rate [1/s]."""
        counts = self._counts
        if len(counts) == self.steps:
            self._sum -= counts[0]
        counts.append(count)
        self._sum += count
        return self._sum / (len(counts) * self._step_s)


class WorkloadMeter:
    """Takes reports as they arrive and closes steps by the clock; a report counts in the next closed step."""

    def __init__(self, settings: OperatorSettings, step_s: float) -> None:
        self.step = -1
        """The newest closed step; -1 before the first."""
        self.is_over = False
        """Whether it was the run's last step."""
        self.reports_of_closed_step: tuple[Report, ...] = ()
        """In agent order."""
        self.told_s: dict[int, float] = {}
        """By event, the time of the step in which the first report that names it arrived [s]."""

        self._threshold_hz = settings.threshold_hz
        self._step_s = step_s
        self._digest = Digest()
        self._held: list[_Held] = []
        self._newest_forwarded = -1
        self._rates = (SlidingRate(SHORT_WINDOW_S, step_s), SlidingRate(LONG_WINDOW_S, step_s))
        self._steps = 0
        self._steps_missed = 0
        self._steps_above = 0
        self._news = 0
        self._messages: Counter[int] = Counter()
        self._lost: Counter[int] = Counter()
        self._rejected: Counter[int] = Counter()
        self._lost_in_step = 0
        self._rejected_in_step = 0

    def go_on_with(self, settings: OperatorSettings) -> None:
        """Count time above this threshold from now on."""
        self._threshold_hz = settings.threshold_hz

    def receive_forwarded(self, data: bytes) -> str | None:
        """Take one encoded report from the world; return the reason if it is dropped."""
        try:
            forwarded = decode_forwarded(data)
        except WireError as error:
            return self.reject(FORWARDER, str(error))
        return self.count_forwarded(forwarded)

    def count_forwarded(self, forwarded: Forwarded) -> str | None:
        """Take one decoded report from the world; return the reason if it is dropped.

        Gaps in the world's own sequence are losses on the fabric; gaps in an agent's are losses on the uplink.
        """
        missing = forwarded.sequence - self._newest_forwarded - 1
        if missing > 0:
            self.lose(FORWARDER, missing)
        self._newest_forwarded = forwarded.sequence
        try:
            report = decode_report(forwarded.report)
        except WireError as error:
            return self.reject(FORWARDER, str(error))
        self.count(report, forwarded.report)
        return None

    def count(self, report: Report, data: bytes) -> None:
        self._held.append((report.agent, report.sequence, report, data))

    def lose(self, agent: int, reports: int) -> None:
        """Count missing reports of an agent; negative if reports counted as missing arrived."""
        self._lost[agent] += reports
        self._lost_in_step += reports

    def reject(self, agent: int, reason: str) -> str:
        self._rejected[agent] += 1
        self._rejected_in_step += 1
        return reason

    def close_step(self, clock: Clock, backlog: int) -> Workload:
        """Close the clock's step; `backlog` is the number of samples waiting after the clock.

        `time_above_s` counts from the start of the run; the other fields are for this step.
        """
        if clock.step <= self.step:
            raise ValueError(f"clock.step must be after step {self.step} (got {clock.step})")
        missed = clock.step - self.step - 1 if self._steps else 0
        held, self._held = sorted(self._held, key=_agent_and_sequence), []
        for agent, _, _, data in held:
            self._messages[agent] += 1
            self._digest.add(clock.step, agent, REPORT, data)
        self._digest.end_step()
        self.step, self.is_over = clock.step, clock.last
        self.reports_of_closed_step = tuple([report for _, _, report, _ in held])
        if len(self.told_s) < MAX_TOLD:
            for report in self.reports_of_closed_step:
                known = len(self.told_s)
                for event, _, _ in report.events:
                    self.told_s.setdefault(event, clock.time_s)
                self._news += len(self.told_s) > known
        self._skip(missed)
        rate_1s_hz, rate_60s_hz = (rate.add(len(held)) for rate in self._rates)
        self._steps += 1
        self._steps_above += rate_60s_hz > self._threshold_hz
        workload = Workload(
            step=clock.step,
            time_s=clock.time_s,
            messages=len(held),
            senders=len({agent for agent, _, _, _ in held}),
            rate_1s_hz=rate_1s_hz,
            rate_60s_hz=rate_60s_hz,
            time_above_s=self._steps_above * self._step_s,
            backlog=backlog,
            lost=min(max(0, self._lost_in_step), MAX_ID),
            rejected=self._rejected_in_step,
        )
        self._lost_in_step = self._rejected_in_step = 0
        return workload

    def _skip(self, missed: int) -> None:
        """Count steps without a clock as steps without messages."""
        self._steps += missed
        self._steps_missed += missed
        for rate in self._rates:
            for _ in range(min(missed, rate.steps)):
                rate.add(0)

    def resume(self) -> None:
        """Go on after the newest closed step, once loaded: the world sends all later reports again."""
        self._held.clear()
        self._lost_in_step = self._rejected_in_step = 0

    @property
    def digest_hex(self) -> str:
        """The digest of all reports of closed steps, in step and agent order."""
        return self._digest.hex()

    @property
    def totals(self) -> dict[str, Any]:
        messages = self._messages.total()
        simulated_s = self._steps * self._step_s
        senders = sorted({*self._messages, *self._lost, *self._rejected})
        return {
            "steps": self._steps,
            "steps_missed": self._steps_missed,
            "messages": messages,
            "messages_per_s": messages / simulated_s if simulated_s else 0.0,
            "news": self._news,
            "senders": len(self._messages),
            "lost": self._lost.total(),
            "rejected": self._rejected.total(),
            "held": len(self._held),
            "threshold_hz": self._threshold_hz,
            "time_above_s": self._steps_above * self._step_s,
            "per_sender": {
                WORLD if agent == FORWARDER else str(agent): {
                    "messages": self._messages[agent],
                    "lost": self._lost[agent],
                    "rejected": self._rejected[agent],
                }
                for agent in senders
            },
        }
