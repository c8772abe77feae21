"""Ask the person at the station the questions of a run: when they are due, which is open, how long, what was answered.

The techniques define what is asked (`deltaswarm_scenario.techniques`). One question is open at a time. A question that
does not hold the run is not asked beside another, and is missing if its answer does not come in time.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from random import Random
from typing import Any, NamedTuple

from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.questions import SHEET, FormTechnique
from deltaswarm_scenario.technique import AFTER, BEFORE, DURING, Answers, Seen, Technique
from deltaswarm_scenario.techniques import TECHNIQUES, ProbeSettings

NOT_OPEN = "this question is no longer open"


def delay_s(message: Mapping[str, Any]) -> float:
    """Return how long a page kept an input before it could send it [s]."""
    page_s, sent_s = message.get("page_s"), message.get("sent_s")
    return 0.0 if page_s is None or sent_s is None else max(0.0, round(sent_s - page_s, 3))


def _reaction_s(message: Mapping[str, Any]) -> float | None:
    """Return the time from the frame that showed a question to the answer, by the page's clock [s]."""
    shown_s, page_s = message.get("shown_s"), message.get("page_s")
    return None if shown_s is None or page_s is None else round(page_s - shown_s, 3)


class _Asked(NamedTuple):
    technique: Technique
    number: int
    asked_s: float
    asked_wall_s: float
    held_s: float = 0.0
    """Wall time since then in which the run was held [s]."""
    known: Mapping[str, str] = {}
    """The answer to each item that is right by what the page showed."""
    ready: "_Ready | None" = None
    """How the person became ready, after a prompt."""

    @property
    def items(self) -> tuple[str, ...]:
        return tuple(self.technique.items(self.number))

    @property
    def holds_run(self) -> bool:
        return self.technique.wait_s is None

    @property
    def is_prompt(self) -> bool:
        """Whether the person is still to say to be ready."""
        return self.technique.has_prompt and self.ready is None

    @property
    def since_wall_s(self) -> float:
        """Return when the time to answer began, or that to become ready."""
        return self.asked_wall_s if self.ready is None else self.ready.wall_s


class _Ready(NamedTuple):
    """When the person was ready for a question, and for how long its prompt had been there."""

    ready_s: float
    wall_s: float
    latency_s: float
    reaction_s: float | None


class _Due(NamedTuple):
    number: int
    at_s: float


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
        self._taken = 0
        """Number of rows that were taken to be written down."""
        self._techniques = {technique.name: technique for technique in settings.techniques}
        self._rng = rng
        for technique in self._techniques.values():
            technique.draw(drawn or rng, duration_s)
        self._questions = self._missing = 0
        self._due = {
            name: _Due(0, technique.due_s(0, 0.0, rng))
            for name, technique in self._techniques.items()
            if technique.when == DURING
        }
        self._asked: _Asked | None = None
        self._waiting: deque[_Asked] = deque()
        self._is_over = False
        self._has_begun = False
        self._held_since_wall_s: float | None = None

    def start(self, wall_s: float) -> None:
        """Ask the questions before the run, unless they have been asked."""
        if not self._has_begun and self._asked is None:
            self._ask_all(BEFORE, 0.0, wall_s)
            self._has_begun = self._asked is None

    def _ask_all(self, when: str, now_s: float, wall_s: float) -> None:
        for technique in self._techniques.values():
            if technique.when == when:
                self._ask(_Asked(technique, 0, now_s, wall_s))

    def _ask(self, asked: _Asked) -> None:
        """Ask a question, or let it wait until the open ones are closed."""
        self._questions += bool(asked.items)
        if self._asked is None:
            self._open(asked)
        else:
            self._waiting.append(asked)

    def _open(self, asked: _Asked) -> None:
        self._asked = asked
        self.opened += self._rows(asked, dict.fromkeys(asked.items))

    def _close(self, wall_s: float) -> None:
        self._asked = None
        if self._waiting:
            self._open(self._waiting.popleft()._replace(asked_wall_s=wall_s))
        self._has_begun |= self._asked is None

    def _rows(self, asked: _Asked, answers: Answers, wall_s: float | None = None) -> list[ProbeRow]:
        """Return a row for each item; `wall_s`: when it was answered, None if it was not."""
        latency_s = None if wall_s is None else round(self._waited_s(asked, wall_s), 3)
        row = ProbeRow(asked.technique.name, asked.number, "", None, asked.asked_s, latency_s)
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
        times_s = [due.at_s for name, due in self._due.items() if self._techniques[name].wait_s is None]
        first_s = min(times_s, default=math.inf)
        return first_s if math.isfinite(first_s) else None

    @property
    def next(self) -> dict[str, Any] | None:
        """What is asked next while the run goes on, and when, in the page's format; None: nothing."""
        name, due = min(self._due.items(), key=lambda one: one[1].at_s, default=("", _Due(0, math.inf)))
        is_none = self._is_over or not math.isfinite(due.at_s)
        return None if is_none else {"what": name, "at_s": round(due.at_s, 1)}

    def hold(self, wall_s: float, *, is_held: bool) -> None:
        """Note that the run is held, or goes on: meanwhile the time for an answer does not pass."""
        if self._held_since_wall_s is not None and self._asked is not None:
            since_wall_s = max(self._held_since_wall_s, self._asked.since_wall_s)
            self._asked = self._asked._replace(held_s=self._asked.held_s + wall_s - since_wall_s)
        self._held_since_wall_s = wall_s if is_held else None

    def _waited_s(self, asked: _Asked, wall_s: float) -> float:
        """Return how long a question has been open; if it does not hold the run, without the time of other holds."""
        if not self.is_timed:
            return 0.0
        if asked.holds_run:
            return wall_s - asked.since_wall_s
        held = self._held_since_wall_s
        held_s = 0.0 if held is None else wall_s - max(held, asked.since_wall_s)
        return wall_s - asked.since_wall_s - asked.held_s - held_s

    def _left_s(self, asked: _Asked, wall_s: float) -> float | None:
        """Return how much time is left to answer a question [wall s]; None: it holds the run."""
        wait_s = asked.technique.wait_s
        return None if wait_s is None else wait_s - self._waited_s(asked, wall_s)

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
            self._miss(asked)
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
        self._expire(wall_s, at_once=is_last)
        if is_last:
            self.end(now_s, wall_s)
            return
        for name, (number, due_s) in self._due.items():
            technique = self._techniques[name]
            may_ask = is_held if technique.wait_s is None else self._asked is None and not is_away
            if now_s >= due_s and may_ask and (is_attended or not technique.needs_person):
                known = {} if technique.has_prompt else technique.known(number, see())
                self._ask(_Asked(technique, number, now_s, wall_s, known=known))
                self._due[name] = _Due(number + 1, technique.due_s(number + 1, max(due_s, now_s), self._rng))

    def end(self, now_s: float, wall_s: float) -> None:
        """Ask the questions after the last step, unless they have been asked."""
        if not self._is_over:
            self._ask_all(AFTER, now_s, wall_s)
            self._is_over = True

    def _expire(self, wall_s: float, *, at_once: bool) -> None:
        asked = self._asked
        left_s = None if asked is None else self._left_s(asked, min(wall_s, self.heard_wall_s))
        if asked is not None and left_s is not None and (at_once or left_s <= 0):
            self._miss(asked)
            self._close(wall_s)

    def _miss(self, asked: _Asked) -> None:
        self.rows += self._rows(asked, dict.fromkeys(asked.items))
        self._missing += bool(asked.items)

    def close(self) -> None:
        """Note at the end that open questions have no answer."""
        for asked in (self._asked, *self._waiting):
            if asked is not None:
                self._miss(asked)
        self._asked, self._waiting = None, deque()

    def open(self, wall_s: float) -> dict[str, Any] | None:
        self._expire(wall_s, at_once=False)
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
        self._expire(wall_s - delay_s(message), at_once=False)
        asked = self._asked
        if asked is None or not asked.is_prompt or not self._is_answer(asked, message, wall_s):
            raise ValueError(NOT_OPEN)
        ready = _Ready(now_s, wall_s, round(self._waited_s(asked, wall_s), 3), _reaction_s(message))
        known = asked.technique.known(asked.number, seen)
        self._asked = asked._replace(ready=ready, held_s=0.0, known=known)

    def _is_answer(self, asked: _Asked, message: Mapping[str, Any], wall_s: float) -> bool:
        """Whether a message is about a question, and was made in time; it may have waited for a connection."""
        left_s = self._left_s(asked, wall_s - delay_s(message))
        return asked.technique.is_meant(asked.number, message) and (left_s is None or left_s > 0)

    def answer(self, message: Mapping[str, Any], wall_s: float) -> tuple[dict[str, Any], bool]:
        """Take an answer from the page; return columns of the act, and whether the run was held for it."""
        self._expire(wall_s - delay_s(message), at_once=False)
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
        self, asked: _Asked, answers: Answers, wall_s: float, message: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], bool]:
        given = message or {}
        self.rows += [
            row._replace(
                shown_page_s=given.get("shown_s"), answered_page_s=given.get("page_s"), reaction_s=_reaction_s(given)
            )
            for row in self._rows(asked, answers, wall_s)
        ]
        self._close(wall_s)
        return asked.technique.act(answers), asked.holds_run

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
        return {"questions": self._questions, "answers_missing": self._missing, **scores}

    def _given(self, technique: type[Technique]) -> list[dict[str, Any]]:
        return self.given(technique.name) if technique.title else []
