"""The samples of agents in a step, checked at the world's edge, since agents are untrusted.

Of each agent and step one radio frame, one report and one act are taken; what is beyond that is dropped and counted.
Of a radio frame the world reads the envelope, never the payload.
"""

from collections import Counter
from collections.abc import Iterable
from typing import Any

from deltaswarm_wire import keys
from deltaswarm_wire.codec import MAX_ID, WireError
from deltaswarm_wire.digest import RADIO, REPORT
from deltaswarm_wire.envelope import decode_sample
from deltaswarm_wire.messages import Act, decode_act
from deltaswarm_wire.operator_messages import Report, decode_report
from deltaswarm_wire.orders import decode_taken
from deltaswarm_wire.truth import Said
from deltaswarm_world.lockstep import LockStep
from deltaswarm_world.sequence import SequenceNumbers, by_agent


class Inbox:
    """The samples of one step, and the counts of a run."""

    def __init__(self, lockstep: LockStep) -> None:
        self.spoken: dict[int, bytes] = {}
        """Radio frames, by sender."""
        self.reports: dict[int, bytes] = {}
        self.acts: dict[int, tuple[bytes, Act]] = {}
        self.rejected: Counter[int] = Counter()
        """Dropped samples by the agent of their key."""
        self.excess: Counter[int] = Counter()
        """Those of them beyond one radio frame, one report and one act per step."""
        self.late_acts: Counter[int] = Counter()
        """Acts for steps that had continued without them, by agent."""
        self.unsaved: set[int] = set()
        """Agents that have not yet confirmed that they are saved."""
        self._saves_due: Counter[int] = Counter()
        """Number of confirmations still due from each agent."""
        self._lockstep = lockstep
        self._step = -1
        self._spoke_late: set[int] = set()
        self._radio_numbers, self._report_numbers = SequenceNumbers(), SequenceNumbers()
        self._rejected_before = self._lost_before = 0

    def begin(self, step: int) -> None:
        """Open a step; reports since the last step was closed belong to this one."""
        self._step = step
        self.spoken, self.acts = {}, {}
        self._spoke_late.clear()

    def begin_anew(self, agent: int) -> None:
        """Expect the numbers of a new process of this agent."""
        self._radio_numbers.begin_anew(agent)
        self._report_numbers.begin_anew(agent)

    def go_on_anywhere(self, agent: int) -> None:
        """Accept any next number from a board: its samples during an absence are not losses of the fabric."""
        self._radio_numbers.go_on_anywhere(agent)
        self._report_numbers.go_on_anywhere(agent)

    def hear(self, agent: int, leaf: str, data: bytes, act: bytes | None) -> str | None:
        """Take one sample on an agent's key and its attached act; return the reason if anything is dropped."""
        if leaf == keys.RADIO:
            reason = self.hear_radio(agent, data)
            return reason if act is None else self.hear_act(agent, act) or reason
        if leaf == keys.REPORT:
            return self.hear_report(agent, data)
        return self.hear_saved(agent, data) if leaf == keys.TAKEN else self.hear_act(agent, data)

    def hear_radio(self, agent: int, data: bytes) -> str | None:
        """Take one encoded radio frame; return the reason if it is dropped."""
        try:
            counter = decode_sample(data).counter
        except WireError as error:
            return self.reject(agent, str(error))
        return self.take_radio(agent, counter, data)

    def take_radio(self, agent: int, counter: int, data: bytes) -> str | None:
        """Take one decoded radio frame; return the reason if it is dropped."""
        self._radio_numbers.follow(agent, counter)
        if agent in self.spoken or agent in self._spoke_late or not self._lockstep.may_speak(agent):
            return self.reject_excess(agent, "radio: a second frame in one step, or one out of turn")
        if agent in self._lockstep.waiting:
            self.spoken[agent] = data
        else:  # as late as the act that follows
            self._spoke_late.add(agent)
        return None

    def hear_report(self, agent: int, data: bytes) -> str | None:
        """Take one encoded report; return the reason if it is dropped."""
        try:
            report = decode_report(data)
        except WireError as error:
            return self.reject(agent, str(error))
        return self.take_report(agent, report, data)

    def take_report(self, agent: int, report: Report, data: bytes) -> str | None:
        """Take one decoded report with its bytes; return the reason if it is dropped."""
        if report.agent != agent:
            return self.reject(agent, f"report.agent: {report.agent} on the key of agent {agent}")
        if report.step > self._step:
            return self.reject(agent, f"report.step: {report.step} has not begun, {self._step} has")
        self._report_numbers.follow(agent, report.sequence)
        if agent in self.reports or not self._lockstep.may_speak(agent):
            return self.reject_excess(agent, "report: a second one in one step, or one out of turn")
        self.reports[agent] = data
        return None

    def hear_act(self, agent: int, data: bytes) -> str | None:
        """Take one encoded act; return the reason if it is dropped."""
        try:
            act = decode_act(data)
        except WireError as error:
            return self.reject(agent, str(error))
        return self.take_act(agent, act, data)

    def take_act(self, agent: int, act: Act, data: bytes) -> str | None:
        """Take one decoded act with its bytes; return the reason if it is dropped."""
        if act.step > self._step:
            return self.reject(agent, f"act.step: {act.step} has not begun, {self._step} has")
        if self._lockstep.close(agent, act.step):
            self.acts[agent] = (data, act)
            return None
        if self._lockstep.answer_late(agent, act.step):
            self.late_acts[agent] += 1
            return None
        return self.reject_excess(agent, "act: a second one in one step, or one out of turn")

    def await_saved(self, agents: Iterable[int]) -> None:
        """Expect confirmations that these agents are saved."""
        self.unsaved = set(agents)
        self._saves_due.update(self.unsaved)

    def hear_saved(self, agent: int, data: bytes) -> str | None:
        """Take an agent's confirmation that it is saved; return the reason if it is dropped."""
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
        """Count a dropped sample beyond the limit per step; return the reason."""
        self.excess[agent] += 1
        return self.reject(agent, reason)

    def reject(self, agent: int, reason: str) -> str:
        """Count a dropped sample on a key of this agent; return the reason."""
        self.rejected[agent] += 1
        return reason

    def drop_frames(self, late: Iterable[int]) -> None:
        """Drop the radio frames of agents without an act in this step."""
        for agent in late:
            self.spoken.pop(agent, None)

    def take_reports(self) -> dict[int, bytes]:
        """Take the step's reports by agent; later ones belong to the next step."""
        reports, self.reports = self.reports, {}
        return reports

    def said(self, reports: dict[int, bytes]) -> list[Said]:
        """Return the step's radio frames and these reports, in agent order."""
        frames = [(agent, RADIO, data) for agent, data in self.spoken.items()]
        return sorted(frames + [(agent, REPORT, data) for agent, data in reports.items()])

    def take_counts(self) -> tuple[int, int]:
        """Return the numbers of dropped and lost samples since the last call."""
        rejected, lost = self.rejected.total(), (self._radio_numbers.lost + self._report_numbers.lost).total()
        counts = rejected - self._rejected_before, min(lost - self._lost_before, MAX_ID)
        self._rejected_before, self._lost_before = rejected, lost
        return counts

    @property
    def totals(self) -> dict[str, Any]:
        """Return the counts of the run, by agent."""
        return {
            "rejected": by_agent(self.rejected),
            "excess": by_agent(self.excess),
            "late_acts": by_agent(self.late_acts),
            "transport_lost": by_agent(self._radio_numbers.lost + self._report_numbers.lost),
            "fell_back": by_agent(self._radio_numbers.fell_back + self._report_numbers.fell_back),
        }
