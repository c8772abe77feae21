"""The operator's console: picture, commands, pace and probes of one run, as a person or a script uses them.

Pure: arrivals in, turns and the station's datagrams out. `docs/STATION.md` describes the station's messages.
"""

import json
import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from deltaswarm_operator.core.autonomy import Autonomy, autonomy_of
from deltaswarm_operator.core.budget import Budget, budget_of
from deltaswarm_operator.core.command_log import CommandLog, target_columns
from deltaswarm_operator.core.measures import Attention
from deltaswarm_operator.core.page_beats import QUIET_AFTER_S, PageBeats
from deltaswarm_operator.core.picture import Picture
from deltaswarm_operator.core.probes import Probes
from deltaswarm_operator.core.recent_acts import RecentActs
from deltaswarm_operator.core.script import Script, Scripted
from deltaswarm_operator.core.simulated_operator import Read, SimulatedOperator, person_of
from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.ledger import Ledger
from deltaswarm_operator.inbox.policy import RANKED
from deltaswarm_scenario.isa import ISA
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_scenario.operator_settings import DELTA, SET_DELTA, Briefing
from deltaswarm_scenario.page_messages import Message, made
from deltaswarm_scenario.person_tables import PERSON, SCRIPT, SIMULATED, SYSTEM, OperatorAction
from deltaswarm_scenario.technique import Seen
from deltaswarm_wire.commands import Pace, Target, Turn
from deltaswarm_wire.operator_messages import Clock, Report, Workload

INBOX_SHOWN, INBOX_COUNTS, INBOX_CAUGHT_UP = 20, 100, 1000
HISTORY_ROWS = 600
HELP_ASKED, HELP_SEEN, HELP_OVER = "asked", "seen", "over"
RESIDUE_S = 60.0
"""An item unread for longer than this is residue of an earlier load [simulated s]."""

GRACE_S = 1.0
"""For how long an input is awaited that was made in time, besides the time that its link takes [wall s]."""

INPUTS_KEPT = 2000
"""Inputs whose answers are kept, in case a page sends them again; it waits with far fewer."""


class Console:
    """One operator's console.

    Args:
        briefing: what the operator knows in advance.
        command_log: numbers and signs commands; default: numbers from 0, unsigned.
        in_air: whether in open air, where time has no pace and a command leaves the base at once.

    `wall_s` is any monotonic clock, such as `time.monotonic`.
    """

    def __init__(self, briefing: Briefing, command_log: CommandLog | None = None, *, in_air: bool = False) -> None:
        self.picture = Picture(briefing.step_s, briefing.operator.inbox)
        self.ledger = Ledger(briefing.operator.inbox, briefing.operator.person.patience_s)
        self.command_log = command_log or CommandLog(briefing.forms)
        self.probes = Probes.of(briefing)
        self.probes.is_timed = False
        self.person = person_of(briefing, is_ranked=self.ledger.order == RANKED)
        self.autonomy = autonomy_of(briefing)
        self.budget = budget_of(briefing)
        """The rule by which the system keeps a message budget; None: it does not."""
        self.attention: Attention | None = None
        """What the person at the station reads and misses; None without a station."""
        self.is_attended = False
        """Whether there is a station now."""
        self.beats = PageBeats()
        self.is_page_done = False
        """Whether the page has shown the end of the run, and has sent all that was made in it."""
        self._is_held_for_page = False
        self.has_conductor = False
        self.help = HELP_OVER
        """Whether the person has called for help, and whether the conductor has seen it."""
        self.is_ended = False
        self.inputs: dict[str, list[Message]] = {}
        """The answers to the newest inputs by their ids: one that is sent again counts once."""
        self.pace = Pace(briefing.speed, -1)
        self.actions: deque[OperatorAction] = deque()
        """Acts not yet written down."""
        self.recent_acts = RecentActs()
        self.judgements: dict[int, str] = {}
        """The class that the person judged an event to be of, by the page's numbers."""
        self.briefing = briefing
        self.in_air = in_air
        self._first_step = 1 if in_air else FIRST_STEP
        self.script = Script(map(Scripted, briefing.command), briefing.step_s)
        self.rule_drops = 0  # number of next commands of a simulated person or of the system that are left out
        self.step = -1
        """The newest closed step."""
        self._is_over = False
        self.over_wall_s: float | None = None
        """When the last step was closed; None before."""
        self._workload: Workload | None = None
        self._messages = 0
        self.thresholds_hz = [briefing.operator.threshold_hz, *briefing.operator.more_thresholds_hz]
        self._steps_above = [0 for _ in self.thresholds_hz]
        self.history: deque[tuple[float, float, float]] = deque(maxlen=HISTORY_ROWS)

    def attend(self, *, has_station: bool = True, has_conductor: bool = False) -> None:
        self.is_attended = self.probes.is_timed = has_station and self.person is None
        self.has_conductor = has_conductor
        if self.is_attended and self.attention is None:
            self.attention = Attention(self.ledger, self.briefing.operator.person.patience_s)

    def lose_station(self) -> None:
        """Continue without a station: nobody could resume a run that is held."""
        self.is_attended = False
        if self.pace.hold_step >= 0:
            self.pace = self.pace._replace(hold_step=-1)

    def go_on_with(self, briefing: Briefing, script: Script, rule_drops: int) -> None:
        """Take other settings and another script between two steps (`reconfigure`)."""
        before, now = self.briefing.operator, briefing.operator
        self.briefing, self.command_log.forms = briefing, briefing.forms
        self.script, self.rule_drops = script, rule_drops
        inbox = now.inbox if now.inbox != before.inbox else None
        if inbox is not None:
            self.picture.go_on_with(inbox)
        self.ledger.go_on_with(inbox, now.person.patience_s)

    def set_rules(self, person: SimulatedOperator | None, autonomy: Autonomy | None, budget: Budget | None) -> None:
        self.person, self.autonomy, self.budget = person, autonomy, budget

    def start(self, wall_s: float) -> None:
        """Before the first step, open the session's sheet, which holds the run back until it is filled in."""
        self.probes.start(wall_s, is_simulated=self.person is not None)
        self.beats.start(wall_s)
        if self.probes.holds_run:
            self.pace = self.pace._replace(hold_step=0)
        elif self.pace.hold_step < 0:
            self.pace = self.pace._replace(hold_step=self.next_hold_step)
            if not self.beats.is_there:
                self._hold_for_page(wall_s)

    def conclude(self) -> None:
        """Note that the run is over: the console only asks its unanswered questions."""
        self.picture.now_s, self._is_over = self.briefing.duration_s, True

    @property
    def next_hold_step(self) -> int:
        """The step before which the run is held next for questions about the situation; -1: none."""
        due_s = self.probes.next_hold_s if self.is_attended else None
        return -1 if due_s is None else max(self.step, math.ceil(due_s / self.briefing.step_s - 1e-9)) + 1

    def go_on(self, wall_s: float) -> None:
        """Let the run go on, unless another question holds it."""
        if not self.probes.holds_run and self.is_held:
            self.set_pace(self.pace._replace(hold_step=self.next_hold_step), wall_s)

    def beat(self, wall_s: float) -> None:
        """Note that a page of the participant answers; a run that was held for it goes on."""
        since_wall_s, is_watched = self.beats.heard_wall_s, math.isfinite(self.probes.heard_wall_s)
        away_s = self.beats.beat(wall_s)
        if is_watched:
            self.probes.heard_wall_s = wall_s
            if away_s is None and wall_s - since_wall_s > QUIET_AFTER_S and not self.is_held:
                self.probes.hold(since_wall_s, is_held=True)  # an answer may be on the way
                self.probes.hold(wall_s, is_held=False)
        if away_s is not None:
            self.note(PERSON, "page", name="back", text=f"after {away_s:.1f} s", monotonic_s=wall_s)
            self.probes.hold(wall_s, is_held=self.is_held)
        if self._is_held_for_page:
            self.go_on(wall_s)

    def know_link(self, rtt_s: float, *, is_done: bool) -> None:
        """Note how slow the page's link is, and whether nothing can come over it any more that belongs to the run."""
        self.beats.rtt_s = rtt_s
        self.probes.grace_s = GRACE_S + 2 * rtt_s
        self.is_page_done = is_done and self._is_over

    def awaits_page(self, wall_s: float) -> bool:
        """Whether the run is over and inputs that were made in it may be on the way."""
        is_there = self.is_attended and self.beats.is_there and not self.beats.is_silent(wall_s)
        return is_there and self.probes.grace_s > 0 and not self.is_page_done

    def watch_page(self, wall_s: float) -> None:
        """Note if no page of the participant answers any more; until one does, no time to answer passes."""
        is_watched = self.is_attended and not self._is_over
        self.probes.heard_wall_s = self.beats.heard_wall_s if is_watched else math.inf
        if not is_watched or (since_wall_s := self.beats.check(wall_s)) is None:
            return
        self.note(PERSON, "page", name="away", text=f"for {wall_s - since_wall_s:.1f} s", monotonic_s=wall_s)
        self.probes.hold(wall_s if self.is_held else since_wall_s, is_held=True)
        if not self.is_held:
            self._hold_for_page(wall_s)

    def _hold_for_page(self, wall_s: float) -> None:
        """Hold the run until a page of the participant answers, if the scenario wants that."""
        if self.is_attended and not self.in_air and self.briefing.operator.page.hold_while_away:
            self.set_pace(self.pace._replace(hold_step=self.step + 1), wall_s)
            self._is_held_for_page = True

    @property
    def is_held(self) -> bool:
        return 0 <= self.pace.hold_step <= self.step + 1

    def close_step(self, clock: Clock, workload: Workload, reports: Sequence[Report], wall_s: float) -> Turn:
        self.step, self._is_over, self._workload = clock.step, clock.last, workload
        self.command_log.close_step()
        for report in reports:
            self.command_log.hear(report)
        items = self.ledger.close_step(clock.time_s, self.picture.update(reports, clock.time_s))
        self._messages += workload.messages
        for index, threshold_hz in enumerate(self.thresholds_hz):
            self._steps_above[index] += workload.rate_60s_hz > threshold_hz
        self.history.append((clock.time_s, round(workload.rate_1s_hz, 3), round(workload.rate_60s_hz, 3)))
        self.over_wall_s = wall_s if clock.last else None
        self.beats.close_step(wall_s)
        self.probes.tick(
            clock.time_s,
            clock.last,
            wall_s,
            is_attended=self.is_attended,
            is_held=self.is_held,
            is_away=self.beats.is_away,
            see=self.see,
        )
        if self.attention is not None:
            self.attention.close_step(clock.time_s)
        self._follow_script(clock.step + self._first_step)
        if self.person is not None:
            self._act_as(self.person, items, workload.rate_60s_hz, wall_s)
        if self.autonomy is not None:
            self._act_as_system(self.autonomy, workload.rate_60s_hz)
        if self.budget is not None:
            self._keep_budget(self.budget, workload.rate_60s_hz)
        return self.turn()

    def see(self) -> Seen:
        """Return what the page shows of the swarm."""
        return self.picture.seen(self.briefing.width_m, self.briefing.height_m)

    def turn(self) -> Turn:
        return Turn(self.step, self.command_log.take_unsent())

    def _follow_script(self, step: int) -> None:
        """Give the script's commands for this step; those that are too early leave in the first possible step."""
        while (scripted := self.script.due(step)) and self.command_log.has_room:
            self.script.take()
            if scripted.is_dropped:
                self.command_log.skip()
                continue
            given = scripted.command
            self.command(SCRIPT, given.name, Target(given.target, given.numbers), given.arguments, given.life_s)

    def _act_as(self, person: SimulatedOperator, items: Sequence[Item], rate_hz: float, wall_s: float) -> None:
        for act in person.live(self.picture.now_s, items, rate_hz):
            if isinstance(act, Read):
                read = self.ledger.read(act.numbers, self.picture.now_s)
                self.note(SIMULATED, "read", items=" ".join(map(str, read)))
            elif self.command_log.has_room:
                self.command(SIMULATED, SET_DELTA, Target(), {DELTA: act.delta})
        if (answered := self.probes.answer_as(person.load, wall_s)) is not None:
            kind, columns = answered
            self.note(SIMULATED, kind, **columns)

    def _act_as_system(self, autonomy: Autonomy, rate_hz: float) -> None:
        """Propose and carry out what the rule wants, once there is room for an order."""
        if not self.command_log.has_room:
            return
        before = autonomy.proposal
        answers = [given[ISA] for given in self.probes.given(ISA)]
        delta = autonomy.close_step(self.picture.now_s, rate_hz, answers)
        if autonomy.proposal is not None and autonomy.proposal != before:
            self.note(SYSTEM, "proposal", value=autonomy.proposal.delta)
        if delta is not None:
            self.command(SYSTEM, SET_DELTA, Target(), {DELTA: delta})

    def _keep_budget(self, budget: Budget, rate_hz: float) -> None:
        if self.command_log.has_room and (order := budget.order(self.picture.now_s, rate_hz)) is not None:
            self.command(SYSTEM, budget.command, Target(), order._asdict())

    @property
    def totals(self) -> dict[str, Any]:
        """The metrics of the person and of the system that sets delta, for JSON; empty without both."""
        vetoes = self.autonomy.vetoes if self.autonomy else 0
        by_system = self.command_log.changes_by(SYSTEM)
        changes = {"autonomy": {"changes": by_system, "vetoes": vetoes}} if self.autonomy or self.budget else {}
        return changes | self._person_totals

    @property
    def _person_totals(self) -> dict[str, Any]:
        asked = self.probes.outcomes
        if self.person is not None:
            person = self.person.totals(asked[ISA])
        elif self.attention is not None:
            given = sum(sent.by != SYSTEM for sent in self.command_log.sent)
            person = self.attention.totals(given, asked[ISA]) | {"page_away_s": self.beats.away_s}
        else:
            return {}
        person |= self.command_log.outcomes(self.picture.now_s) | asked
        inbox = self.ledger.totals(self.picture.now_s)
        return {"person": person, "inbox": inbox, **self.ledger.by_event(self.picture.event_numbers)}

    def command(
        self, by: str, name: str, target: Target, arguments: Mapping[str, Any], *life_s: float, **at: Any
    ) -> int:
        """Give a command; return its place among all, -1 if dropped. `at`: columns of the act. Raises ValueError."""
        if self.rule_drops and by in (SIMULATED, SYSTEM):
            self.rule_drops -= 1
            self.command_log.skip()
            return -1
        command = self.command_log.issue(name, target, arguments, self.picture.now_s, *life_s, by=by)
        numbers = [value for value in command.arguments.values() if not isinstance(value, str)]
        self.note(
            by,
            "command",
            name=name,
            command=command.number,
            life_s=command.life_s,
            arguments=json.dumps(command.arguments),
            value=next(iter(numbers), None),
            **target_columns(target),
            **at,
        )
        return len(self.command_log.sent) - 1

    def set_pace(self, pace: Pace, wall_s: float) -> None:
        """Change the pace; time in which the run is held does not count against a question."""
        self.pace, self._is_held_for_page = pace, False
        self.probes.hold(wall_s, is_held=self.is_held or self.beats.is_away)

    def note(self, by: str, kind: str, **columns: Any) -> None:
        self.actions.append(OperatorAction(self.picture.now_s, kind, by, **columns))

    def take_actions(self) -> list[OperatorAction]:
        """Return the acts that are not yet written down."""
        actions = list(self.actions)
        self.actions.clear()
        return actions

    def judge(self, event: int, answer: str) -> None:
        self.judgements[event] = answer

    def set_help(self, state: str) -> None:
        self.help = state

    def end(self) -> None:
        self.is_ended = True

    def remember(self, code: str, answers: list[Message]) -> None:
        """Keep the answers to an input, in case a page sends it again."""
        self.inputs[code] = answers
        if len(self.inputs) > INPUTS_KEPT:
            del self.inputs[next(iter(self.inputs))]

    def resume(self) -> None:
        """Continue for a killed operator, once loaded; open questions of the run count as missing."""
        if self.probes.resume():  # nobody would let the run go on
            self.pace = self.pace._replace(hold_step=self.next_hold_step)

    # The station

    def show(self, wall_s: float, **more: Any) -> Message:
        picture, ledger, workload = self.picture, self.ledger, self._workload
        if self.attention is not None:
            self.attention.show(wall_s)
        fields = dict(
            step=self.step,
            time_s=round(picture.now_s, 3),
            over=self._is_over,
            **picture.rows(),
            inbox=ledger.new_rows(INBOX_SHOWN, INBOX_CAUGHT_UP),
            counts=ledger.counts(INBOX_COUNTS),
            held=list(ledger.held),
            judged=[[event, self.judgements[event]] for event in picture.events if event in self.judgements],
            unread=ledger.unread,
            closed={"events": len(picture.closed), "after_s": round(picture.closed_after_s or 0.0, 1)},
            workload={
                "messages": self._messages,
                "rate_1s_hz": round(workload.rate_1s_hz, 3) if workload else 0.0,
                "rate_60s_hz": round(workload.rate_60s_hz, 3) if workload else 0.0,
                "senders": workload.senders if workload else 0,
                "residue": ledger.waiting(picture.now_s - RESIDUE_S),
                "above_s": [steps * self.briefing.step_s for steps in self._steps_above],
            },
            commands=self.command_log.rows(picture.now_s),
            pace={"paused": self.is_held, "speed": self.pace.speed},
            probe=self.probes.open(wall_s),
            proposal=self._proposal,
            help=self.help,
        )
        return made("picture", **{**fields, **more})

    @property
    def _proposal(self) -> dict[str, Any] | None:
        """The change of delta that the person may veto, in the page's format."""
        proposal = self.autonomy and self.autonomy.proposal
        if not proposal:
            return None
        return {"delta": proposal.delta, "left_s": round(max(0.0, proposal.due_s - self.picture.now_s), 1)}
