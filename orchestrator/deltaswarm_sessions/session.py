"""Sessions: which runs one participant does, in which order. No I/O except reading files."""

from dataclasses import dataclass, replace
from json import dumps
from pathlib import Path

from deltaswarm_orchestrator.scenarios import load as scenarios
from deltaswarm_scenario.questions import AFTER, BEFORE, FormSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions.design import order_of
from deltaswarm_sessions.training import END, CriterionSettings
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError, key
from deltaswarm_wire.seeds import agent_seed

MAX_CONDITIONS, MAX_PARTICIPANT = 50, 9999
MAX_RUNS = (MAX_PARTICIPANT + 2) * (MAX_CONDITIONS + 1)
TRAINING = "training"
MAX_SEED = 2**53
"""Seeds stay below it, so that programs that read numbers as floating point lose no digit."""

RANDOM, IN_TURN = "random", "in turn"
CROSSED, OWN = "crossed", "own"

MORE = "Please wait: the next run follows by itself."
WAIT = "Please wait."
THANKS = "Thank you: that was the last run."

DEFAULTS = ("operator.page.pace=false", "operator.probes.isa_jitter_s=30")
"""Scenario keys of all runs, which a condition's `set` may change.

A participant must not pause or speed up a run, nor foresee a question.
"""


@dataclass(frozen=True)
class ConditionSettings:
    """A table `[[session.condition]]`, or `[session.training]`: one run."""

    label: str = key("", "its name, in folders and on the sheet; say nothing there that gives the question away")
    scenario: str = key("paper-25", "the scenario: a TOML file or a built-in one")
    set: tuple[str, ...] = key((), "scenario keys as key=value, as with `deltaswarm run --set`")

    def problems(self) -> list[Problem]:
        """Check the label, which becomes a folder's name."""
        if self.label and self.label.isprintable() and "/" not in self.label and self.label.strip(" .") == self.label:
            return []
        return [Problem("label", repr(self.label), "must be a name that a folder can have")]


@dataclass(frozen=True)
class TrainingSettings(ConditionSettings):
    """The table `[session.training]`."""

    criterion: CriterionSettings | None = key(None, "when training is enough; without it, there is one training run")


FIRST, EACH, LAST = "before", "between", "after"


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
    consent: str = key("", "a text file that a participant must agree to before the first run")
    set: tuple[str, ...] = key((), "scenario keys of all runs, as key=value; a run's own set goes last")
    language: str = key("", "language of the page, as operator.page.language; a file is in the same folder")
    form: tuple[SessionFormSettings, ...] = key((), "forms that are filled in besides the runs")
    training: TrainingSettings = key(
        TrainingSettings(TRAINING, "smoke"), "a run before the others, the same for everybody"
    )
    condition: tuple[ConditionSettings, ...] = key((), "the runs, whose order is balanced over participants")

    def problems(self) -> list[Problem]:
        """Check the number of conditions, and that their labels differ."""
        labels = [condition.label for condition in (self.training, *self.condition)]
        problems = []
        if not 1 <= len(self.condition) <= MAX_CONDITIONS:
            allowed = f"must be 1 to {MAX_CONDITIONS} tables [[session.condition]]"
            problems.append(Problem("condition", f"{len(self.condition)}", allowed))
        if len(set(labels)) < len(labels):
            problems.append(Problem("condition", ", ".join(labels), "must have different labels"))
        forms = [form.name for form in self.form]
        if len(set(forms)) < len(forms):
            problems.append(Problem("form", ", ".join(forms), "must have different names"))
        return problems


@dataclass(frozen=True)
class PlannedRun:
    """One run of a participant."""

    label: str
    """The condition's label."""
    folder: str
    """The folder's name."""
    scenario: Scenario
    """That of the first attempt."""
    position: int
    """Its place among the participant's runs; the training is 0."""
    stream: int | None
    """The stream of arrivals; None: one of its own."""
    seeds: tuple[int, int]
    """The session's seed, and the number from which the run's seed is derived."""
    set: tuple[str, ...] = ()
    """The condition's own scenario keys."""
    once: tuple[str, ...] = ()
    """Names of forms that are not filled in again, once the run is complete."""
    criterion: CriterionSettings | None = None
    """When the run need not be done again; None: once it is complete."""

    def attempt(self, number: int, *, is_repeat: bool = False) -> Scenario:
        """Return the scenario of an attempt (1, 2, ...): a repeated run has other arrivals.

        `is_repeat`: an earlier attempt is complete, so consent and the forms before the session are not asked for.
        """
        scenario = replace(self.scenario, seed=_seed(*self.seeds, number))
        if not is_repeat:
            return scenario
        probes = scenario.operator.probes
        forms = tuple(form for form in probes.form if form.name not in self.once)
        probes = replace(probes, consent="", form=forms)
        return replace(scenario, operator=replace(scenario.operator, probes=probes))


def plan(settings: SessionSettings, participant: int, beside: Path = Path()) -> list[PlannedRun]:
    """Plan all runs of a participant, the training first; relative paths start at `beside`.

    Raises:
        SettingsError: a scenario is invalid, or the consent text cannot be read.
    """
    count, criterion = len(settings.condition), settings.training.criterion
    order = order_of(participant, count, settings.seed if settings.allocation == RANDOM else None)
    runs_of = [(settings.training, None), *((settings.condition[index], stream) for index, stream in order)]
    consent = _text(settings.consent, beside)
    runs = []
    for place, (condition, stream) in enumerate(runs_of):
        name, label = condition.scenario, condition.label
        if name not in scenarios.BUILT_IN:
            name = str((beside / name).resolve())
        sheet = {"participant": f"P{participant:03}", "condition": f"{place} {label}", "consent": consent}
        ends = criterion is not None and criterion.if_not_reached == END and place == 0
        shown = {"title": label, "end_text": THANKS if place == count else WAIT if ends else MORE}
        if settings.language:
            shown["language"] = scenarios.language_at(settings.language, beside)
        overrides = [
            *DEFAULTS,
            *(f"operator.page.{key}={dumps(value)}" for key, value in shown.items()),
            *settings.set,
            *condition.set,
        ]
        overrides += [f"operator.probes.{key}={dumps(value)}" for key, value in sheet.items()]
        if place == 0:
            number = 0  # all train with the same arrivals
        elif settings.arrivals == CROSSED and stream is not None:
            number = stream + 1
        else:
            number, stream = participant * (MAX_CONDITIONS + 1) + place, None
        scenario = scenarios.load_scenario(name, overrides, _seed(settings.seed, number, 1))
        scenario = _with_forms(scenario, settings, is_first=place == 0, is_last=place == count)
        folder = f"{place}-{label.replace(' ', '-')}"
        run = PlannedRun(label, folder, scenario, place, stream, (settings.seed, number), condition.set)
        if place == 0:
            run = replace(
                run,
                once=tuple(form.name for form in settings.form if form.when == FIRST),
                criterion=_checked(criterion, scenario),
            )
        runs.append(run)
        consent = ""  # asked for once
    return runs


def _checked(criterion: CriterionSettings | None, training: Scenario) -> CriterionSettings | None:
    """Return the criterion. Raises SettingsError: the training's runs have no such metric."""
    if criterion and (problems := criterion.problems_with(training)):
        raise SettingsError([replace(p, path=f"session.training.criterion.{p.path}") for p in problems])
    return criterion


def _with_forms(scenario: Scenario, settings: SessionSettings, *, is_first: bool, is_last: bool) -> Scenario:
    """Add the session's forms that are filled in before or after this run."""
    times = {FIRST: BEFORE if is_first else None, EACH: None if is_first else AFTER, LAST: AFTER if is_last else None}
    forms = tuple(form.at(when) for form in settings.form if (when := times[form.when]))
    probes = replace(scenario.operator.probes, form=scenario.operator.probes.form + forms)
    if problems := probes.problems():
        raise SettingsError(problems)
    return replace(scenario, operator=replace(scenario.operator, probes=probes))


def _seed(seed: int, number: int, attempt: int) -> int:
    """Derive the seed of an attempt at a run."""
    return agent_seed(seed, number + (attempt - 1) * MAX_RUNS) % MAX_SEED


def _text(name: str, beside: Path) -> str:
    if not name:
        return ""
    try:
        return (beside / name).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise SettingsError([Problem("session.consent", repr(name), f"must be a text file: {error}")]) from None


def load_session(file: str) -> tuple[SessionSettings, Path]:
    """Load a session from a file; return it with the folder that its paths start from.

    Raises:
        SettingsError: it lists every mistake in the file.
    """
    table, path = scenarios.read_toml("session", file, {})
    assert path is not None
    if "session" not in table:
        raise SettingsError([Problem("session", "missing", "must be a table [session]")])
    return checked.load(SessionSettings, table["session"], "session"), path.parent
