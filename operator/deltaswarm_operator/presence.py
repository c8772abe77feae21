"""The operator's side of open air: who is alive, what they report, at which rate. No world tells it the step.

Pure: tokens, reports and times in [s since the operator's start], one `Workload` per step of its own out.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from deltaswarm_operator.lives import Lives
from deltaswarm_operator.workload import WorkloadMeter
from deltaswarm_wire.codec import WireError, number, unpack
from deltaswarm_wire.operator_messages import Clock, Report, Workload, decode_health, decode_report
from deltaswarm_wire.settings_operator import OperatorSettings

MAX_SENT_S = 1e11
"""Unix time; well beyond this millennium."""


INSISTS = 5
"""So many old reports in a row, in order, and they are not old: the agent began anew with its clock set back."""

MAX_AGENTS = 4096
"""So many are known: where anybody may come in, one stranger can give as many numbers as there are."""

MAX_STEP_BYTES = 2_000_000
"""Reports of one agent that are kept until a step is closed: 100 per second for a minute, of 300 bytes each."""

CROWDED = f"of an agent that is one more than {MAX_AGENTS}"

RECENT = 64
"""So many reports of an agent are kept, to know a copy by."""


@dataclass
class Known:
    """One agent: whether its token is there, how often it went, what came from it and when, what ails its body.

    `reports` counts what was taken, `stale` duplicates and what came after a newer one, of which `stale_run` came
    last, in order, up to the sequence number `newest_stale`. `step_bytes` came since step `step` was closed. `recent`
    are the newest that came, each with when it was sent, and `lives` the processes that they are from.
    """

    is_alive: bool = False
    absences: int = 0
    fault: str = ""
    last_fault: str = ""
    reports: int = 0
    stale: int = 0
    last_heard_s: float | None = None
    newest: Report | None = None
    newest_sent_s: float = -math.inf
    stale_run: int = 0
    newest_stale: int = -1
    step: int = -1
    step_bytes: int = 0
    recent: deque[tuple[Report, float | None]] = field(default_factory=lambda: deque(maxlen=RECENT))
    lives: Lives = field(default_factory=Lives)

    def follow(self, report: Report, sent_s: float | None, now_s: float) -> int:
        """Take a report, old or not, as one of the processes behind the agent; how many more are lost than before it.

        A copy is nobody's.
        """
        if (report, sent_s) in self.recent:
            return 0
        self.recent.append((report, sent_s))
        lost = self.lives.lost
        self.lives.hear(report.sequence, now_s)
        return self.lives.lost - lost

    def is_old(self, sequence: int, sent_s: float | None) -> bool:
        """Whether a report with a sequence number that did not grow is an old one."""
        assert self.newest is not None
        began_anew = sequence < self.newest.sequence if sent_s is None else sent_s > self.newest_sent_s
        if began_anew:
            return False
        self.stale_run = self.stale_run + 1 if sequence > self.newest_stale else 1
        self.newest_stale = sequence
        return self.stale_run < INSISTS

    def take(self, report: Report, sent_s: float | None, now_s: float) -> None:
        """A report is the newest now."""
        self.newest, self.last_heard_s = report, now_s
        self.newest_sent_s = -math.inf if sent_s is None else sent_s
        self.reports += 1
        self.stale_run, self.newest_stale = 0, -1


class OpenAirMeter:
    """Counts reports in steps of the operator's own clock; a report's own step and clock are its board's."""

    def __init__(self, settings: OperatorSettings, step_s: float) -> None:
        self.agents: dict[int, Known] = {}
        """Whoever was there or reported, by number."""
        self._meter = WorkloadMeter(settings, step_s)
        self._step_s = step_s

    @property
    def alive(self) -> list[int]:
        """Agents whose liveliness token is there, ascending."""
        return sorted(agent for agent, known in self.agents.items() if known.is_alive)

    def came(self, agent: int) -> None:
        """An agent's token is there."""
        if self._is_welcome(agent):
            self._known(agent).is_alive = True

    def went(self, agent: int) -> None:
        """An agent's token went."""
        if not self._is_welcome(agent):
            return
        known = self._known(agent)
        known.absences += known.is_alive
        known.is_alive = False
        known.fault = ""  # which is not known any more

    @property
    def ill(self) -> dict[int, str]:
        """What is wrong with the bodies of agents, by number, ascending."""
        return {agent: known.fault for agent, known in sorted(self.agents.items()) if known.fault}

    @property
    def doubled(self) -> list[int]:
        """Agents as whom two processes report, ascending."""
        return sorted(agent for agent, known in self.agents.items() if known.lives.is_doubled)

    def is_doubled(self, agent: int | None) -> bool:
        """Whether two processes report as this agent; not where nothing came from it."""
        known = None if agent is None else self.agents.get(agent)
        return known is not None and known.lives.is_doubled

    def fault_of(self, agent: int | None) -> str:
        """What is wrong with its body; nothing where that is not known."""
        known = None if agent is None else self.agents.get(agent)
        return known.fault if known else ""

    def feels(self, agent: int | None, data: bytes) -> str | None:
        """Take in how an agent's body is, from its key (None: no agent's key); the reason if it is dropped.

        It is not the swarm's report on its area, and so no part of the workload.
        """
        try:
            health = decode_health(data)
        except WireError as error:
            return self._meter.reject(-1 if agent is None else agent, str(error))
        if agent is None:
            return self._meter.reject(-1, "health on no agent's key")
        if not self._is_welcome(agent):
            return self._meter.reject(-1, CROWDED)
        known = self._known(agent)
        known.fault = health.fault
        known.last_fault = health.fault or known.last_fault
        return None

    def hear(self, agent: int | None, data: bytes, sent: bytes | None, now_s: float) -> str | None:
        """Take in one report, from the key of an agent (None: no agent's key); the reason if it is dropped.

        `sent` is the board's own calendar time beside it, if any. A sequence number that does not grow is an agent that
        began anew, if it was sent later than the newest, and else an old report that comes once more; a board without
        a clock of its own may begin anew in the past, and is believed when it goes on.
        """
        try:
            report = decode_report(data)
            sent_s = None if sent is None else number(unpack(sent, 16), 0.0, MAX_SENT_S, "sent_s")
        except WireError as error:
            return self._meter.reject(-1 if agent is None else agent, str(error))
        if report.agent != agent:
            where = "no agent's key" if agent is None else f"the key of agent {agent}"
            return self._meter.reject(-1 if agent is None else agent, f"report.agent: {report.agent} on {where}")
        if not self._is_welcome(agent):
            return self._meter.reject(-1, CROWDED)
        known = self._known(agent)
        if known.step != self._meter.step:
            known.step, known.step_bytes = self._meter.step, 0
        known.step_bytes += len(data)
        if known.step_bytes > MAX_STEP_BYTES:
            return self._meter.reject(agent, f"more than {MAX_STEP_BYTES} bytes of reports in a step")
        self._meter.lose(agent, known.follow(report, sent_s, now_s))
        if (
            known.newest is not None
            and report.sequence <= known.newest.sequence
            and known.is_old(report.sequence, sent_s)
        ):
            known.stale += 1
            return f"report.sequence: {report.sequence} again, or late; {known.newest.sequence} is the newest"
        known.take(report, sent_s, now_s)
        self._meter.take_now(report, data)
        return None

    def wait_s(self, now_s: float) -> float:
        """Until the next step ends; 0 if it has ended."""
        return max(0.0, (self._meter.step + 2) * self._step_s - now_s)

    def close(self, now_s: float, backlog: int) -> Workload | None:
        """Close the newest step that has ended, and with it those before; None if there is none."""
        step = math.floor(now_s / self._step_s + 1e-9) - 1
        if step <= self._meter.step:
            return None
        return self._meter.close(Clock(step, step * self._step_s, False), backlog)

    @property
    def totals(self) -> dict[str, Any]:
        """The figures so far, as JSON has them; `agents` says who was there."""
        agents = {
            str(agent): {
                "alive": known.is_alive,
                "fault": known.fault,
                "last_fault": known.last_fault,
                "absences": known.absences,
                "restarts": known.lives.restarts,
                "doubled": known.lives.was_doubled,
                "last_heard_s": known.last_heard_s,
                "reports": known.reports,
                "stale": known.stale,
            }
            for agent, known in sorted(self.agents.items())
        }
        return {**self._meter.totals, "agents": agents}

    def _is_welcome(self, agent: int) -> bool:
        return agent in self.agents or len(self.agents) < MAX_AGENTS

    def _known(self, agent: int) -> Known:
        return self.agents.setdefault(agent, Known())
