"""One participant's session: the runs, what has been done of them, and what comes next. Pure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from deltaswarm_scenario.questions import FormSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.technique import AFTER, Technique
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_sessions.plan import PlannedRun
from deltaswarm_sessions.settings import END, NOT_REACHED, OPEN, REACHED, CriterionSettings

NOTHING = ProbeSettings(isa_every_s=0.0)
SCORE = "score"
SCORE_TITLE = "Your score"
SCORE_TEXT = (
    "Judged right: {right} of {events} reported events. Targets found: {hits}. Targets taken for decoys: {misses}. "
    "Decoys taken for targets: {false_alarms}. Without a judgement: {unjudged}. "
    "By tossing a coin about {chance} would be right."
)


class Attempt(NamedTuple):
    folder: str
    """The folder's name."""
    summary: dict[str, Any]
    """With the answers that were given later."""
    scenario: Scenario
    """As it was planned."""
    answered: frozenset[str]
    """Names of the probes that have an answer."""

    @property
    def is_valid(self) -> bool:
        """Whether the run reached its last step and its numbers may be used; else it is done again."""
        return bool(self.summary["complete"] and self.summary.get("valid", True))

    @property
    def answers_missing(self) -> int | None:
        """The number of questions without an answer; None if no person took part."""
        missing: int | None = (self.summary.get("person") or {}).get("answers_missing")
        return missing

    @property
    def score(self) -> FormSettings | None:
        """The page that tells the person how the task went; None if there was none."""
        return score_form(self.summary)

    @property
    def unanswered(self) -> ProbeSettings | None:
        """What to ask again; None if nothing is missing.

        What is about a moment of the run is not asked again. The keys of a technique begin with its name.
        """
        probes, has = self.scenario.operator.probes, self.answered
        forms = tuple(replace(form, when=AFTER) for form in probes.form if form.question and form.name not in has)
        names = [one.name for one in asked_after(probes) if one.name not in has]
        if not names and not forms:
            return None
        keys = [field.name for field in fields(probes) if field.name.startswith(tuple(names))]
        return replace(NOTHING, form=forms, **{key: getattr(probes, key) for key in keys})


def asked_after(probes: ProbeSettings) -> list[Technique]:
    """Return the techniques, besides forms, that ask after the run."""
    return [one for one in probes.techniques if one.when == AFTER and one.title and one.items(0)]


def score_form(summary: Mapping[str, Any]) -> FormSettings | None:
    """Return the page that tells the person how the task of a run went; None if there was none."""
    task = summary.get("task")
    if not task:
        return None
    told = task | {"right": task["hits"] + task["correct_rejections"]}
    told["chance"] = round((task["events"] - task["unjudged"]) / 2)
    return FormSettings(SCORE, SCORE_TITLE, SCORE_TEXT.format(**told))


@dataclass(frozen=True)
class DoRun:
    """Next: do a run, or do it again."""

    run: PlannedRun
    text: str
    """What it is, and why it is repeated."""


@dataclass(frozen=True)
class Ask:
    """Next: show a page after a run, with the score or with questions that have no answer."""

    attempt: Attempt
    probes: ProbeSettings
    text: str
    """What is asked; empty for the score."""


@dataclass(frozen=True)
class Say:
    """Next: tell the experimenter what is wrong."""

    text: str
    is_end: bool = False
    """Whether the session ends here."""


class Session:
    """The state of a session. Its user carries out each step, and puts the attempts that exist then into `attempts`."""

    def __init__(
        self,
        participant: int,
        runs: Sequence[PlannedRun],
        *,
        shows_score: bool = True,
        kept: Mapping[str, Any] | None = None,
    ) -> None:
        self.participant = participant
        self._kept = kept or {}
        self.runs = runs
        self._shows_score = shows_score
        self.attempts: dict[str, list[Attempt]] = {run.folder: [] for run in runs}
        """All attempts at each run that have ended, in order, by the folder of the run."""

    def steps(self) -> Iterator[DoRun | Ask | Say]:
        """Yield what is left to do, one step after the other: runs that are open, and answers that are missing."""
        for run in self.runs:
            for attempt in self._valid(run):
                yield from self._asked(run, attempt)
            while self.outcome(run) == OPEN:
                yield DoRun(run, f"run {run.position} of {len(self.runs) - 1}: {run.label}{self._repeated(run)}")
                for attempt in self.attempts[run.folder][-1:]:
                    yield from self._after(run, attempt)
                if run.criterion is None:
                    break
            if run.criterion and self.outcome(run) == NOT_REACHED:
                ends = run.criterion.if_not_reached == END
                then = "the session ends here" if ends else "the session goes on"
                judged = self._judged(run, run.criterion)
                yield Say(f"the criterion of the training is not reached: {judged}; {then}", ends)

    def outcome(self, run: PlannedRun) -> str:
        """Return OPEN if the run must be done, or done again; REACHED or NOT_REACHED if it is finished."""
        valid = self._valid(run)
        if run.criterion is None:
            return REACHED if valid else OPEN
        return run.criterion.outcome([run.criterion.value(attempt.summary) for attempt in valid])

    @property
    def record(self) -> dict[str, Any]:
        """The order of the conditions, the attempts at each run, and what is kept from earlier records."""
        return {
            "participant": self.participant,
            "language": self.runs[0].scenario.operator.page.language.tag,
            **self._kept,
            "runs": [self._row(run) for run in self.runs],
        }

    def _row(self, run: PlannedRun) -> dict[str, Any]:
        criterion = run.criterion
        rows = [
            {
                "folder": attempt.folder,
                "complete": attempt.summary["complete"],
                "valid": attempt.is_valid,
                "digest": attempt.summary["digest"],
                "answers_missing": attempt.answers_missing,
                **({"training_value": criterion.value(attempt.summary)} if criterion else {}),
            }
            for attempt in self.attempts[run.folder]
        ]
        row = {
            "place": run.position,
            "condition": run.label,
            "scenario": run.scenario.name,
            "set": list(run.set),
            "stream": run.stream,
            "attempts": rows,
        }
        return row | ({"outcome": self.outcome(run)} if criterion else {})

    def _valid(self, run: PlannedRun) -> list[Attempt]:
        return [attempt for attempt in self.attempts[run.folder] if attempt.is_valid]

    def _after(self, run: PlannedRun, attempt: Attempt) -> Iterator[Ask | Say]:
        """Yield what follows a run that has just ended: the score, questions without an answer, and what they lack."""
        if (score := attempt.score) and self._shows_score:
            yield Ask(attempt, replace(NOTHING, form=(score,)), "")
        yield from self._asked(run, attempt)
        if missing := self.attempts[run.folder][-1].answers_missing:
            yield Say(f"answers missing in run {run.position}, {run.label}: {missing}")

    @staticmethod
    def _asked(run: PlannedRun, attempt: Attempt) -> Iterator[Ask]:
        if probes := attempt.unanswered:
            asked = ", ".join([*(one.title for one in asked_after(probes)), *(form.name for form in probes.form)])
            yield Ask(attempt, probes, f"asking again after run {run.position}, {run.label}: {asked}")

    def _repeated(self, run: PlannedRun) -> str:
        """Say why training is repeated, and how often; empty: it is not."""
        count = len(self._valid(run))
        if run.criterion is None or not count:
            return ""
        return f" again ({count + 1} of at most {run.criterion.max_runs}), since {self._judged(run, run.criterion)}"

    def _judged(self, run: PlannedRun, criterion: CriterionSettings) -> str:
        values = [criterion.value(attempt.summary) for attempt in self._valid(run)]
        got = ", ".join("none" if value is None else f"{value:g}" for value in values)
        return f"{criterion.metric} must be {criterion.bounds} (got {got})"
