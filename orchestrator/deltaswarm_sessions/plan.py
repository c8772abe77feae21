"""What one participant does: conditions and streams of arrivals in a balanced order, and the scenario of each run.

Orders are rows of a Williams design, a Latin square balanced for carry-over effects: over the rows, each condition
occurs equally often at each place, and equally often directly after each other condition (Williams 1949). Streams are
crossed with it: over two passes through the rows, each stream occurs equally often with each condition and at each
place, so that the effects of stream, place and condition can be told apart. No I/O except reading files.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import tomli_w

from deltaswarm_orchestrator.base.exits import aligned
from deltaswarm_orchestrator.scenarios import BUILT_IN
from deltaswarm_orchestrator.scenarios import load as scenarios
from deltaswarm_scenario.operator_settings import begun_with
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.technique import AFTER, BEFORE
from deltaswarm_sessions import MAX_PARTICIPANT
from deltaswarm_sessions.settings import (
    CROSSED,
    EACH,
    END,
    FIRST,
    LAST,
    MAX_CONDITIONS,
    RANDOM,
    ConditionSettings,
    CriterionSettings,
    SessionSettings,
)
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.plugins import find_controller
from deltaswarm_wire.reading import read_text
from deltaswarm_wire.seeds import agent_seed

MAX_RUNS = (MAX_PARTICIPANT + 2) * (MAX_CONDITIONS + 1)
MAX_SEED = 2**53
"""Seeds stay below it, so that programs that read numbers as floating point lose no digit."""

OUTLINE = ("run", "scenario", "simulated s", "wall min", "asks")
"""Columns of the table that `--dry-run` prints."""

MORE = "Please wait: the next run follows by itself."
WAIT = "Please wait."
THANKS = "Thank you: that was the last run."
SCORE_NEXT = "Your score comes next."

DEFAULTS = (
    "operator.page.pace=false",
    "operator.page.hold_while_away=true",
    "operator.probes.isa_jitter_s=30",
)
"""Scenario keys of all runs, which a condition's `set` may change.

A participant must not pause or speed up a run, miss part of it, nor foresee a question.
"""


class Placed(NamedTuple):
    """A condition and a stream of arrivals, by number from 0."""

    condition: int
    stream: int


def square(count: int) -> list[list[int]]:
    """Return the rows of a Williams design of `count` conditions: `count` rows if that is even, else twice as many."""
    first = [0, *(place // 2 + 1 if place % 2 == 0 else count - place // 2 - 1 for place in range(count - 1))]
    rows = [[(condition + shift) % count for condition in first] for shift in range(count)]
    return rows if count % 2 == 0 else rows + [row[::-1] for row in rows]


def group_of(count: int, *, is_crossed: bool) -> int:
    """Return how many participants do every order of `count` conditions equally often; with crossed streams, these too.

    Recruit participants in multiples of it.
    """
    return len(square(count)) * (2 if is_crossed else 1)


def order_of(participant: int, count: int, seed: int | None = None) -> list[Placed]:
    """Return what a participant (1, 2, ...) does, in order.

    Each pass through the rows is in an order drawn from `seed`; without a seed, participants take the rows in turn.
    """
    rows = square(count)
    cycle, place = divmod(participant - 1, len(rows))
    numbers = list(range(len(rows)))
    if seed is not None:
        Random(f"deltaswarm/{seed}/allocation/{cycle}").shuffle(numbers)
    row = numbers[place]
    return [Placed(condition, (condition + row + cycle) % count) for condition in rows[row]]


class Place(NamedTuple):
    """The place of a run in the order of a participant."""

    condition: ConditionSettings
    stream: int | None
    """The stream of arrivals; None: one of its own."""
    number: int
    """The number from which the run's seed is derived."""


def places_of(settings: SessionSettings, participant: int) -> list[Place]:
    """Return a participant's runs in order, the training first."""
    count, is_crossed = len(settings.condition), settings.arrivals == CROSSED
    order = order_of(participant, count, settings.seed if settings.allocation == RANDOM else None)
    streams_set = (participant - 1) // group_of(count, is_crossed=True) % settings.arrival_sets
    first = (streams_set if is_crossed else participant) * (MAX_CONDITIONS + 1)
    places = [Place(settings.training, None, 0)]  # all train with the same arrivals
    for place, (index, stream) in enumerate(order, 1):
        condition = settings.condition[index]
        if is_crossed:
            places.append(Place(condition, stream + streams_set * count, first + stream + 1))
        else:
            places.append(Place(condition, None, first + place))
    return places


@dataclass(frozen=True)
class PlannedRun:
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
        scenario = replace(self.scenario, seed=seed_of(*self.seeds, number))
        if not is_repeat:
            return scenario
        probes = scenario.operator.probes
        forms = tuple(form for form in probes.form if form.name not in self.once)
        probes = replace(probes, consent="", form=forms)
        return replace(scenario, operator=replace(scenario.operator, probes=probes))


def run_folder(place: int, label: str) -> str:
    return f"{place}-{label.replace(' ', '-')}"


def _override(key: str, value: Any) -> str:
    """Return what sets a key, with any character in it."""
    return f"{key}={tomli_w.dumps({'value': value}).partition('=')[2].strip()}"


def plan(settings: SessionSettings, participant: int, beside: Path = Path()) -> list[PlannedRun]:
    """Plan all runs of a participant, the training first; relative paths start at `beside`."""
    count, criterion = len(settings.condition), settings.training.criterion
    consent = _text(settings.consent, beside)
    runs = []
    for place, (condition, stream, number) in enumerate(places_of(settings, participant)):
        name, label = condition.scenario, condition.label
        if name not in BUILT_IN:
            name = str((beside / name).resolve())
        ends = criterion is not None and criterion.if_not_reached == END and place == 0
        end_text = THANKS if place == count else WAIT if ends else MORE
        shown = {"title": label, "place": [place, count], "end_text": end_text}
        if settings.language:
            shown["language"] = scenarios.language_at(settings.language, beside)
        sheet = {"participant": f"P{participant:03}", "condition": f"{place} {label}", "consent": consent}
        overrides = [
            *DEFAULTS,
            *(_override(f"operator.page.{key}", value) for key, value in shown.items()),
            *settings.set,
            *condition.set,
            *(_override(f"operator.probes.{key}", value) for key, value in sheet.items()),
        ]
        scenario = scenarios.load_scenario(name, overrides, seed_of(settings.seed, number, 1))
        scenario = _with_forms(scenario, settings, is_first=place == 0, is_last=place == count)
        if settings.score and scenario.operator.task.is_on and scenario.operator.page.end_text == end_text:
            scenario = with_end_text(scenario, SCORE_NEXT)
        run = PlannedRun(
            label, run_folder(place, label), scenario, place, stream, (settings.seed, number), condition.set
        )
        if place == 0:
            once = tuple(form.name for form in settings.form if form.when == FIRST)
            run = replace(run, once=once, criterion=_checked(criterion, scenario))
        runs.append(run)
        consent = ""  # asked for once
    return runs


def with_end_text(scenario: Scenario, end_text: str) -> Scenario:
    """Return the scenario with what its page says at the end."""
    operator = scenario.operator
    return replace(scenario, operator=replace(operator, page=replace(operator.page, end_text=end_text)))


def after_score(scenario: Scenario) -> Scenario:
    """Return the scenario of a page that follows a run: what was said to come next has come."""
    page = scenario.operator.page
    if page.end_text != SCORE_NEXT:
        return scenario
    return with_end_text(scenario, THANKS if page.place[0] == page.place[1] else MORE)


def _checked(criterion: CriterionSettings | None, training: Scenario) -> CriterionSettings | None:
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


def seed_of(seed: int, number: int, attempt: int) -> int:
    return agent_seed(seed, number + (attempt - 1) * MAX_RUNS) % MAX_SEED


def _text(name: str, beside: Path) -> str:
    if not name:
        return ""
    try:
        return read_text(beside / name)
    except (OSError, ValueError) as error:
        raise SettingsError([Problem("session.consent", repr(name), f"must be a text file: {error}")]) from None


def order_warning(planned: Sequence[PlannedRun]) -> str | None:
    """Return a warning if the page offers an order that sets what the conditions vary; None if it does not."""
    values: dict[tuple[str, str], set[object]] = {}
    for run in planned:
        control = run.scenario.control
        forms = begun_with(forms_of(find_controller(control.mode)), control.options)
        for form in run.scenario.for_operator(forms, 1.0).offered if run.position else ():
            for argument in form.arguments:
                values.setdefault((form.name, argument.name), set()).add(argument.default)
    found = next((names for names, defaults in values.items() if len(defaults) > 1), None)
    return found and (
        f"the conditions vary {found[1]}, which the participant reads and can change in the order {found[0]!r}: "
        'operator.page.orders = ["none"], or a list without it, leaves it out'
    )


def outline(settings: SessionSettings, planned: Sequence[PlannedRun], *, is_concealed: bool) -> dict[str, Any]:
    """Return what a session asks of a participant: runs, their length, questions and forms.

    `is_concealed`: leave the runs in the order of the file; the experimenter must not know the participant's.
    """
    runs = list(planned)
    if is_concealed:
        labels = [condition.label for condition in settings.condition]
        runs[1:] = sorted(runs[1:], key=lambda run: labels.index(run.label))
    rows = [_row(run.label, run.scenario, settings.speed) for run in runs]
    minutes = [row["wall_min"] for row in rows]
    count, is_crossed = len(settings.condition), settings.arrivals == CROSSED
    return {
        "runs": rows,
        "is_order_concealed": is_concealed,
        "training_runs_at_most": settings.training.criterion.max_runs if settings.training.criterion else 1,
        "wall_min": None if None in minutes else sum(minutes),
        "forms": {form.name: form.when for form in settings.form},
        "group": group_of(count, is_crossed=is_crossed),
        "streams": count * settings.arrival_sets if is_crossed else None,
    }


def outline_text(outlined: dict[str, Any]) -> str:
    rows = [
        (row["label"], row["scenario"], f"{row['simulated_s']:g}", _minutes(row["wall_min"]), "; ".join(row["asks"]))
        for row in outlined["runs"]
    ]
    lines = [aligned([OUTLINE, *rows]), ""]
    if outlined["is_order_concealed"]:
        lines.append("The order of the runs after the training is shown once the session has begun.")
    if forms := ", ".join(f"{name} ({when})" for name, when in outlined["forms"].items()):
        lines.append(f"Forms of the session: {forms}.")
    if (most := outlined["training_runs_at_most"]) > 1:
        lines.append(f"Training: until the criterion is reached, at most {most} runs.")
    lines.append(f"Recruit participants in groups of {outlined['group']}, which do every order equally often.")
    if (streams := outlined["streams"]) is not None:
        lines.append(
            f"Streams of arrivals: {streams}. A measure of the swarm that nobody commands has n = {streams} per "
            "condition, however many participants there are; a measure of the person has one value per participant."
        )
    if outlined["wall_min"] is not None:
        lines.append(f"All runs take {outlined['wall_min']:.0f} min, besides questions, forms and repeated training.")
    return "\n".join(lines)


def _row(label: str, scenario: Scenario, speed: float) -> dict[str, Any]:
    return {
        "label": label,
        "scenario": scenario.name,
        "simulated_s": scenario.run.duration_s,
        "wall_min": scenario.run.duration_s / speed / 60 if speed else None,
        "asks": [
            *filter(None, (one.outline for one in scenario.operator.probes.techniques)),
            *(["task"] if scenario.operator.task.is_on else []),
        ],
    }


def _minutes(minutes: float | None) -> str:
    return "as fast as possible" if minutes is None else f"{minutes:.1f}"
