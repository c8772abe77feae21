"""Ask the person at the station the questions of a run: when they are due, which is open, how long, what was answered.

The techniques define what is asked (`deltaswarm_scenario.techniques`). One question is open at a time. A question that
does not hold the run is not asked beside another: it is asked late, or not at all once half the time to the next one of
its kind has passed. It is missing if its answer does not come in time. Each planned question has its rows.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Any

from deltaswarm_operator.core.asked_question import Asked, Ready, delay_s, reaction_s
from deltaswarm_operator.core.question_plan import ANOTHER, AWAY, ENDED, NOBODY, QuestionPlan
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.questions import SHEET, FormTechnique
from deltaswarm_scenario.technique import AFTER, BEFORE, DURING, Answers, Seen, Technique
from deltaswarm_scenario.techniques import TECHNIQUES, ProbeSettings

NOT_OPEN = "this question is no longer open"

ANSWERED, MISSED = "answered", "missed"
CUT, RESTARTED = "cut off by the end", "cut off by a restart"
NOT_ASKED = "not asked: "
TIED = "several answers were right"
LATE_BY_PAGE_S = 1.0
"""The page's countdown is as late as the newest picture [s]."""


class Probes:
    """The questions of one run. `wall_s` is any monotonic clock, such as `time.monotonic`."""

    def __init__(
        self, settings: ProbeSettings, rng: Random, drawn: Random | None = None, duration_s: float = 0.0
    ) -> None:
        self.rows: list[ProbeRow] = []
        """Every answer, or its absence."""
        self.opened: deque[ProbeRow] = deque()
        """A row per item of each question that was opened, until somebody takes it."""
        self.is_timed = True
        """Whether a person may answer, for whom wall time passes."""
        self.heard_wall_s = math.inf
        """When a page of the participant was last heard: only up to then does the time to answer run out."""
        self.grace_s = 0.0
        """For how long an answer that was made in time may be on the way after its time [wall s]."""
        self._taken = 0
        """Number of rows that were taken to be written down."""
        self._techniques = {technique.name: technique for technique in settings.techniques}
        for technique in self._techniques.values():
            technique.draw(drawn or rng, duration_s)
        self._questions = self._missing = self._lost = 0
        self._now_s = 0.0
        self._plan = QuestionPlan((one for one in self._techniques.values() if one.when == DURING), rng)
        self._asked: Asked | None = None
        self._waiting: deque[Asked] = deque()
        self._is_over = False
        self._has_begun = False
        self._held_since_wall_s: float | None = None

    @classmethod
    def of(cls, briefing: Briefing) -> "Probes":
        """Return the questions of a run, whose times are drawn from its seed."""
        rng = Random(f"deltaswarm/{briefing.seed}/probes")
        drawn = Random(f"deltaswarm/{briefing.seed}/probes drawn")  # of its own: ISA's times stay
        return cls(briefing.operator.probes, rng, drawn, briefing.duration_s)

    def start(self, wall_s: float, *, is_simulated: bool = False) -> None:
        """Ask the questions before the run, unless they have been asked; a simulated person only what it answers."""
        if not self._has_begun and self._asked is None:
            self._ask_all(BEFORE, 0.0, wall_s, is_simulated=is_simulated)
            self._has_begun = self._asked is None

    def _ask_all(self, when: str, now_s: float, wall_s: float, *, is_simulated: bool = False) -> None:
        for technique in self._techniques.values():
            if technique.when == when and not (is_simulated and technique.simulated(0.0) is None):
                self._ask(Asked(technique, 0, now_s, wall_s, now_s))

    def _ask(self, asked: Asked) -> None:
        """Ask a question, or let it wait until the open ones are closed."""
        self._questions += bool(asked.items)
        if self._asked is None:
            self._open(asked)
        else:
            self._waiting.append(asked)

    def _open(self, asked: Asked) -> None:
        self._asked = asked
        self.opened += self._rows(asked, dict.fromkeys(asked.items))

    def _close(self, wall_s: float) -> None:
        self._asked = None
        if self._waiting:
            self._open(self._waiting.popleft()._replace(asked_wall_s=wall_s))
        self._has_begun |= self._asked is None

    def _rows(self, asked: Asked, answers: Answers, wall_s: float | None = None, outcome: str = "") -> list[ProbeRow]:
        """Return a row for each item; `wall_s`: when it was answered, None if it was not."""
        latency_s = None if wall_s is None else round(self._waited_s(asked, wall_s), 3)
        late_s = round(asked.asked_s - asked.planned_s, 3)
        row = ProbeRow(asked.technique.name, asked.number, "", None, asked.asked_s, latency_s)
        row = row._replace(planned_s=asked.planned_s, late_s=late_s, outcome=outcome)
        if (ready := asked.ready) is not None:
            row = row._replace(
                ready_s=ready.ready_s, ready_latency_s=ready.latency_s, ready_reaction_s=ready.reaction_s
            )
        if self.is_timed:
            row = row._replace(asked_monotonic_s=asked.asked_wall_s, answered_monotonic_s=wall_s)
        return [
            row._replace(item=item, value=value, known=asked.known.get(item, "")) for item, value in answers.items()
        ]

    @property
    def is_sheet_open(self) -> bool:
        return self._asked is not None and self._asked.technique.kind == SHEET

    @property
    def holds_run(self) -> bool:
        return not self._is_over and self._asked is not None and self._asked.holds_run

    @property
    def next_hold_s(self) -> float | None:
        first_s = self._plan.first_s(holds_run=True)
        return first_s if math.isfinite(first_s) else None

    @property
    def next(self) -> dict[str, Any] | None:
        """What is asked next while the run goes on, and when, in the page's format; None: nothing."""
        first_s = self._plan.first_s()
        if self._is_over or not math.isfinite(first_s):
            return None
        name = next(name for name, planned in self._plan.next.items() if planned.at_s == first_s)
        return {"what": name, "at_s": round(first_s, 1)}

    def hold(self, wall_s: float, *, is_held: bool) -> None:
        """Note that the run is held, or goes on: meanwhile the time for an answer does not pass."""
        if self._held_since_wall_s is not None and self._asked is not None:
            since_wall_s = max(self._held_since_wall_s, self._asked.since_wall_s)
            self._asked = self._asked._replace(held_s=self._asked.held_s + wall_s - since_wall_s)
        self._held_since_wall_s = wall_s if is_held else None

    def _waited_s(self, asked: Asked, wall_s: float) -> float:
        """Return how long a question has been open; if it does not hold the run, without the time of other holds."""
        if not self.is_timed:
            return 0.0
        if asked.holds_run:
            return wall_s - asked.since_wall_s
        held = self._held_since_wall_s
        held_s = 0.0 if held is None else wall_s - max(held, asked.since_wall_s)
        return wall_s - asked.since_wall_s - asked.held_s - held_s

    def _left_s(self, asked: Asked, wall_s: float) -> float | None:
        """Return how much time is left to answer a question [wall s]; None: it holds the run."""
        wait_s = asked.technique.wait_s
        return None if wait_s is None else min(wait_s - self._waited_s(asked, wall_s), asked.cut_wall_s - wall_s)

    def resume(self) -> bool:
        """Continue for a killed operator, once loaded; return whether a question held the run.

        Questions of the run that were open are missing; those before it stay open.
        """
        asked_so_far = [asked for asked in (self._asked, *self._waiting) if asked]
        lost = [asked for asked in asked_so_far if asked.technique.when == DURING]
        self._waiting = deque(asked for asked in asked_so_far if asked.technique.when == BEFORE)
        self._asked = self._waiting.popleft() if self._waiting else None
        self.opened = deque()
        self._is_over, self._held_since_wall_s, self.heard_wall_s = False, None, math.inf
        self._taken = len(self.rows)
        for asked in lost:
            self._miss(asked, RESTARTED)
        self.rows[self._taken :] = [row._replace(asked_monotonic_s=None) for row in self.rows[self._taken :]]
        return any(asked.holds_run for asked in lost)

    def tick(
        self,
        now_s: float,
        is_last: bool,
        wall_s: float,
        *,
        is_attended: bool = False,
        is_held: bool = False,
        is_away: bool = False,
        see: Callable[[], Seen] = Seen,
    ) -> None:
        """Ask the questions that are due at a simulated time, one that holds the run only while it is held.

        While the participant's page is away, only a question that holds the run is asked. `see` returns what it shows.
        """
        self._now_s = now_s
        self._expire(wall_s)
        if is_last:
            self._cut_off(wall_s)
            self.end(now_s, wall_s)
            return
        for technique in self._plan.techniques:
            if self._plan.due(technique.name, now_s) is None:
                continue
            why = self._why_not(technique, is_attended=is_attended, is_held=is_held, is_away=is_away)
            if why is None:
                number, at_s, *_ = self._plan.ask(technique.name, now_s)
                known = {} if technique.has_prompt else self._settled(technique, number, at_s, see())
                self._ask(Asked(technique, number, now_s, wall_s, at_s, known=known))
            elif why and self.is_timed:
                self._plan.wait(technique.name, why)
        self._note_dropped()

    def _settled(self, technique: Technique, number: int, planned_s: float, seen: Seen) -> Mapping[str, str]:
        """Let a technique decide what it asks now; return what is right by what the page shows."""
        left_out = technique.settle(number, seen)
        self.rows += self._not_asked(technique, number, left_out, planned_s, TIED)
        return technique.known(number, seen)

    def _why_not(self, technique: Technique, *, is_attended: bool, is_held: bool, is_away: bool) -> str | None:
        """Return why a question cannot be asked now; None: it can; empty: the run is about to be held for it."""
        if technique.needs_person and not is_attended:
            return NOBODY
        if technique.wait_s is None:
            return None if is_held else ""
        if self._asked is not None:
            return ANOTHER
        return AWAY if is_away else None

    def _note_dropped(self) -> None:
        for technique, planned in self._plan.dropped if self.is_timed else ():
            self._lose(technique, planned.number, planned.at_s, planned.why)
        self._plan.dropped.clear()

    def _lose(self, technique: Technique, number: int, planned_s: float, why: str) -> None:
        """Note that a question is not asked."""
        items = technique.items(number)
        self.rows += self._not_asked(technique, number, items, planned_s, why)
        self._lost += bool(items)

    @staticmethod
    def _not_asked(
        technique: Technique, number: int, items: Sequence[str], planned_s: float, why: str
    ) -> list[ProbeRow]:
        row = ProbeRow(technique.name, number, "", None, None, None, planned_s=planned_s, outcome=NOT_ASKED + why)
        return [row._replace(item=item) for item in items]

    def _cut_off(self, wall_s: float) -> None:
        """Close the question that is open when the run ends, and note what was not asked."""
        if (asked := self._asked) is not None and (self._left_s(asked, wall_s) or 0.0) > 0:
            self._asked = asked._replace(cut_wall_s=wall_s)
            self._expire(wall_s)
        self._plan.end(self._now_s)
        self._note_dropped()

    def end(self, now_s: float, wall_s: float) -> None:
        """Ask the questions after the last step, unless they have been asked."""
        if not self._is_over:
            self._ask_all(AFTER, now_s, wall_s)
            self._is_over = True

    def _expire(self, wall_s: float) -> None:
        """Close a question once its time has passed, and an answer that was made in time would have arrived."""
        asked = self._asked
        left_s = None if asked is None else self._left_s(asked, min(wall_s, self.heard_wall_s))
        if asked is not None and left_s is not None and left_s <= -self.grace_s:
            self._miss(asked, CUT if self.is_timed and math.isfinite(asked.cut_wall_s) else MISSED)
            self._close(wall_s)

    def _miss(self, asked: Asked, outcome: str = MISSED) -> None:
        self.rows += self._rows(asked, dict.fromkeys(asked.items), outcome=outcome)
        if outcome == MISSED:
            self._missing += bool(asked.items)
        else:
            self._lost += bool(asked.items)

    def close(self) -> None:
        """Note at the end that open questions have no answer, and which were not asked if the run ended early."""
        for asked in (self._asked, *self._waiting):
            if asked is not None:
                self._miss(asked, CUT if asked.technique.when == DURING else MISSED)
        self._asked, self._waiting = None, deque()
        if self.is_timed and not self._is_over:
            self._plan.end(self._now_s)
            self._note_dropped()
            for technique in self._techniques.values():
                if technique.when == AFTER:
                    self._lose(technique, 0, self._now_s, ENDED)
            self._is_over = True

    def skip(self, wall_s: float) -> None:
        """Close the open question without a row."""
        self._close(wall_s)

    def open(self, wall_s: float) -> dict[str, Any] | None:
        self._expire(wall_s)
        asked = self._asked
        if asked is None:
            return None
        left_s = self._left_s(asked, wall_s)
        if left_s is not None and (left_s := round(left_s, 1)) <= 0:
            return None
        if asked.is_prompt:
            assert isinstance(asked.technique, FormTechnique)
            return asked.technique.shown_prompt(asked.number, left_s)
        return asked.technique.shown(asked.number, asked.asked_s, left_s)

    def be_ready(self, message: Mapping[str, Any], now_s: float, wall_s: float, seen: Seen) -> None:
        """Note that the person is ready, and show the question about what the page shows now."""
        self._expire(wall_s - delay_s(message))
        asked = self._asked
        is_open = asked is not None and asked.is_prompt and math.isinf(asked.cut_wall_s)
        if asked is None or not is_open or not self._is_answer(asked, message, wall_s):
            raise ValueError(NOT_OPEN)
        ready = Ready(now_s, wall_s, round(self._waited_s(asked, wall_s), 3), reaction_s(message))
        known = self._settled(asked.technique, asked.number, asked.planned_s, seen)
        self._asked = asked._replace(ready=ready, held_s=0.0, known=known)

    def _is_answer(self, asked: Asked, message: Mapping[str, Any], wall_s: float) -> bool:
        """Whether a message is about a question and was made in time, by the page's clock or by this one."""
        if not asked.technique.is_meant(asked.number, message):
            return False
        left_s, wait_s = self._left_s(asked, wall_s - delay_s(message)), asked.technique.wait_s
        if wait_s is None or left_s is None or left_s > 0:
            return True
        held_s = wall_s - asked.since_wall_s - self._waited_s(asked, wall_s)
        reacted_s = reaction_s(message)
        return reacted_s is not None and reacted_s <= wait_s + held_s + LATE_BY_PAGE_S

    def answer(self, message: Mapping[str, Any], wall_s: float) -> tuple[dict[str, Any], bool]:
        """Take an answer from the page; return columns of the act, and whether the run was held for it."""
        self._expire(wall_s - delay_s(message))
        asked = self._asked
        is_open = asked is not None and asked.technique.kind == message["type"]
        if asked is None or not is_open or asked.is_prompt or not self._is_answer(asked, message, wall_s):
            raise ValueError(NOT_OPEN)
        return self._add(asked, asked.technique.answers(asked.number, message), wall_s, message)

    def answer_as(self, load: float, wall_s: float) -> tuple[str, dict[str, Any]] | None:
        """Let a simulated person with this load answer the open question; return kind and columns of the act."""
        asked = self._asked
        answers = None if asked is None else asked.technique.simulated(load)
        if asked is None or answers is None:
            return None
        return asked.technique.kind, self._add(asked, answers, wall_s)[0]

    def _add(
        self, asked: Asked, answers: Answers, wall_s: float, message: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], bool]:
        given = message or {}
        self.rows += [
            row._replace(
                shown_page_s=given.get("shown_s"), answered_page_s=given.get("page_s"), reaction_s=reaction_s(given)
            )
            for row in self._rows(asked, answers, wall_s, ANSWERED)
        ]
        self._close(wall_s)
        return asked.technique.act(answers), asked.holds_run

    @property
    def is_asking(self) -> bool:
        """Whether a question is open, or an answer to it may be on the way."""
        return self._asked is not None

    def take_rows(self) -> list[ProbeRow]:
        new, self._taken = self.rows[self._taken :], len(self.rows)
        return new

    def given(self, name: str) -> list[dict[str, Any]]:
        given: dict[int, dict[str, Any]] = {}
        for row in self.rows:
            if row.probe == name and row.value is not None:
                given.setdefault(row.number, {})[row.item] = row.value
        return list(given.values())

    @property
    def outcomes(self) -> dict[str, Any]:
        """Numbers of questions and of missing answers, and the scores of the techniques, for JSON."""
        scores = {name: score for one in TECHNIQUES for name, score in one.scores(self._given(one)).items()}
        counts = {"questions": self._questions, "answers_missing": self._missing, "questions_lost": self._lost}
        return counts | scores

    def _given(self, technique: type[Technique]) -> list[dict[str, Any]]:
        return self.given(technique.name) if technique.title else []
