"""Sessions: which runs one participant does, in which order. No I/O except reading files.

The order is a row of a Williams design, a Latin square balanced for carry-over effects: over the rows, each condition
occurs equally often at each place, and equally often directly after each other condition (Williams 1949).
"""

from dataclasses import dataclass
from json import dumps
from pathlib import Path

from deltaswarm_orchestrator.scenarios import load as scenarios
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError, key
from deltaswarm_wire.seeds import agent_seed

MAX_CONDITIONS, MAX_PARTICIPANT = 50, 9999
TRAINING = "training"


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
class SessionSettings:
    """The table `[session]` of a session's file or of a study's file."""

    seed: int = key(1, "the seeds of all runs are derived from it", low=0, high=2**63 - 1)
    speed: float = key(1.0, "simulated per wall second; 0: as fast as possible", low=0, high=1000)
    consent: str = key("", "a text file that a participant must agree to before the first run")
    training: ConditionSettings = key(
        ConditionSettings(TRAINING, "smoke"), "a run before the others, the same for everybody"
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
        return problems


@dataclass(frozen=True)
class PlannedRun:
    """One run of a participant."""

    label: str
    """The condition's label."""
    folder: str
    """The folder's name."""
    scenario: Scenario


def square(count: int) -> list[list[int]]:
    """Return the rows of a Williams design of `count` conditions: `count` rows if that is even, else twice as many."""
    first = [0, *(place // 2 + 1 if place % 2 == 0 else count - place // 2 - 1 for place in range(count - 1))]
    rows = [[(condition + shift) % count for condition in first] for shift in range(count)]
    return rows if count % 2 == 0 else rows + [row[::-1] for row in rows]


def order_of(participant: int, count: int) -> list[int]:
    """Return the order in which a participant (1, 2, ...) does `count` conditions."""
    rows = square(count)
    return rows[(participant - 1) % len(rows)]


def plan(settings: SessionSettings, participant: int, beside: Path = Path()) -> list[PlannedRun]:
    """Plan all runs of a participant, the training first; relative paths start at `beside`.

    Raises:
        SettingsError: a scenario is invalid, or the consent text cannot be read.
    """
    order = order_of(participant, len(settings.condition))
    conditions = [settings.training, *(settings.condition[index] for index in order)]
    consent = _text(settings.consent, beside)
    runs = []
    for place, condition in enumerate(conditions):
        name, label = condition.scenario, condition.label
        if name not in scenarios.BUILT_IN:
            name = str((beside / name).resolve())
        sheet = {"participant": f"P{participant:03}", "condition": f"{place} {label}", "consent": consent}
        overrides = [*condition.set, *(f"operator.probes.{key}={dumps(value)}" for key, value in sheet.items())]
        scenario = scenarios.load_scenario(name, overrides, _seed(settings.seed, participant, place))
        runs.append(PlannedRun(label, f"{place}-{label.replace(' ', '-')}", scenario))
        consent = ""  # asked for once
    return runs


def _seed(seed: int, participant: int, place: int) -> int:
    """Derive a run's seed: all participants train with the same arrivals; every other run has its own."""
    return agent_seed(seed, 0 if place == 0 else participant * (MAX_CONDITIONS + 1) + place)


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
