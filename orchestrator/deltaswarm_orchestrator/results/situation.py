"""Compare answers about the situation (SAGAT, SPAM) with the truth of the moment: `situation.csv`."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.run_tables import read_rows, write_csv
from deltaswarm_scenario.operator_settings import SAGAT, SPAM
from deltaswarm_scenario.person_tables import SituationRow
from deltaswarm_scenario.questions import IN_TREES, MOST_EVENTS, OPEN_EVENTS, QUARTERS, TREES
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import EventState, StepRecord

SITUATION, PROBES = "situation.csv", "probes.csv"


def write_situation(folder: Path, outcome: Outcome, scenario: Scenario) -> None:
    """Write the table, if the person was asked about the situation."""
    answers = [row for row in read_rows(folder / PROBES) if row["probe"] in (SAGAT, SPAM)]
    if answers:
        rows = score(answers, outcome.step_records, outcome.events, scenario)
        write_csv(folder / SITUATION, SituationRow._fields, rows)


def score(
    answers: Iterable[Mapping[str, str]],
    records: Sequence[StepRecord],
    events: Sequence[EventState],
    scenario: Scenario,
) -> list[SituationRow]:
    """Score each answer against the truth at the end of the step of its question, if that is known."""
    by_time = {record.time_s: record for record in records}
    rows = []
    for answer in answers:
        record = by_time.get(float(answer["asked_s"]))
        if record is None:
            continue
        truths = _truths(answer["item"], record, events, scenario)
        value, is_number = answer["value"], answer["item"] != MOST_EVENTS
        error = float(value) - float(truths[0]) if value and is_number else None
        is_right = None if not value else int(error == 0) if is_number else int(value in truths)
        asked = (answer["probe"], int(answer["number"]), answer["item"], record.time_s)
        rows.append(SituationRow(*asked, value, " or ".join(truths), is_right, error))
    return rows


def _truths(item: str, record: StepRecord, events: Sequence[EventState], scenario: Scenario) -> list[str]:
    """Return the right answers: several quarters may have most events."""
    if item != MOST_EVENTS:
        number = {OPEN_EVENTS: record.events_open, IN_TREES: record.agents_in_trees, TREES: record.trees}[item]
        return [str(number)]
    counts = Counter(_quarter(event, scenario) for event in events if is_open(event, record.time_s))
    most = max(counts.values(), default=0)
    return [quarter for quarter in QUARTERS if counts[quarter] == most]


def is_open(event: EventState, time_s: float) -> bool:
    """Whether an event has arrived and is not complete at the end of a step, of this time."""
    return event.arrived_s <= time_s and (event.completed_s is None or event.completed_s > time_s)


def _quarter(event: EventState, scenario: Scenario) -> str:
    is_right, is_top = event.x_m >= scenario.arena.width_m / 2, event.y_m >= scenario.arena.height_m / 2
    return QUARTERS[2 * (not is_top) + is_right]
