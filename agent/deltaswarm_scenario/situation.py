"""Questions about the situation, compared with what the page showed and with the truth.

SAGAT: situation awareness global assessment technique (Endsley 1988); the run is held and the page hidden. SPAM:
situation present assessment method (Durso et al. 1998); one question at a time beside the map, once the person says
to be ready, so that the time until then and the time until the answer are measures, too.

A person cannot know what nobody has reported, so an answer is right if it is what the page showed (`known`). Whether
that was true says something about the swarm.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Annotated, NamedTuple

from deltaswarm_scenario.columns import Column
from deltaswarm_scenario.questions import CHOICE, NUMBER, FormSettings, FormTechnique, QuestionSettings
from deltaswarm_scenario.technique import Measure, Recorded, ScoredTable, Seen, Technique
from deltaswarm_scenario.truth import EventState, StepRecord
from deltaswarm_wire.checked import Problem, key

SAGAT, SPAM = "sagat", "spam"
OPEN_EVENTS, IN_TREES, TREES, MOST_EVENTS = "open_events", "agents_in_trees", "trees", "most_events"
QUARTERS = ("top left", "top right", "bottom left", "bottom right")
TITLE, READY = "What is the situation?", "Are you ready for a question?"
OR = " or "
_MANY = 9999.0

SITUATION = {
    question.name: question
    for question in (
        QuestionSettings(OPEN_EVENTS, "How many events are open in the whole area now?", NUMBER, 0.0, _MANY),
        QuestionSettings(IN_TREES, "How many agents are in trees now, roots included?", NUMBER, 0.0, _MANY),
        QuestionSettings(TREES, "How many trees are there now?", NUMBER, 0.0, _MANY),
        QuestionSettings(
            MOST_EVENTS, "Which quarter of the area has the most open events now?", CHOICE, choices=QUARTERS
        ),
    )
}
EVERYWHERE = (OPEN_EVENTS, MOST_EVENTS)
"""Questions that every control can be asked about; without trees the answers to the others are always 0."""


@dataclass(frozen=True)
class TimesSettings:
    situation_first_s: float = key(60.0, "earliest time that sagat_count and spam_count draw [s]", low=0, high=1e9)
    situation_gap_s: float = key(
        60.0, "least time between two drawn times, and from the last one to the end of the run [s]", above=0, high=1e9
    )


@dataclass(frozen=True)
class SagatSettings(TimesSettings):
    sagat_at_s: tuple[float, ...] = key(
        (), "times at which the run is held and asks about the situation (SAGAT) [s]", above=0, high=1e9
    )
    sagat_count: int = key(
        0, "number of such times that are drawn for each run, instead of sagat_at_s", low=0, high=100
    )
    sagat_questions: tuple[str, ...] = key(
        EVERYWHERE, "what it asks about, each time in a drawn order", choices=tuple(SITUATION)
    )


@dataclass(frozen=True)
class SpamSettings(TimesSettings):
    spam_at_s: tuple[float, ...] = key(
        (),
        "times at which one question about the situation is asked while the run goes on (SPAM) [s]",
        above=0,
        high=1e9,
    )
    spam_count: int = key(0, "number of such times that are drawn for each run, instead of spam_at_s", low=0, high=100)
    spam_questions: tuple[str, ...] = key(
        EVERYWHERE, "what it asks about, in turn; each round has a drawn order", choices=tuple(SITUATION)
    )
    spam_wait_s: float = key(
        30.0, "wall time after which the person is not ready, or an answer is missing [s]", above=0, high=3600
    )
    spam_ready: bool = key(True, "whether the person says to be ready before the question is shown")


class SituationRow(NamedTuple):
    """An answer about the situation beside what the page showed and the truth, in `situation.csv`."""

    probe: Annotated[str, Column("", f"{SAGAT} or {SPAM}")]
    number: Annotated[int, Column("", "number of the question, as in probes.csv")]
    item: Annotated[str, Column("", "what was asked")]
    asked_s: Annotated[float, Column("s", "time at which the question was shown")]
    answer: Annotated[str, Column("", "the answer; empty: none was given")]
    known: Annotated[str, Column("", "the right answer by what the page showed, or several with or between them")]
    truth: Annotated[str, Column("", "the right answer, or several with or between them")]
    is_right: Annotated[int | None, Column("", "1: the answer is right by what the page showed")]
    error: Annotated[float | None, Column("", "a number that was answered minus the one that the page showed")]
    is_true: Annotated[int | None, Column("", "1: the answer is right by the truth")]
    true_error: Annotated[float | None, Column("", "a number that was answered minus the true one")]
    is_known_true: Annotated[int | None, Column("", "1: what the page showed was true, which depends on the swarm")]
    known_error: Annotated[float | None, Column("", "the number that the page showed minus the true one")]
    chance: Annotated[
        float | None, Column("", "share of the run's steps at which the most frequent true answer is right: guessing")
    ] = None


def score(run: Recorded) -> list[SituationRow] | None:
    """Score each answer against what was known and true at the end of the step of its question, if that is known.

    What the person was not asked, or had no time for, is not scored.
    """
    names = {technique.name for technique in AtTimes.__subclasses__()}
    answers = [row for row in run.rows("probes") or () if row["probe"] in names and is_scored(row)]
    guesses = {item: _guess(item, run) for item in {row["item"] for row in answers}}
    by_time = {record.time_s: record for record in run.steps}
    rows = []
    for answer in answers:
        record = by_time.get(float(answer.get("ready_s") or answer["asked_s"]))
        if record is None:
            continue
        value, known, item = answer["value"], answer.get("known", ""), answer["item"]
        truth = OR.join(truths(item, record, run))
        asked = (answer["probe"], int(answer["number"]), item, record.time_s)
        of_known, of_truth, of_both = _compare(value, known), _compare(value, truth), _compare(known, truth)
        rows.append(SituationRow(*asked, value, known, truth, *of_known, *of_truth, *of_both, guesses[item]))
    return rows if answers else None


def _compare(value: str, right: str) -> tuple[int | None, float | None]:
    """Return whether a value is one of the right ones, and the difference of numbers; None without a value."""
    if not value or not right:
        return None, None
    try:
        error = float(value) - float(right)
    except ValueError:
        return int(value in right.split(OR) or value == right), None
    return int(error == 0), error


def is_scored(row: Mapping[str, str]) -> bool:
    """Whether the person was asked, and had the time to answer."""
    return bool(row["asked_s"]) and not row.get("outcome", "").startswith("cut")


def _guess(item: str, run: Recorded) -> float | None:
    """Return how often the most frequent answer is right, among the steps at which one alone is."""
    right = [found for record in run.steps if len(found := truths(item, record, run)) == 1]
    most = Counter(answer for [answer] in right).most_common(1)
    return most[0][1] / len(right) if most else None


def truths(item: str, record: StepRecord, run: Recorded) -> list[str]:
    """Return the right answers at the end of a step: several quarters may have most events."""
    if item != MOST_EVENTS:
        number = {OPEN_EVENTS: record.events_open, IN_TREES: record.agents_in_trees, TREES: record.trees}[item]
        return [str(number)]
    places = [(event.x_m, event.y_m) for event in run.events if is_open(event, record.time_s)]
    return _most(places, run.width_m, run.height_m)


def known(item: str, seen: Seen) -> str:
    if item == MOST_EVENTS:
        return OR.join(_most(seen.events_m, seen.width_m, seen.height_m))
    return str({OPEN_EVENTS: len(seen.events_m), IN_TREES: len(seen.roots), TREES: len({*seen.roots})}[item])


def is_open(event: EventState, time_s: float) -> bool:
    """Whether an event has arrived and is not complete at the end of a step, of this time."""
    return event.arrived_s <= time_s and (event.completed_s is None or event.completed_s > time_s)


def _most(places_m: Iterable[tuple[float, float]], width_m: float, height_m: float) -> list[str]:
    """Return the quarters of the area with most of these places."""
    counts = Counter(QUARTERS[2 * (y_m < height_m / 2) + (x_m >= width_m / 2)] for x_m, y_m in places_m)
    most = max(counts.values(), default=0)
    return [quarter for quarter in QUARTERS if counts[quarter] == most]


NEEDS = "operator.probes.sagat_at_s, .sagat_count, .spam_at_s or .spam_count"


SHARES = (
    (
        "situation_right_share",
        "is_right",
        "answers about the situation (SAGAT, SPAM) that are what the page showed, as a share of those asked for",
    ),
    ("situation_true_share", "is_true", "the same by the truth"),
    ("situation_known_share", "is_known_true", "questions to which what the page showed was true: the swarm's share"),
    ("situation_chance_share", "chance", "the share that is right by always giving the most frequent answer"),
)
"""Measures with their columns of `situation.csv` and their meanings."""


def shares(rows: Sequence[Mapping[str, str]]) -> dict[str, float | None]:
    """Return the shares of rows of `situation.csv` that are right; one without an answer is not.

    Of what the page showed, only questions that were shown count. A question with several right answers does not.
    """
    rows = [row for row in rows if OR not in row.get("known", "")]

    def share(column: str) -> float | None:
        values = [row[column] for row in rows if column in row]  # a table may be older than a column
        if column in ("is_known_true", "chance"):
            values = [value for value in values if value]
        return sum(float(value or 0.0) for value in values) / len(values) if values else None

    return {name: share(column) for name, column, _ in SHARES}


class AtTimes(FormTechnique):
    """What SAGAT and SPAM share: questions about the situation at given or drawn times, to a person."""

    needs_person = True
    scored = ScoredTable("situation", SituationRow, score)
    measures = tuple(
        Measure(f"person.{name}", meaning, name, NEEDS, is_in_summary=False) for name, _, meaning in SHARES
    )
    texts = (TITLE, READY, *(question.text for question in SITUATION.values()), *QUARTERS)

    def __init__(self, at_s: Sequence[float], count: int, questions: Sequence[str], times: TimesSettings) -> None:
        self._at_s = sorted(at_s)
        self._count = count
        self._times = times
        self._questions = [SITUATION[name] for name in questions]
        self._ties: dict[int, frozenset[str]] = {}
        """By the number of a question, what had several right answers when it was asked."""
        self._orders: list[list[QuestionSettings]] = []
        """The questions in the drawn order of each round."""

    @classmethod
    def wrong(cls, at_s: Sequence[float], count: int, questions: Sequence[str]) -> list[Problem]:
        """Return a problem if there are times but no questions, or times of both kinds."""
        problems = []
        if (at_s or count) and not questions:
            allowed = f"must be at least one question, since {cls.name}_at_s or {cls.name}_count gives times"
            problems.append(Problem(f"{cls.name}_questions", "none", allowed))
        if at_s and count:
            problems.append(Problem(f"{cls.name}_count", f"{count}", f"must be 0, since {cls.name}_at_s gives times"))
        return problems

    def problems_within(self, duration_s: float, step_s: float) -> list[Problem]:
        """Return a problem if a question would never be asked: what is planned is asked at the end of its step.

        The last step has no question any more, and a run is held for questions once before a step.
        """
        steps = [math.ceil(at_s / step_s - 1e-9) for at_s in self._at_s]
        if late := [at_s for at_s, step in zip(self._at_s, steps, strict=True) if step >= round(duration_s / step_s)]:
            allowed = f"must be before the last step, run.duration_s = {duration_s:g} and run.step_s = {step_s:g}"
            return [Problem(f"operator.probes.{self.name}_at_s", _listed(late), allowed)]
        first_s, gap_s = self._times.situation_first_s, self._times.situation_gap_s
        if self._count and self._slack_s(duration_s) < 0:
            most = max(0, math.floor((duration_s - first_s) / gap_s))
            allowed = (
                f"must be at most {most}: times from situation_first_s = {first_s:g} on, situation_gap_s = {gap_s:g} "
                f"apart and before the end, run.duration_s = {duration_s:g}"
            )
            return [Problem(f"operator.probes.{self.name}_count", f"{self._count}", allowed)]
        if self._count and gap_s < step_s:
            allowed = f"must be at least one step, run.step_s = {step_s:g}"
            return [Problem("operator.probes.situation_gap_s", f"{gap_s:g}", allowed)]
        if self.wait_s is None and len(set(steps)) < len(steps):
            allowed = f"must be in different steps, run.step_s = {step_s:g}: a run is held once before a step"
            return [Problem(f"operator.probes.{self.name}_at_s", _listed(self._at_s), allowed)]
        return []

    def _slack_s(self, duration_s: float) -> float:
        """Return the time by which all drawn times together may move."""
        return duration_s - self._times.situation_first_s - self._count * self._times.situation_gap_s

    def draw(self, rng: Random, duration_s: float) -> None:
        """Draw the times of a run, if they are not given, uniformly with their gap, and the order of the questions."""
        if self._count:
            first_s, gap_s = self._times.situation_first_s, self._times.situation_gap_s
            shifts_s = sorted(rng.uniform(0.0, self._slack_s(duration_s)) for _ in range(self._count))
            self._at_s = [round(first_s + at * gap_s + shift_s, 1) for at, shift_s in enumerate(shifts_s)]
        self._orders = [rng.sample(self._questions, len(self._questions)) for _ in self._at_s]

    def round(self, number: int) -> Sequence[QuestionSettings]:
        """Return the questions in the order of a round; as they were given, if none was drawn."""
        return self._orders[number] if number < len(self._orders) else self._questions

    @property
    def questions(self) -> Sequence[QuestionSettings]:
        return self._questions

    def settle(self, number: int, seen: Seen) -> Sequence[str]:
        """Leave out what has several right answers, which a guess often meets, unless nothing else is left."""
        names = [question.name for question in self._questions]
        ties = frozenset(name for name in names if OR in known(name, seen))
        self._ties[number] = ties if len(ties) < len(names) else frozenset()
        return ()

    def without_ties(self, number: int, questions: Sequence[QuestionSettings]) -> Sequence[QuestionSettings]:
        return [question for question in questions if question.name not in self._ties.get(number, ())]

    def due_s(self, number: int, last_s: float, rng: Random) -> float:
        return self._at_s[number] if number < len(self._at_s) else math.inf

    def known(self, number: int, seen: Seen) -> Mapping[str, str]:
        return {item: known(item, seen) for item in self.items(number)}

    @property
    def outline(self) -> str:
        if self._count:
            return f"{self.title} at {self._count} drawn times"
        return f"{self.title} at {_listed(self._at_s)} s"


def _listed(at_s: Iterable[float]) -> str:
    return ", ".join(f"{one:g}" for one in at_s)


class Sagat(AtTimes):
    """SAGAT: the run is held, the page hides the situation, and asks all of it."""

    name, title, hides = SAGAT, "SAGAT", True

    @classmethod
    def of(cls, settings: SagatSettings) -> Iterable[Technique]:
        given = (settings.sagat_at_s, settings.sagat_count)
        return [cls(*given, settings.sagat_questions, settings)] if any(given) else []

    @classmethod
    def problems(cls, settings: SagatSettings) -> list[Problem]:
        return cls.wrong(settings.sagat_at_s, settings.sagat_count, settings.sagat_questions)

    def form(self, number: int) -> FormSettings:
        return FormSettings(SAGAT, TITLE, question=tuple(self.without_ties(number, self.round(number))))

    def settle(self, number: int, seen: Seen) -> Sequence[str]:
        super().settle(number, seen)
        return sorted(self._ties[number])


class Spam(AtTimes):
    """SPAM: one question after the other in turn, while the run goes on and all stays in view."""

    name, title = SPAM, "SPAM"

    def __init__(self, settings: SpamSettings) -> None:
        super().__init__(settings.spam_at_s, settings.spam_count, settings.spam_questions, settings)
        self.wait_s = settings.spam_wait_s
        self.has_prompt = settings.spam_ready

    @classmethod
    def of(cls, settings: SpamSettings) -> Iterable[Technique]:
        return [cls(settings)] if settings.spam_at_s or settings.spam_count else []

    @classmethod
    def problems(cls, settings: SpamSettings) -> list[Problem]:
        return cls.wrong(settings.spam_at_s, settings.spam_count, settings.spam_questions)

    def form(self, number: int) -> FormSettings:
        at, place = divmod(number, len(self._questions))
        order = self.round(at)
        return FormSettings(SPAM, TITLE, question=(self.without_ties(number, [*order[place:], *order[:place]])[0],))

    def prompt(self, number: int) -> FormSettings:
        return FormSettings(SPAM, READY)
