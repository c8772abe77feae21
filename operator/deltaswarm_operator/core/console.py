"""The operator's console: picture, commands, pace and probes of one run, as a person or a script uses them.

Pure: arrivals in, turns and the station's datagrams out. `docs/STATION.md` describes the station's messages.
"""

import json
import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from random import Random
from typing import Any

from deltaswarm_operator.core.attention import Attention
from deltaswarm_operator.core.autonomy import Autonomy, autonomy_of
from deltaswarm_operator.core.budget import Budget, budget_of
from deltaswarm_operator.core.command_log import CommandLog, target_columns
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
from deltaswarm_scenario.operator_settings import DELTA, SET_DELTA, SET_STRUCTURE, Briefing
from deltaswarm_scenario.page_messages import Message, made
from deltaswarm_scenario.person_tables import PERSON, SCRIPT, SIMULATED, SYSTEM, OperatorAction
from deltaswarm_scenario.technique import Seen
from deltaswarm_wire.checked import plain
from deltaswarm_wire.commands import CommandForm, Pace, Target, Turn
from deltaswarm_wire.operator_messages import Clock, Report, Workload

LIVE, CONDUCTOR_KIND = "live", "conductor"
NUMBERS_SHOWN = 1000
SPEEDS = (1, 2, 5, 10, 20, 50, 0)
INBOX_SHOWN, INBOX_COUNTS, INBOX_CAUGHT_UP = 20, 100, 1000
HISTORY_ROWS = 600
SHEET_FIELDS = ("consent", "participant", "condition")
HELP_ASKED, HELP_SEEN, HELP_OVER = "asked", "seen", "over"
RESIDUE_S = 60.0
"""An item unread for longer than this is residue of an earlier load [simulated s]."""

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
        rng = Random(f"deltaswarm/{briefing.seed}/probes")
        drawn = Random(f"deltaswarm/{briefing.seed}/probes drawn")  # of its own: ISA's times stay
        self.probes = Probes(briefing.operator.probes, rng, drawn, briefing.duration_s)
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
        self._is_held_for_page = False
        self.has_conductor = False
        """Whether there is a conductor's page."""
        self.help = HELP_OVER
        """Whether the person has called for help, and whether the conductor has seen it."""
        self.is_ended = False
        """Whether the conductor has ended the run."""
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
        self.rule_drops = 0  # so many of the next commands of a simulated person or of the system are not given
        self.step = -1
        """The newest closed step."""
        self._is_over = False
        self.over_wall_s: float | None = None
        """When the last step was closed; None before."""
        self._workload: Workload | None = None
        self._messages = 0
        self._thresholds = [briefing.operator.threshold_hz, *briefing.operator.more_thresholds_hz]
        self._steps_above = [0 for _ in self._thresholds]
        self.history: deque[tuple[float, float, float]] = deque(maxlen=HISTORY_ROWS)

    def attend(self, *, has_station: bool = True) -> None:
        """Note whether there is a station, at which somebody may sit."""
        self.is_attended = self.probes.is_timed = has_station and self.person is None
        if self.is_attended and self.attention is None:
            self.attention = Attention(self.ledger, self.briefing.operator.person.patience_s)

    def start(self, wall_s: float) -> None:
        """Before the first step, open the session's sheet, which holds the run back until it is filled in."""
        self.probes.start(wall_s)
        self.beats.start(wall_s)
        if self.probes.holds_run:
            self.pace = self.pace._replace(hold_step=0)
        elif self.pace.hold_step < 0:
            self.pace = self.pace._replace(hold_step=self.next_hold_step)
            if not self.beats.is_there:
                self._hold_for_page(wall_s)

    def conclude(self) -> None:
        """Note that the run is over, if the console only asks what was not answered in it."""
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
        since_wall_s, is_watched = self.beats.seen_wall_s, math.isfinite(self.probes.heard_wall_s)
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

    def watch_page(self, wall_s: float) -> None:
        """Note if no page of the participant answers any more; until one does, no time to answer passes."""
        is_watched = self.is_attended and not self._is_over
        self.probes.heard_wall_s = self.beats.seen_wall_s if is_watched else math.inf
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
        """Whether the next step may not begin."""
        return 0 <= self.pace.hold_step <= self.step + 1

    def close_step(self, clock: Clock, workload: Workload, reports: Sequence[Report], wall_s: float) -> Turn:
        """Take in a closed step; return the operator's turn."""
        self.step, self._is_over, self._workload = clock.step, clock.last, workload
        self.command_log.close_step()
        for report in reports:
            self.command_log.hear(report)
        items = self.ledger.close_step(clock.time_s, self.picture.update(reports, clock.time_s))
        self._messages += workload.messages
        for index, threshold_hz in enumerate(self._thresholds):
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
        """Return the turn with the commands given so far."""
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
        """Carry out the simulated person's acts up to now."""
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
        """Order what the budget's rule wants, once there is room for an order."""
        if self.command_log.has_room and (structure := budget.order(self.picture.now_s, rate_hz)) is not None:
            self.command(SYSTEM, SET_STRUCTURE, Target(), structure._asdict())

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
        """Note an act."""
        self.actions.append(OperatorAction(self.picture.now_s, kind, by, **columns))

    def resume(self) -> None:
        """Go on, once loaded, where an operator was killed: questions of the run that were open are missing."""
        if self.probes.resume():  # nobody would let the run go on
            self.pace = self.pace._replace(hold_step=self.next_hold_step)

    # The station

    def is_refused(self, form: CommandForm) -> bool:
        """Whether no agent of this run carries out a command."""
        return self.briefing.mode in form.refused_in

    def hello(self, run: str, kind: str = LIVE, speeds: Sequence[float] = SPEEDS) -> Message:
        """Return the message that describes the run to the page."""
        briefing = self.briefing
        probes, page = briefing.operator.probes, briefing.operator.page
        return made(
            "hello",
            kind=kind,
            run=run,
            title=page.title or briefing.title,
            language=None if kind == CONDUCTOR_KIND else page.language.told,
            step_s=briefing.step_s,
            duration_s=briefing.duration_s,
            arena_m=[briefing.width_m, briefing.height_m],
            obstacles=[[list(corner) for corner in obstacle.corners_m] for obstacle in briefing.obstacles],
            base_m=briefing.base_m,
            range_m=briefing.range_m,
            radius_m=briefing.radius_m,
            agents=briefing.agents,
            thresholds_hz=self._thresholds,
            inbox=self.ledger.about,
            commands=[  # the page need not know the control mode
                {**plain(replace(form, refused_in=())), "refused": self.is_refused(form)} for form in briefing.offered
            ],
            sets_delta=briefing.operator.autonomy.sets_delta,
            event_numbers=list(self.picture.event_numbers.items())[-NUMBERS_SHOWN:] if kind == CONDUCTOR_KIND else (),
            goal=briefing.operator.task.goal if briefing.operator.task.is_on else "",
            speeds=speeds if not self.in_air and (page.pace or kind != LIVE) else (),
            layers=page.layers,
            panels=[panel for panel in page.panels if panel != "help" or self.has_conductor],
            place=page.place,
            asks=briefing.operator.asks_in_passing,
            end_text=page.end_text,
            session={"sheet": {name: getattr(probes, name) for name in SHEET_FIELDS} if probes.has_sheet else None}
            | ({name: getattr(probes, name) for name in SHEET_FIELDS[1:]} if kind == CONDUCTOR_KIND else {}),
        )

    def show(self, wall_s: float, **more: Any) -> Message:
        """Return the newest picture."""
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
