"""The operator's workload, counted from the messages that arrived and from nothing else.

Pure: reports and clocks in, one `Workload` per closed step out. All rates are over simulated time, so they
are the same at any speed.
"""

from collections import Counter, deque
from collections.abc import Mapping
from operator import itemgetter
from typing import Any

from deltaswarm_wire.codec import MAX_ID, WireError
from deltaswarm_wire.digest import REPORT, Digest
from deltaswarm_wire.keys import WORLD
from deltaswarm_wire.operator_messages import Clock, Forwarded, Report, Workload, decode_forwarded, decode_report
from deltaswarm_wire.settings_operator import OperatorSettings

SHORT_WINDOW_S, LONG_WINDOW_S = 1.0, 60.0

FORWARDER = -1
"""The world's number among senders: it hands on what agents report."""

_Held = tuple[int, int, Report, bytes]
"""Agent, sequence, the report, its bytes."""

_agent_and_sequence = itemgetter(0, 1)


class SlidingRate:
    """Messages per second over the last `window_s` of simulated time; over less while there was less.

    The window is a whole number of steps, at least one.
    """

    def __init__(self, window_s: float, step_s: float) -> None:
        self.steps = max(1, round(window_s / step_s))
        self._step_s = step_s
        self._counts: deque[int] = deque(maxlen=self.steps)
        self._sum = 0

    @property
    def counts(self) -> list[int]:
        """The counts of the window's steps, oldest first."""
        return list(self._counts)

    def add(self, count: int) -> float:
        """Take in the count of the next step; the rate [1/s]."""
        counts = self._counts
        if len(counts) == self.steps:
            self._sum -= counts[0]
        counts.append(count)
        self._sum += count
        return self._sum / (len(counts) * self._step_s)


class WorkloadMeter:
    """Takes reports as they arrive and closes steps as the clock says: a report is counted in the next to be closed."""

    def __init__(self, settings: OperatorSettings, step_s: float) -> None:
        self.step = -1
        """The newest closed step; -1 before the first."""
        self.is_over = False
        """Whether that was the run's last."""
        self.reports_of_closed_step: tuple[Report, ...] = ()
        """In agent order."""

        self._threshold_hz = settings.threshold_hz
        self._step_s = step_s
        self._digest = Digest()
        self._held: list[_Held] = []
        self._newest_forwarded = -1
        self._rates = (SlidingRate(SHORT_WINDOW_S, step_s), SlidingRate(LONG_WINDOW_S, step_s))
        self._steps = 0
        self._steps_missed = 0
        self._steps_above = 0
        self._messages: Counter[int] = Counter()
        self._lost: Counter[int] = Counter()
        self._rejected: Counter[int] = Counter()
        self._lost_in_step = 0
        self._rejected_in_step = 0

    def receive_forwarded(self, data: bytes) -> str | None:
        """Take in one report that the world hands on, in its envelope; the reason if it is dropped."""
        try:
            forwarded = decode_forwarded(data)
        except WireError as error:
            return self.reject(FORWARDER, str(error))
        return self.take_forwarded(forwarded)

    def take_forwarded(self, forwarded: Forwarded) -> str | None:
        """The same for an envelope that is open.

        The world's own sequence tells what the fabric lost; the agents' has gaps where the uplink dropped reports.
        """
        missing = forwarded.sequence - self._newest_forwarded - 1
        if missing > 0:
            self.lose(FORWARDER, missing)
        self._newest_forwarded = forwarded.sequence
        try:
            report = decode_report(forwarded.report)
        except WireError as error:
            return self.reject(FORWARDER, str(error))
        self.take_now(report, forwarded.report)
        return None

    def take_now(self, report: Report, data: bytes) -> None:
        """Take in a report and the bytes that it was decoded from."""
        self._held.append((report.agent, report.sequence, report, data))

    def lose(self, agent: int, reports: int) -> None:
        """So many reports of an agent are missing; below 0 if some that were thought so are not."""
        self._lost[agent] += reports
        self._lost_in_step += reports

    def reject(self, agent: int, reason: str) -> str:
        """Count a sample that is dropped; gives the reason back."""
        self._rejected[agent] += 1
        self._rejected_in_step += 1
        return reason

    def close(self, clock: Clock, backlog: int) -> Workload:
        """Close the clock's step; `backlog` is the number of samples that wait behind the clock.

        `time_above_s` counts from the start of the run; the other figures are the step's own.

        Raises:
            ValueError: the step is closed already.
        """
        if clock.step <= self.step:
            raise ValueError(f"step {clock.step} is closed already, {self.step} is the newest")
        missed = clock.step - self.step - 1 if self._steps else 0
        held, self._held = sorted(self._held, key=_agent_and_sequence), []
        for agent, _, _, data in held:
            self._messages[agent] += 1
            self._digest.add(clock.step, agent, REPORT, data)
        self._digest.end_step()
        self.step, self.is_over = clock.step, clock.last
        self.reports_of_closed_step = tuple([report for _, _, report, _ in held])
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
        """Steps whose clock never came pass without messages."""
        self._steps += missed
        self._steps_missed += missed
        for rate in self._rates:
            for _ in range(min(missed, rate.steps)):
                rate.add(0)

    def state(self) -> dict[str, Any]:
        """All that a meter needs to go on after the newest closed step, as JSON has it."""
        return {
            "step": self.step,
            "is_over": self.is_over,
            "digest": self._digest.hex(),
            "newest_forwarded": self._newest_forwarded,
            "rates": [rate.counts for rate in self._rates],
            "steps": self._steps,
            "steps_missed": self._steps_missed,
            "steps_above": self._steps_above,
            "messages": list(self._messages.items()),
            "lost": list(self._lost.items()),
            "rejected": list(self._rejected.items()),
        }

    def go_on(self, state: Mapping[str, Any]) -> None:
        """Go on from what another meter's `state` said; its own settings are the same."""
        self.step, self.is_over = state["step"], state["is_over"]
        self._digest = Digest(bytes.fromhex(state["digest"]))
        self._newest_forwarded = state["newest_forwarded"]
        for rate, counts in zip(self._rates, state["rates"], strict=True):
            for count in counts:
                rate.add(count)
        self._steps, self._steps_missed = state["steps"], state["steps_missed"]
        self._steps_above = state["steps_above"]
        self._messages, self._lost, self._rejected = (
            Counter(dict(state[name])) for name in ("messages", "lost", "rejected")
        )

    @property
    def digest_hex(self) -> str:
        """The digest of all reports of closed steps, in step and agent order."""
        return self._digest.hex()

    @property
    def totals(self) -> dict[str, Any]:
        """The figures of the whole run so far, as JSON has them; `per_sender` by agent."""
        messages = self._messages.total()
        simulated_s = self._steps * self._step_s
        senders = sorted({*self._messages, *self._lost, *self._rejected})
        return {
            "steps": self._steps,
            "steps_missed": self._steps_missed,
            "messages": messages,
            "messages_per_s": messages / simulated_s if simulated_s else 0.0,
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
