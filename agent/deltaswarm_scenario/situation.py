"""Questions about the situation, compared with the truth: SAGAT holds the run and hides the page, SPAM does not.

SAGAT: situation awareness global assessment technique (Endsley 1988). SPAM: situation present assessment method; one
question at a time beside the map, so that the time until the answer is a measure, too.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Annotated, NamedTuple

from deltaswarm_scenario.columns import Column
from deltaswarm_scenario.questions import CHOICE, NUMBER, FormSettings, FormTechnique, QuestionSettings
from deltaswarm_scenario.technique import Measure, Recorded, ScoredTable, Technique
from deltaswarm_scenario.truth import EventState, StepRecord
from deltaswarm_wire.checked import Problem, key

SAGAT, SPAM = "sagat", "spam"
OPEN_EVENTS, IN_TREES, TREES, MOST_EVENTS = "open_events", "agents_in_trees", "trees", "most_events"
QUARTERS = ("top left", "top right", "bottom left", "bottom right")
RIGHT_SHARE = "person.situation_right_share"
TITLE = "What is the situation?"
_MANY = 9999.0

SITUATION = {
    question.name: question
    for question in (
        QuestionSettings(OPEN_EVENTS, "How many events are open in the whole area now?", NUMBER, 0.0, _MANY),
        QuestionSettings(IN_TREES, "How many agents are in trees now, roots included?", NUMBER, 0.0, _MANY),
        QuestionSettings(TREES, "How many trees are there now?", NUMBER, 0.0, _MANY),
        QuestionSettings(MOST_EVENTS, "Which quarter of the area has most open events now?", CHOICE, choices=QUARTERS),
    )
}


@dataclass(frozen=True)
class SagatSettings:
    """The keys of SAGAT."""

    sagat_at_s: tuple[float, ...] = key(
        (), "times at which the run is held and asks about the situation (SAGAT) [s]", above=0, high=1e9
    )
    sagat_questions: tuple[str, ...] = key(tuple(SITUATION), "what it asks about", choices=tuple(SITUATION))


@dataclass(frozen=True)
class SpamSettings:
    """The keys of SPAM."""

    spam_at_s: tuple[float, ...] = key(
        (),
        "times at which one question about the situation is asked while the run goes on (SPAM) [s]",
        above=0,
        high=1e9,
    )
    spam_questions: tuple[str, ...] = key(tuple(SITUATION), "what it asks about, in turn", choices=tuple(SITUATION))
    spam_wait_s: float = key(30.0, "wall time after which a SPAM question counts as missing [s]", above=0, high=3600)


class SituationRow(NamedTuple):
    """An answer about the situation beside the truth, in `situation.csv`."""

    probe: Annotated[str, Column("", f"{SAGAT} or {SPAM}")]
    number: Annotated[int, Column("", "number of the question, as in probes.csv")]
    item: Annotated[str, Column("", "what was asked")]
    asked_s: Annotated[float, Column("s", "time of the question")]
    answer: Annotated[str, Column("", "the answer; empty: none was given")]
    truth: Annotated[str, Column("", "the right answer, or several with or between them")]
    is_right: Annotated[int | None, Column("", "1: the answer is right")]
    error: Annotated[float | None, Column("", "a number that was answered minus the right one")]


def score(run: Recorded) -> list[SituationRow] | None:
    """Score each answer against the truth at the end of the step of its question, if that is known."""
    answers = [row for row in run.rows("probes") or () if row["probe"] in (SAGAT, SPAM)]
    by_time = {record.time_s: record for record in run.steps}
    rows = []
    for answer in answers:
        record = by_time.get(float(answer["asked_s"]))
        if record is None:
            continue
        truths = _truths(answer["item"], record, run)
        value, is_number = answer["value"], answer["item"] != MOST_EVENTS
        error = float(value) - float(truths[0]) if value and is_number else None
        is_right = None if not value else int(error == 0) if is_number else int(value in truths)
        asked = (answer["probe"], int(answer["number"]), answer["item"], record.time_s)
        rows.append(SituationRow(*asked, value, " or ".join(truths), is_right, error))
    return rows if answers else None


def _truths(item: str, record: StepRecord, run: Recorded) -> list[str]:
    """Return the right answers: several quarters may have most events."""
    if item != MOST_EVENTS:
        number = {OPEN_EVENTS: record.events_open, IN_TREES: record.agents_in_trees, TREES: record.trees}[item]
        return [str(number)]
    counts = Counter(_quarter(event, run) for event in run.events if is_open(event, record.time_s))
    most = max(counts.values(), default=0)
    return [quarter for quarter in QUARTERS if counts[quarter] == most]


def is_open(event: EventState, time_s: float) -> bool:
    """Whether an event has arrived and is not complete at the end of a step, of this time."""
    return event.arrived_s <= time_s and (event.completed_s is None or event.completed_s > time_s)


def _quarter(event: EventState, run: Recorded) -> str:
    is_right, is_top = event.x_m >= run.width_m / 2, event.y_m >= run.height_m / 2
    return QUARTERS[2 * (not is_top) + is_right]


class AtTimes(FormTechnique):
    """What SAGAT and SPAM share: questions about the situation at given times, to a person."""

    needs_person = True
    scored = ScoredTable("situation", SituationRow, score)
    measures = (
        Measure(
            RIGHT_SHARE,
            "right answers about the situation (SAGAT, SPAM), as a share of those asked for",
            "situation_right_share",
            "operator.probes.sagat_at_s or .spam_at_s",
            is_in_summary=False,
        ),
    )
    texts = (TITLE, *(question.text for question in SITUATION.values()), *QUARTERS)

    def __init__(self, at_s: Sequence[float], questions: Sequence[str]) -> None:
        self._at_s = sorted(at_s)
        self._questions = [SITUATION[name] for name in questions]

    @classmethod
    def missing(cls, at_s: Sequence[float], questions: Sequence[str]) -> list[Problem]:
        """Return a problem if there are times but no questions."""
        if questions or not at_s:
            return []
        allowed = f"must be at least one question, since {cls.name}_at_s has times"
        return [Problem(f"{cls.name}_questions", "none", allowed)]

    def problems_within(self, duration_s: float) -> list[Problem]:
        """Return a problem if a time is not before the end of the run."""
        if late := ", ".join(f"{at_s:g}" for at_s in self._at_s if at_s >= duration_s):
            allowed = f"must be before the end of the run, run.duration_s = {duration_s:g}"
            return [Problem(f"operator.probes.{self.name}_at_s", late, allowed)]
        return []

    def due_s(self, number: int, last_s: float, rng: Random) -> float:
        """Return the time with this number."""
        return self._at_s[number] if number < len(self._at_s) else math.inf

    @property
    def outline(self) -> str:
        """Its times."""
        return f"{self.title} at {', '.join(f'{at_s:g}' for at_s in self._at_s)} s"


class Sagat(AtTimes):
    """SAGAT: the run is held, the page hides the situation, and asks all of it."""

    name, title, hides = SAGAT, "SAGAT", True

    @classmethod
    def of(cls, settings: SagatSettings) -> Iterable[Technique]:
        """Return SAGAT if it has times."""
        return [cls(settings.sagat_at_s, settings.sagat_questions)] if settings.sagat_at_s else []

    @classmethod
    def problems(cls, settings: SagatSettings) -> list[Problem]:
        """Ask something."""
        return cls.missing(settings.sagat_at_s, settings.sagat_questions)

    def form(self, number: int) -> FormSettings:
        """Return all questions."""
        return FormSettings(SAGAT, TITLE, question=tuple(self._questions))


class Spam(AtTimes):
    """SPAM: one question after the other in turn, while the run goes on and all stays in view."""

    name, title = SPAM, "SPAM"

    def __init__(self, settings: SpamSettings) -> None:
        super().__init__(settings.spam_at_s, settings.spam_questions)
        self.wait_s = settings.spam_wait_s

    @classmethod
    def of(cls, settings: SpamSettings) -> Iterable[Technique]:
        """Return SPAM if it has times."""
        return [cls(settings)] if settings.spam_at_s else []

    @classmethod
    def problems(cls, settings: SpamSettings) -> list[Problem]:
        """Ask something."""
        return cls.missing(settings.spam_at_s, settings.spam_questions)

    def form(self, number: int) -> FormSettings:
        """Return the question whose turn it is."""
        return FormSettings(SPAM, TITLE, question=(self._questions[number % len(self._questions)],))
