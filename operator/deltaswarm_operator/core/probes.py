"""Questions to the person at the station: ISA, SAGAT and SPAM during the run, NASA-TLX and forms.

ISA (instantaneous self-assessment): workload from 1 to 5, at intervals of simulated time with optional jitter. SAGAT
(situation awareness global assessment technique): at given times the run is held, the page hides the situation and asks
about it. SPAM (situation present assessment method): one question about the situation while the run goes on and all
stays in view. An answer to ISA or SPAM that does not come in time is missing. NASA-TLX: six scales from 0 to 100, raw,
and optionally 15 pairwise weights.
"""

import math
from collections import deque
from collections.abc import Mapping
from random import Random
from typing import Any, NamedTuple

from deltaswarm_scenario.operator_settings import ISA, SAGAT, SPAM, TLX, ProbeSettings
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.questions import (
    AFTER,
    BEFORE,
    PAIRS,
    SCALES,
    SITUATION,
    FormSettings,
    tlx_scores,
    weight_of,
)
from deltaswarm_wire.checked import plain

SHEET, FORM = "sheet", "form"
IN_PASSING = (ISA, SPAM)
"""Questions that do not hold the run, and whose time to answer ends."""


class _Asked(NamedTuple):
    """A question that is open, or waits for the one before it."""

    kind: str
    number: int
    asked_s: float
    asked_wall_s: float
    form: FormSettings | None = None
    held_s: float = 0.0
    """Wall time since then in which the run was held [s]."""

    def row(self, item: str, value: Any = None, latency_s: float | None = None) -> ProbeRow:
        """Make the row of an answer to an item, or of its absence."""
        probe = self.form.name if self.form else self.kind
        return ProbeRow(probe, self.number, item, value, self.asked_s, latency_s)

    @property
    def items(self) -> tuple[str, ...]:
        """Return what is asked for."""
        if self.form is not None:
            return tuple(question.name for question in self.form.question)
        return SCALES if self.kind == TLX else (self.kind,)


class Probes:
    """The questions of one run. `wall_s` is any monotonic clock, such as `time.monotonic`."""

    def __init__(self, settings: ProbeSettings, rng: Random) -> None:
        self.rows: list[ProbeRow] = []
        self.answers: list[int] = []
        """The answers to ISA."""
        self.opened: deque[ProbeRow] = deque()
        """A row per item of each question that was opened, until somebody takes it."""
        self.is_timed = True
        """Whether a person may answer, for whom wall time passes."""
        self._settings = settings
        self._rng = rng
        self._questions = self._missing = 0
        self._tlx: dict[str, float] = {}
        """The scores of NASA-TLX, once it is answered."""
        self._isa_number = self._sagat_number = self._spam_number = 0
        self._isa_due_s = self._next_isa_s(0.0)
        self._sagat_due_s, self._spam_due_s = sorted(settings.sagat_at_s), sorted(settings.spam_at_s)
        self._asked: _Asked | None = None
        self._waiting: deque[_Asked] = deque()
        self._is_over = False
        self._has_begun = False
        self._held_since_wall_s: float | None = None

    def _next_isa_s(self, after_s: float) -> float:
        every_s = self._settings.isa_every_s
        if not every_s:
            return math.inf
        return after_s + every_s + self._rng.uniform(0.0, self._settings.isa_jitter_s)

    def start(self, wall_s: float) -> None:
        """Ask for the session's sheet, if there is one, and for the forms before the run, unless that is done."""
        if self._has_begun:
            return
        if self._settings.has_sheet:
            self._ask(_Asked(SHEET, 0, 0.0, wall_s))
        self._ask_forms(BEFORE, 0.0, wall_s)
        self._has_begun = self._asked is None

    def _ask_forms(self, when: str, now_s: float, wall_s: float) -> None:
        for form in self._settings.form:
            if form.when == when:
                self._ask(_Asked(FORM, 0, now_s, wall_s, form))

    def _ask(self, asked: _Asked) -> None:
        """Ask a question, or let it wait until the open ones are closed."""
        self._questions += asked.kind != SHEET and bool(asked.items)
        if self._asked is None:
            self._open(asked)
        else:
            self._waiting.append(asked)

    def _open(self, asked: _Asked) -> None:
        self._asked = asked
        self.opened += self._rows(asked)

    def _rows(self, asked: _Asked) -> list[ProbeRow]:
        """Return the rows of a question without answers."""
        wall_s = asked.asked_wall_s if self.is_timed else None
        return [asked.row(item)._replace(asked_monotonic_s=wall_s) for item in asked.items]

    def _close(self, wall_s: float) -> None:
        """Close the open question, and ask the next one that waits."""
        self._asked = None
        if self._waiting:
            self._open(self._waiting.popleft()._replace(asked_wall_s=wall_s))
        self._has_begun |= self._asked is None

    @property
    def is_sheet_open(self) -> bool:
        """Whether the session's sheet must still be filled in."""
        return self._asked is not None and self._asked.kind == SHEET

    @property
    def holds_run(self) -> bool:
        """Whether the run waits for an answer."""
        return not self._is_over and self._asked is not None and self._asked.kind not in IN_PASSING

    @property
    def next_sagat_s(self) -> float | None:
        """The time at which the run must be held next, if any [s]."""
        return self._sagat_due_s[self._sagat_number] if self._sagat_number < len(self._sagat_due_s) else None

    def hold(self, wall_s: float, *, is_held: bool) -> None:
        """Note that the run is held, or goes on: meanwhile the time for an answer does not pass."""
        if self._held_since_wall_s is not None and self._asked is not None:
            since_wall_s = max(self._held_since_wall_s, self._asked.asked_wall_s)
            self._asked = self._asked._replace(held_s=self._asked.held_s + wall_s - since_wall_s)
        self._held_since_wall_s = wall_s if is_held else None

    def _waited_s(self, asked: _Asked, wall_s: float) -> float:
        """Return how long a question has been open; one in passing, without the time in which the run was held."""
        if not self.is_timed:
            return 0.0
        if asked.kind not in IN_PASSING:
            return wall_s - asked.asked_wall_s
        held = self._held_since_wall_s
        held_s = 0.0 if held is None else wall_s - max(held, asked.asked_wall_s)
        return wall_s - asked.asked_wall_s - asked.held_s - held_s

    def state(self) -> dict[str, Any]:
        """Return all that is needed to resume, for JSON."""
        of_the_run = (*IN_PASSING, SAGAT)
        lost = [asked for asked in (self._asked, *self._waiting) if asked is not None and asked.kind in of_the_run]
        return {
            "isa_number": self._isa_number,
            "isa_due_s": self._isa_due_s if math.isfinite(self._isa_due_s) else None,
            "sagat_number": self._sagat_number,
            "spam_number": self._spam_number,
            "open": [[asked.kind, asked.number, asked.asked_s] for asked in lost],
            "begun": self._has_begun,
            "answers": self.answers,
            "questions": self._questions,
            "missing": self._missing,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Resume from another object's `state`; questions of the run that were open at that time are missing."""
        self._isa_number, self._sagat_number = state["isa_number"], state["sagat_number"]
        self._spam_number = state["spam_number"]
        self._has_begun = state["begun"]
        self.answers, self._missing = list(state["answers"]), state["missing"]
        self._questions = state["questions"] if self._has_begun else 0
        for kind, number, asked_s in state["open"]:
            self._miss(_Asked(kind, number, asked_s, 0.0, self._situation(kind, number)))
        self.rows = [row._replace(asked_monotonic_s=None) for row in self.rows]
        self._isa_due_s = math.inf if state["isa_due_s"] is None else state["isa_due_s"]

    def tick(
        self, now_s: float, is_last: bool, wall_s: float, *, is_attended: bool = False, is_held: bool = False
    ) -> None:
        """Ask the question that is due at a simulated time; about the situation only if a person sits there."""
        self._expire(wall_s, at_once=is_last)
        if is_last:
            self.end(now_s, wall_s)
            return
        if (due_s := self.next_sagat_s) is not None and now_s >= due_s and is_attended and is_held:
            form = self._situation(SAGAT, self._sagat_number)
            self._ask(_Asked(SAGAT, self._sagat_number, now_s, wall_s, form))
            self._sagat_number += 1
        number = self._spam_number
        is_due = number < len(self._spam_due_s) and now_s >= self._spam_due_s[number]
        if is_due and is_attended and self._asked is None:
            self._ask(_Asked(SPAM, number, now_s, wall_s, self._situation(SPAM, number)))
            self._spam_number += 1
        if now_s >= self._isa_due_s and self._asked is None:
            self._ask(_Asked(ISA, self._isa_number, now_s, wall_s))
            self._isa_number += 1
            self._isa_due_s = self._next_isa_s(max(self._isa_due_s, now_s))

    def end(self, now_s: float, wall_s: float) -> None:
        """Ask what is asked after the last step, unless that is done."""
        if self._is_over:
            return
        if self._settings.tlx:
            self._ask(_Asked(TLX, 0, now_s, wall_s))
        self._ask_forms(AFTER, now_s, wall_s)
        self._is_over = True

    def _expire(self, wall_s: float, *, at_once: bool) -> None:
        asked = self._asked
        if asked is None or asked.kind not in IN_PASSING:
            return
        if at_once or self._left_s(asked, wall_s) <= 0:
            self._miss(asked)
            self._close(wall_s)

    def _left_s(self, asked: _Asked, wall_s: float) -> float:
        """Return how much time is left to answer a question in passing [wall s]."""
        wait_s = self._settings.isa_wait_s if asked.kind == ISA else self._settings.spam_wait_s
        return wait_s - self._waited_s(asked, wall_s)

    def _situation(self, kind: str, number: int) -> FormSettings | None:
        """Return the form about the situation that a question has, if it has one."""
        if kind == SAGAT:
            questions = tuple(SITUATION[name] for name in self._settings.sagat_questions)
            return FormSettings(SAGAT, "What is the situation?", question=questions)
        if kind == SPAM:
            names = self._settings.spam_questions
            return FormSettings(SPAM, "What is the situation?", question=(SITUATION[names[number % len(names)]],))
        return None

    def _miss(self, asked: _Asked) -> None:
        self.rows += self._rows(asked)
        self._missing += bool(asked.items)

    def close(self) -> None:
        """At the end, whatever still is asked has no answer."""
        for asked in (self._asked, *self._waiting):
            if asked is not None and asked.kind != SHEET:
                self._miss(asked)
        self._asked, self._waiting = None, deque()

    def open(self, wall_s: float) -> dict[str, Any] | None:
        """Return the open question in the page's format, or None."""
        self._expire(wall_s, at_once=False)
        asked = self._asked
        if asked is None:
            return None
        left_s = round(self._left_s(asked, wall_s), 1) if asked.kind in IN_PASSING else None
        if asked.form is not None:
            shown = {"hides": asked.kind == SAGAT, "left_s": left_s, "form": plain(asked.form)}
            return {"kind": FORM, "number": asked.number, **shown}
        if asked.kind != ISA:
            return {"kind": asked.kind}
        return {"kind": ISA, "number": asked.number, "asked_s": asked.asked_s, "left_s": left_s}

    def answer_isa(self, number: Any, answer: Any, wall_s: float) -> None:
        """Take an ISA answer. Raises ValueError: the question is not open, or the answer is not from 1 to 5."""
        self._expire(wall_s, at_once=False)
        asked = self._asked
        if asked is None or asked.kind != ISA or asked.number != number:
            raise ValueError("this question is no longer open")
        if type(answer) is not int or not 1 <= answer <= 5:
            raise ValueError("the answer must be from 1 to 5")
        self._add(asked, {ISA: answer}, wall_s)
        self.answers.append(answer)

    def answer_tlx(self, scales: Any, weights: Any, wall_s: float) -> None:
        """Take the NASA-TLX form. Raises ValueError: the form is not open, or not filled in correctly."""
        asked = self._asked
        if asked is None or asked.kind != TLX:
            raise ValueError("NASA-TLX is not open")
        _check_table(scales, 100, "each scale must be from 0 to 100")
        answers = {scale: scales[scale] for scale in SCALES}
        if self._settings.tlx_weights:
            _check_table(weights, 5, "each weight must be from 0 to 5")
            if sum(weights.values()) != PAIRS:
                raise ValueError(f"the weights must add up to {PAIRS}")
            answers |= {weight_of(scale): weights[scale] for scale in SCALES}
        self._add(asked, answers, wall_s)
        self._tlx = tlx_scores(answers)

    def answer_form(self, name: Any, answers: Any, wall_s: float) -> None:
        """Take a form's answers by question.

        Raises:
            ValueError: the form is not open, or not filled in correctly.
        """
        self._expire(wall_s, at_once=False)
        asked = self._asked
        if asked is None or asked.form is None or asked.form.name != name:
            raise ValueError("this form is not open")
        if not isinstance(answers, Mapping) or not answers.keys() <= set(asked.items):
            raise ValueError("an answer is of no question of this form")
        for question in asked.form.question:
            question.check(answers.get(question.name))
        self._add(asked, {item: answers.get(item) for item in asked.items}, wall_s)

    @property
    def outcomes(self) -> dict[str, Any]:
        """Numbers of questions and of missing answers, and the scores of NASA-TLX, for JSON."""
        return {"questions": self._questions, "answers_missing": self._missing, "tlx": self._tlx or None}

    def take_sheet(self, wall_s: float) -> None:
        """Note that the session's sheet is filled in. Raises ValueError: it is not open."""
        if not self.is_sheet_open:
            raise ValueError("the session's sheet is not open")
        self._close(wall_s)

    def _add(self, asked: _Asked, answers: Mapping[str, Any], wall_s: float) -> None:
        latency_s = round(self._waited_s(asked, wall_s), 3)
        for item, value in answers.items():
            row = asked.row(item, value, latency_s)
            if self.is_timed:
                row = row._replace(asked_monotonic_s=asked.asked_wall_s, answered_monotonic_s=wall_s)
            self.rows.append(row)
        self._close(wall_s)


def _check_table(table: Any, most: int, problem: str) -> None:
    if not isinstance(table, Mapping) or table.keys() != set(SCALES):
        raise ValueError(f"an answer to each of {', '.join(SCALES)} is needed")
    if not all(type(value) is int and 0 <= value <= most for value in table.values()):
        raise ValueError(problem)
