"""The operator's side of open air: live agents, their reports and rates, without a world's clock.

Pure: tokens, reports and times [s since the operator's start] in, one `Workload` per step of its own out.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire.codec import WireError, number, unpack
from deltaswarm_wire.operator_messages import Clock, Report, Workload, decode_health, decode_report

MAX_SENT_S = 1e11
"""Largest sending time [Unix s], well beyond this millennium."""


INSISTS = 5
"""After this many old reports in order, and none newer for `RESTART_S`, they count as new: the agent restarted with
its clock set back."""

MAX_AGENTS = 4096
"""Maximum number of known agents: without admission control one sender could use every number."""

MAX_STEP_BYTES = 2_000_000
"""Limit on an agent's reports per step: 100 per second for a minute, of 300 bytes each."""

CROWDED = f"agents must be at most {MAX_AGENTS} (got one more)"

RECENT = 64
"""Number of recent reports of an agent, kept to recognize copies."""

RESTART_S = 1.5
"""Shortest restart of a board: systemd waits for 2 s."""

RETURNS = 8
"""After this many returns to an earlier sequence without a restart, several processes run at the same time."""

ALONE = 100
"""After this many reports in order there is only one process again."""

MAX_PROCESSES = 32
"""Maximum number of processes; the least recent are forgotten."""


@dataclass
class TrackedProcess:
    """One process: its newest number, and the number of reports that seem lost before it."""

    newest: int
    lost: int = 0


class ProcessTracker:
    """Tells from one agent's sequence numbers whether its process restarts or several processes run at the same time.

    A process counts up by ones and takes a while to restart. If numbers repeatedly fall back at once to an earlier
    sequence, a second process has the same agent's number.
    """

    def __init__(self) -> None:
        self.lost = 0
        """Missing reports of all processes."""
        self.restarts = 0
        self.is_doubled = False
        self.was_doubled = False
        self._processes: list[TrackedProcess] = []
        """In order of their latest report."""
        self._heard_s = -math.inf
        self._returns = 0
        self._in_order = 0

    def hear(self, sequence: int, now_s: float) -> None:
        """Take a report that is no copy.

        A number one above a process's newest continues that process, so nothing counts as lost while two processes
        alternate. A larger number means lost reports or another process: it continues the latest process until that
        one continues itself.
        """
        processes = self._processes
        went_back = bool(processes) and sequence <= processes[-1].newest
        is_soon = now_s - self._heard_s < RESTART_S
        below = [process for process in processes if process.newest < sequence]
        before = next((process for process in reversed(below) if process.newest == sequence - 1), None)
        if before is not None:
            self.lost -= before.lost
            processes.remove(before)
        elif below and (is_soon or not went_back):
            before = max(below, key=lambda process: process.newest) if self._returns or went_back else processes[-1]
            self.lost += sequence - before.newest - 1 - before.lost
            before.lost = sequence - before.newest - 1
        elif processes:
            self.restarts += 1
            self._returns = 0
        processes.append(TrackedProcess(sequence))
        del processes[:-MAX_PROCESSES]
        self._heard_s = now_s
        self._returns += went_back and is_soon and before is not None
        self._in_order = 0 if went_back else self._in_order + 1
        if self._in_order >= ALONE:
            self._returns, self.is_doubled = 0, False
        elif self._returns >= RETURNS:
            self.is_doubled = self.was_doubled = True


@dataclass
class Known:
    """One agent: its token, absences, reports, and the fault of its body.

    `reports` counts accepted reports; `stale` counts duplicates and reports older than the newest, the last `stale_run`
    of them in order up to the sequence number `newest_stale`. `step_bytes` arrived since step `step` was closed.
    `recent` has the newest reports with their sending times, `processes` the processes that sent them.
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
    processes: ProcessTracker = field(default_factory=ProcessTracker)

    def follow(self, report: Report, sent_s: float | None, now_s: float) -> int:
        """Assign a report, old or not, to one of the agent's processes; return the change in lost reports.

        Copies are ignored.
        """
        if (report, sent_s) in self.recent:
            return 0
        self.recent.append((report, sent_s))
        lost = self.processes.lost
        self.processes.hear(report.sequence, now_s)
        return self.processes.lost - lost

    def is_old(self, sequence: int, sent_s: float | None, now_s: float) -> bool:
        """Whether a report whose sequence number did not grow is old."""
        assert self.newest is not None
        assert self.last_heard_s is not None
        began_anew = sequence < self.newest.sequence if sent_s is None else sent_s > self.newest_sent_s
        if began_anew:
            return False
        self.stale_run = self.stale_run + 1 if sequence > self.newest_stale else 1
        self.newest_stale = sequence
        return self.stale_run < INSISTS or now_s - self.last_heard_s < RESTART_S

    def update(self, report: Report, sent_s: float | None, now_s: float) -> None:
        self.newest, self.last_heard_s = report, now_s
        self.newest_sent_s = -math.inf if sent_s is None else sent_s
        self.reports += 1
        self.stale_run, self.newest_stale = 0, -1


class OpenAirMeter:
    """Counts reports in steps of the operator's clock; the step in a report is by its board's clock."""

    def __init__(self, settings: OperatorSettings, step_s: float) -> None:
        self.agents: dict[int, Known] = {}
        self._meter = WorkloadMeter(settings, step_s)
        self._step_s = step_s

    @property
    def alive(self) -> list[int]:
        """Agents with a liveliness token, ascending."""
        return sorted(agent for agent, known in self.agents.items() if known.is_alive)

    def came(self, agent: int) -> None:
        if self._is_welcome(agent):
            self._known(agent).is_alive = True

    def went(self, agent: int) -> None:
        if not self._is_welcome(agent):
            return
        known = self._known(agent)
        known.absences += known.is_alive
        known.is_alive = False
        known.fault = ""  # no longer known

    @property
    def faulty(self) -> dict[int, str]:
        return {agent: known.fault for agent, known in sorted(self.agents.items()) if known.fault}

    @property
    def doubled(self) -> list[int]:
        return sorted(agent for agent, known in self.agents.items() if known.processes.is_doubled)

    def is_doubled(self, agent: int | None) -> bool:
        known = None if agent is None else self.agents.get(agent)
        return known is not None and known.processes.is_doubled

    def fault_of(self, agent: int | None) -> str:
        """Return the fault of an agent's body; "" if none or unknown."""
        known = None if agent is None else self.agents.get(agent)
        return known.fault if known else ""

    def on_health(self, agent: int | None, data: bytes) -> str | None:
        """Take a health message from an agent's key (None: no agent's key); return the reason if it is dropped.

        Health is not part of the workload.
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
        """Take one report from an agent's key (None: no agent's key); return the reason if it is dropped.

        `sent` is the board's wall clock, if attached. If the sequence number did not grow, a later `sent` means that
        the agent restarted; otherwise the report is old. A board without a battery clock may restart in the past; it
        is accepted after `INSISTS` reports, but a recording is not, while the board itself reports.
        """
        try:
            report = decode_report(data)
            sent_s = None if sent is None else number(unpack(sent, 16), 0.0, MAX_SENT_S, "sent_s")
        except WireError as error:
            return self._meter.reject(-1 if agent is None else agent, str(error))
        if report.agent != agent:
            where = "no agent's key" if agent is None else f"the key of agent {agent}"
            return self._meter.reject(
                -1 if agent is None else agent, f"report.agent must match its key (got {report.agent} on {where})"
            )
        if not self._is_welcome(agent):
            return self._meter.reject(-1, CROWDED)
        known = self._known(agent)
        if known.step != self._meter.step:
            known.step, known.step_bytes = self._meter.step, 0
        known.step_bytes += len(data)
        if known.step_bytes > MAX_STEP_BYTES:
            return self._meter.reject(agent, f"reports must be at most {MAX_STEP_BYTES} bytes per step")
        self._meter.lose(agent, known.follow(report, sent_s, now_s))
        if (
            known.newest is not None
            and report.sequence <= known.newest.sequence
            and known.is_old(report.sequence, sent_s, now_s)
        ):
            known.stale += 1
            return f"report.sequence must grow from {known.newest.sequence} (got {report.sequence})"
        known.update(report, sent_s, now_s)
        self._meter.count(report, data)
        return None

    def wait_s(self, now_s: float) -> float:
        """Return the time until the next step ends [s]; 0 if it has ended."""
        return max(0.0, (self._meter.step + 2) * self._step_s - now_s)

    def close_second(self, now_s: float, backlog: int) -> Workload | None:
        """Close the newest ended step and all before it; return None if there is none."""
        step = math.floor(now_s / self._step_s + 1e-9) - 1
        if step <= self._meter.step:
            return None
        return self._meter.close_step(Clock(step, step * self._step_s, False), backlog)

    @property
    def totals(self) -> dict[str, Any]:
        agents = {
            str(agent): {
                "alive": known.is_alive,
                "fault": known.fault,
                "last_fault": known.last_fault,
                "absences": known.absences,
                "restarts": known.processes.restarts,
                "doubled": known.processes.was_doubled,
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
