"""The samples of agents in a step, checked at the world's edge, since agents are untrusted.

The intake takes one radio frame, one report and one act per agent and step; the excess is dropped and counted.
A late board may answer several frames at once: each answer counts for the frame that it answers.
Of a radio frame the world reads the envelope, never the payload.
"""

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from typing import Any

from deltaswarm_wire import keys
from deltaswarm_wire.codec import MAX_ID, WireError
from deltaswarm_wire.envelope import decode_sample
from deltaswarm_wire.messages import Act, decode_act
from deltaswarm_wire.operator_messages import Report, decode_report
from deltaswarm_wire.orders import decode_taken
from deltaswarm_world.core.participants import Participants


def by_agent(counts: Mapping[int, int]) -> dict[str, int]:
    """Return the nonzero counts, for JSON."""
    return {str(agent): count for agent, count in sorted(counts.items()) if count}


class SequenceNumbers:
    """Checks the numbers of one kind of message, which count up from 0: a gap is a loss."""

    def __init__(self) -> None:
        self.lost: Counter[int] = Counter()
        self.fell_back: Counter[int] = Counter()
        """Resets of an agent's number without an absence; many mean that two processes share its id."""
        self._due: dict[int, int | None] = {}

    def follow(self, agent: int, number: int) -> None:
        due = self._due.get(agent, 0)
        if due is not None and number != due:
            if number > due:
                self.lost[agent] += number - due
            else:
                self.fell_back[agent] += 1
        self._due[agent] = number + 1

    def expect_first(self, agent: int) -> None:
        self._due[agent] = 0

    def accept_any_next(self, agent: int) -> None:
        self._due[agent] = None


class Intake:
    """The samples of one step, and the counts of a run. What takes a sample returns the reason if it is dropped."""

    def __init__(self, participants: Participants) -> None:
        self.transmitted: dict[int, bytes] = {}
        """Radio frames, by sender."""
        self._reports: dict[int, deque[bytes]] = {}
        """Reports not yet taken; only an agent that was late has more than one."""
        self._newest_report: dict[int, int] = {}
        self._ahead: Counter[int] = Counter()
        """Number of reports of each agent that came before the act of their frame."""
        self.acts: dict[int, tuple[bytes, Act]] = {}
        self.rejected: Counter[int] = Counter()
        """Dropped samples by the agent of their key."""
        self.excess: Counter[int] = Counter()
        """Dropped samples beyond one radio frame, one report and one act per step."""
        self.late_acts: Counter[int] = Counter()
        """Acts for steps that had continued without them, by agent."""
        self.unsaved: set[int] = set()
        """Agents that have not yet confirmed that they are saved."""
        self._saves_due: Counter[int] = Counter()
        """Number of confirmations still due from each agent."""
        self._participants = participants
        self._step = -1
        self._radio_numbers, self._report_numbers = SequenceNumbers(), SequenceNumbers()
        self._rejected_before = self._lost_before = 0

    def begin(self, step: int) -> None:
        """Open a step; reports since the last step was closed belong to this one."""
        self._step = step
        self.transmitted, self.acts = {}, {}

    def expect_new_process(self, agent: int) -> None:
        self._ahead[agent] = 0
        self._radio_numbers.expect_first(agent)
        self._report_numbers.expect_first(agent)

    def accept_any_next(self, agent: int) -> None:
        """Accept any next number from a board: its samples during an absence are not losses of the fabric."""
        self._radio_numbers.accept_any_next(agent)
        self._report_numbers.accept_any_next(agent)

    def receive(self, agent: int, leaf: str, data: bytes, act: bytes | None) -> str | None:
        """Take one sample on an agent's key, and its attached act."""
        if leaf == keys.RADIO:
            return self.hear_radio(agent, data) if act is None else self.hear_both(agent, data, act)
        if leaf == keys.REPORT:
            return self.hear_report(agent, data)
        return self.hear_saved(agent, data) if leaf == keys.TAKEN else self.hear_act(agent, data)

    def hear_both(self, agent: int, data: bytes, act_bytes: bytes) -> str | None:
        try:
            act = decode_act(act_bytes)
        except WireError as error:
            self.hear_radio(agent, data)
            return self.reject(agent, str(error))
        late = act.step < self._step or agent not in self._participants.asked
        reason = self.hear_radio(agent, data, late)
        return self.accept_act(agent, act, act_bytes) or reason

    def hear_radio(self, agent: int, data: bytes, late: bool = False) -> str | None:
        try:
            counter = decode_sample(data).counter
        except WireError as error:
            return self.reject(agent, str(error))
        return self.accept_radio(agent, counter, data, late)

    def accept_radio(self, agent: int, counter: int, data: bytes, late: bool = False) -> str | None:
        """Take one decoded radio frame. A `late` one, whose step does not wait for the agent, is not delivered."""
        self._radio_numbers.follow(agent, counter)
        if late and self._participants.unanswered(agent):
            return None
        if late or agent in self.transmitted or agent not in self._participants.asked:
            return self.reject_excess(agent, "radio: a second frame in one step, or one out of turn")
        self.transmitted[agent] = data
        return None

    def hear_report(self, agent: int, data: bytes) -> str | None:
        try:
            report = decode_report(data)
        except WireError as error:
            return self.reject(agent, str(error))
        return self.accept_report(agent, report, data)

    def accept_report(self, agent: int, report: Report, data: bytes) -> str | None:
        if report.agent != agent:
            return self.reject(agent, f"report.agent: {report.agent} on the key of agent {agent}")
        if report.step > self._step:
            return self.reject(agent, f"report.step: {report.step} has not begun, {self._step} has")
        self._report_numbers.follow(agent, report.sequence)
        if report.step <= self._newest_report.get(agent, -1) or self._ahead[agent] >= self._participants.unanswered(
            agent
        ):
            return self.reject_excess(agent, "report: a second one in one step, or one out of turn")
        self._newest_report[agent] = report.step
        self._ahead[agent] += 1
        self._reports.setdefault(agent, deque()).append(data)
        return None

    def hear_act(self, agent: int, data: bytes) -> str | None:
        try:
            act = decode_act(data)
        except WireError as error:
            return self.reject(agent, str(error))
        return self.accept_act(agent, act, data)

    def accept_act(self, agent: int, act: Act, data: bytes) -> str | None:
        if act.step > self._step:
            return self.reject(agent, f"act.step: {act.step} has not begun, {self._step} has")
        if self._participants.answer(agent, act.step):
            self._ahead[agent] = 0
            self.acts[agent] = (data, act)
            return None
        if self._participants.answer_late(agent, act.step):
            self._ahead[agent] = max(0, self._ahead[agent] - 1)
            self.late_acts[agent] += 1
            return None
        return self.reject_excess(agent, "act: a second one in one step, or one out of turn")

    def await_saved(self, agents: Iterable[int]) -> None:
        """Expect confirmations that these agents are saved."""
        self.unsaved = set(agents)
        self._saves_due.update(self.unsaved)

    def hear_saved(self, agent: int, data: bytes) -> str | None:
        try:
            step = decode_taken(data)
        except WireError as error:
            return self.reject(agent, str(error))
        if not self._saves_due[agent]:
            return self.reject_excess(agent, "taken: nothing was to be saved")
        self._saves_due[agent] -= 1
        if step == self._step:
            self.unsaved.discard(agent)
        return None

    def reject_excess(self, agent: int, reason: str) -> str:
        self.excess[agent] += 1
        return self.reject(agent, reason)

    def reject(self, agent: int, reason: str) -> str:
        self.rejected[agent] += 1
        return reason

    def drop_frames(self, late: Iterable[int]) -> None:
        for agent in late:
            self.transmitted.pop(agent, None)

    def drain_reports(self, last: bool) -> list[tuple[int, bytes]]:
        """Take each agent's oldest report, in agent order; its newer ones wait for the next steps, if there are any."""
        reports = []
        for agent, waiting in sorted(self._reports.items()):
            reports += [(agent, waiting.popleft()) for _ in range(len(waiting) if last else 1)]
        self._reports = {agent: waiting for agent, waiting in self._reports.items() if waiting}
        return reports

    def drain_counts(self) -> tuple[int, int]:
        """Return the numbers of dropped and lost samples since the last call."""
        rejected, lost = self.rejected.total(), self._radio_numbers.lost.total() + self._report_numbers.lost.total()
        counts = rejected - self._rejected_before, min(lost - self._lost_before, MAX_ID)
        self._rejected_before, self._lost_before = rejected, lost
        return counts

    @property
    def totals(self) -> dict[str, Any]:
        return {
            "rejected": by_agent(self.rejected),
            "excess": by_agent(self.excess),
            "late_acts": by_agent(self.late_acts),
            "transport_lost": by_agent(self._radio_numbers.lost + self._report_numbers.lost),
            "fell_back": by_agent(self._radio_numbers.fell_back + self._report_numbers.fell_back),
        }
