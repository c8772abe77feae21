"""The table `[session]` of a file: conditions, training and its criterion, forms. No I/O except reading it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.summary import summarise, value_at
from deltaswarm_orchestrator.scenarios.load import read_toml
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.questions import FormSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.task import JudgementTask
from deltaswarm_scenario.technique import Technique
from deltaswarm_scenario.techniques import measures
from deltaswarm_sessions import MAX_PARTICIPANT
from deltaswarm_sessions.exclusion import ExclusionSettings
from deltaswarm_sessions.variables import MEASURES
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError, key
from deltaswarm_wire.reading import FILE_NAME_RULE, is_file_name

MAX_CONDITIONS = 50
TRAINING = "training"
RANDOM, IN_TURN = "random", "in turn"
CROSSED, OWN = "crossed", "own"
GO_ON, END = "go on", "end"
OPEN, REACHED, NOT_REACHED = "open", "reached", "not reached"
FIRST, EACH, LAST = "before", "between", "after"
"""When a form of the session is filled in."""


@dataclass(frozen=True)
class CriterionSettings:
    """The table `[session.training.criterion]`: training is repeated until a measure of a run is within its bounds."""

    metric: str = key("", "a column of runs.tsv, or a number in summary.json by its dotted name")
    at_least: float | None = key(None, "lower bound of the metric")
    at_most: float | None = key(None, "upper bound of the metric")
    max_runs: int = key(3, "complete training runs after which the training ends in any case", low=1, high=20)
    if_not_reached: str = key(GO_ON, "go on with the runs, or end the session", choices=(GO_ON, END))

    def problems(self) -> list[Problem]:
        """Check that there is a metric with bounds that a value can meet."""
        problems = []
        if not self.metric:
            problems.append(Problem("metric", "missing", "must be a column of runs.tsv or a name in summary.json"))
        if self.at_least is None and self.at_most is None:
            problems.append(Problem("at_least", "missing", "must be given, or at_most"))
        elif self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            problems.append(Problem("at_least", f"{self.at_least:g}", f"must be at most at_most, {self.at_most:g}"))
        return problems

    def problems_with(self, scenario: Scenario) -> list[Problem]:
        """Check that the training's runs have the metric."""
        measured = {variable.path for variable in MEASURES.values()}
        if self._path not in measured | {name for name, _ in flattened(summarise(Outcome(), scenario))}:
            known = f"must be a number in summary.json by its dotted name, or one of {', '.join(MEASURES)}"
            return [Problem("metric", repr(self.metric), known)]
        asked: list[Technique | type[Technique]] = [*scenario.operator.probes.techniques]
        asked += [JudgementTask] if scenario.operator.task.is_on else []
        if self._path in {measure.key for technique in asked for measure in technique.measures}:
            return []
        return [
            Problem(
                "metric", repr(self.metric), f"must be a number that the training's runs have; it lacks {one.needs}"
            )
            for one in (*measures(after_run=False), *measures(after_run=True))
            if one.key == self._path
        ]

    def value(self, run: Mapping[str, Any]) -> float | None:
        """Return the metric of a run, from its summary; None if the run has none."""
        value = value_at(run, self._path)
        return float(value) if isinstance(value, int | float) else None

    def outcome(self, values: Sequence[float | None]) -> str:
        """Return REACHED, NOT_REACHED or OPEN, which means: train again.

        `values`: the metric in each complete training run so far; None, which is within no bounds, if a run has none.
        """
        if any(map(self._is_met, values)):
            return REACHED
        return NOT_REACHED if len(values) >= self.max_runs else OPEN

    @property
    def bounds(self) -> str:
        ends = (("at least", self.at_least), ("at most", self.at_most))
        return " and ".join(f"{word} {bound:g}" for word, bound in ends if bound is not None)

    def _is_met(self, value: float | None) -> bool:
        return (
            value is not None
            and (self.at_least is None or value >= self.at_least)
            and (self.at_most is None or value <= self.at_most)
        )

    @property
    def _path(self) -> str:
        return MEASURES[self.metric].path if self.metric in MEASURES else self.metric


@dataclass(frozen=True)
class ConditionSettings:
    """A table `[[session.condition]]`, or `[session.training]`: one run."""

    label: str = key("", "its name, in folders and on the sheet; say nothing there that gives the question away")
    scenario: str = key("paper-25", "the scenario: a TOML file or a built-in one")
    set: tuple[str, ...] = key((), "scenario keys as key=value, as with `deltaswarm run --set`")

    def problems(self) -> list[Problem]:
        """Check the label, which becomes a folder's name."""
        if is_file_name(self.label):
            return []
        return [Problem("label", repr(self.label), FILE_NAME_RULE)]


@dataclass(frozen=True)
class TrainingSettings(ConditionSettings):
    criterion: CriterionSettings | None = key(None, "when training is enough; without it, there is one training run")


@dataclass(frozen=True)
class SessionFormSettings(FormSettings):
    """A table `[[session.form]]`: a form with the times of a session."""

    when: str = key(
        EACH, "before the training, after each run but the training, or after the last run", choices=(FIRST, EACH, LAST)
    )

    def at(self, when: str) -> FormSettings:
        """Return the form as a run has it, before it or after it."""
        return FormSettings(self.name, self.title, self.text, when, self.question)


@dataclass(frozen=True)
class SessionSettings:
    """The table `[session]` of a session's file or of a study's file."""

    seed: int = key(1, "the seeds of all runs are derived from it", low=0, high=2**63 - 1)
    speed: float = key(1.0, "simulated per wall second; 0: as fast as possible", low=0, high=1000)
    allocation: str = key(
        RANDOM,
        "random: participants take the rows of the design in an order drawn from the seed; in turn: 1, 2, ...",
        choices=(RANDOM, IN_TURN),
    )
    arrivals: str = key(
        CROSSED,
        "crossed: one stream of arrivals per condition, balanced over conditions and places; own: new ones each run",
        choices=(CROSSED, OWN),
    )
    arrival_sets: int = key(
        1,
        "with crossed: sets of streams; each group of participants gets the next one, and after the last the first",
        low=1,
        high=MAX_PARTICIPANT,
    )
    score: bool = key(True, "whether the page shows the score after a run with a task")
    consent: str = key("", "a text file that a participant must agree to before the first run")
    set: tuple[str, ...] = key((), "scenario keys of all runs, as key=value; a run's own set goes last")
    language: str = key("", "language of the page, as operator.page.language; a file is in the same folder")
    form: tuple[SessionFormSettings, ...] = key((), "forms that are filled in besides the runs")
    training: TrainingSettings = key(
        TrainingSettings(TRAINING, "smoke"), "a run before the others, the same for everybody"
    )
    exclude: ExclusionSettings = key(ExclusionSettings(), "bounds beyond which the tables mark a run")
    condition: tuple[ConditionSettings, ...] = key((), "the runs, whose order is balanced over participants")

    def problems(self) -> list[Problem]:
        """Check the number of conditions, and that their labels differ."""
        labels = [condition.label for condition in (self.training, *self.condition)]
        problems = []
        if not 1 <= len(self.condition) <= MAX_CONDITIONS:
            allowed = f"must be 1 to {MAX_CONDITIONS} tables [[session.condition]]"
            problems.append(Problem("condition", f"{len(self.condition)}", allowed))
        if self.arrivals == OWN and self.arrival_sets != 1:
            problems.append(Problem("arrival_sets", f"{self.arrival_sets}", "must be 1, since arrivals are own"))
        if len(set(labels)) < len(labels):
            problems.append(Problem("condition", ", ".join(labels), "must have different labels"))
        forms = [form.name for form in self.form]
        if len(set(forms)) < len(forms):
            problems.append(Problem("form", ", ".join(forms), "must have different names"))
        return problems


def load_session(file: str) -> tuple[SessionSettings, Path]:
    """Load a session from a file; return it with the folder that its paths start from."""
    table, path = read_toml("session", file, {})
    assert path is not None
    if "session" not in table:
        raise SettingsError([Problem("session", "missing", "must be a table [session]")])
    return checked.load(SessionSettings, table["session"], "session"), path.parent
