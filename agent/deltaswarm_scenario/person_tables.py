"""Rows of the tables about a person at the console: what was done, asked, shown and read, and when.

Each column has its unit and meaning beside it, from which the data dictionary is made. Times in `_s` are simulated
unless the unit says wall; `utc` is the wall clock, `monotonic_s` a clock that no correction of the wall clock moves.
"""

from typing import Annotated, Any, NamedTuple, get_args, get_type_hints


class Column(NamedTuple):
    """The unit of a column, if it has one, and its meaning."""

    unit: str
    meaning: str


Utc = Annotated[str, Column("", "the same by the wall clock, in UTC to the millisecond; empty: no person was there")]
_MONOTONIC = "wall s"

PERSON, SIMULATED, SCRIPT, SYSTEM, CONDUCTOR = "person", "simulated", "script", "system", "conductor"


class OperatorAction(NamedTuple):
    """An act at the console, in `actions.csv`."""

    time_s: Annotated[float, Column("s", "time of the newest closed step at the act")]
    kind: Annotated[str, Column("", "command, proposal, veto, judge, read, pace, isa, tlx, form, note, sheet or page")]
    by: Annotated[str, Column("", "who acted: person, simulated, script, system or (the experiment's) conductor")] = (
        PERSON
    )
    utc: Utc = ""
    monotonic_s: Annotated[float | None, Column(_MONOTONIC, "time of the act")] = None
    name: Annotated[
        str, Column("", "the command; target or decoy; pause, resume, step or speed; what happened to the page")
    ] = ""
    command: Annotated[int | None, Column("", "number of the command")] = None
    target: Annotated[str, Column("", "whom the command is for: all, circle, tree, agent or place")] = ""
    agent: Annotated[int | None, Column("", "the agent, or the root of the tree, that the command is for")] = None
    x_m: Annotated[float | None, Column("m", "place of the command")] = None
    y_m: Annotated[float | None, Column("m", "place of the command")] = None
    radius_m: Annotated[float | None, Column("m", "radius of the circle that the command is for")] = None
    life_s: Annotated[float | None, Column("s", "how long agents pass the command on")] = None
    arguments: Annotated[str, Column("", "arguments of the command, as a JSON object")] = ""
    value: Annotated[
        float | None, Column("", "a command's first argument, delta, the speed, the steps or the answer")
    ] = None
    items: Annotated[str, Column("", "numbers of the items that were read, separated by spaces")] = ""
    event: Annotated[int | None, Column("", "number of the event that was judged, as on the page")] = None
    text: Annotated[str, Column("", "a note, the participant and condition of a sheet, or details of the page")] = ""
    page: Annotated[int | None, Column("", "number of the page that acted, in the order in which pages opened")] = None


class ProbeRow(NamedTuple):
    """An answer, or its absence, in `probes.csv`."""

    probe: Annotated[str, Column("", "the question: isa, tlx, sagat, spam, or the name of a form")]
    number: Annotated[int, Column("", "number of the question among those of its kind, from 0")]
    item: Annotated[str, Column("", "isa, a scale of NASA-TLX or its weight, or the name of a form's question")]
    value: Annotated[str | float | None, Column("", "the answer; empty: none was given")]
    asked_s: Annotated[float, Column("s", "time of the question")]
    latency_s: Annotated[float | None, Column(_MONOTONIC, "time until the answer, for isa and spam without pauses")]
    asked_utc: Utc = ""
    asked_monotonic_s: Annotated[float | None, Column(_MONOTONIC, "time of the question")] = None
    answered_utc: Utc = ""
    answered_monotonic_s: Annotated[float | None, Column(_MONOTONIC, "time of the answer")] = None


class SituationRow(NamedTuple):
    """An answer about the situation beside the truth, in `situation.csv`."""

    probe: Annotated[str, Column("", "sagat or spam")]
    number: Annotated[int, Column("", "number of the question, as in probes.csv")]
    item: Annotated[str, Column("", "what was asked")]
    asked_s: Annotated[float, Column("s", "time of the question")]
    answer: Annotated[str, Column("", "the answer; empty: none was given")]
    truth: Annotated[str, Column("", "the right answer, or several with or between them")]
    is_right: Annotated[int | None, Column("", "1: the answer is right")]
    error: Annotated[float | None, Column("", "a number that was answered minus the right one")]


class JudgementRow(NamedTuple):
    """An event that was reported, and what the person judged it to be, in `judgements.csv`."""

    number: Annotated[int, Column("", "the event's number on the page")]
    event: Annotated[int, Column("", "the event in events.csv")]
    truth: Annotated[str, Column("", "its class: target or decoy")]
    answer: Annotated[str, Column("", "the last judgement: target or decoy; empty: none")]
    answered_s: Annotated[float | None, Column("s", "time of the last judgement")]
    changes: Annotated[int, Column("", "how often the judgement was changed")]


class InboxRow(NamedTuple):
    """An item of the inbox, in `inbox.csv`."""

    item: Annotated[int, Column("", "number of the item, from 0")]
    time_s: Annotated[float, Column("s", "when the report arrived")]
    agent: Annotated[int, Column("", "its sender")]
    role: Annotated[str, Column("", "the sender's role")]
    followers: Annotated[int, Column("", "number of agents in the sender's tree, if it is a root")]
    events: Annotated[str, Column("", "numbers of its events as on the page, separated by spaces")]
    is_new: Annotated[int, Column("", "1: it names an unknown event, or its sender has become a root")]
    shown_utc: Utc = ""
    shown_monotonic_s: Annotated[float | None, Column(_MONOTONIC, "when it was first sent to the page")] = None
    read_s: Annotated[float | None, Column("s", "when it was read; empty: it was not")] = None
    read_utc: Utc = ""
    read_monotonic_s: Annotated[float | None, Column(_MONOTONIC, "when it was read")] = None


class CommandRow(NamedTuple):
    """What became of a command, in `commands.csv`."""

    command: Annotated[int, Column("", "number of the command")]
    name: Annotated[str, Column("", "the command")]
    sent_s: Annotated[float, Column("s", "when it was given")]
    heard: Annotated[int, Column("", "number of agents that reported that they know it")]
    done: Annotated[int, Column("", "number of agents that reported that they carried it out")]
    refused: Annotated[int, Column("", "number of agents that reported that they cannot carry it out")]
    superseded: Annotated[int, Column("", "number of agents that reported that a later command replaced it")]
    state: Annotated[str, Column("", "sent, heard, done or expired")]
    by: Annotated[str, Column("", "who gave it: person, simulated, script or system")]


class EventNumberRow(NamedTuple):
    """An event's two names, in `event_numbers.csv`."""

    number: Annotated[int, Column("", "the event's number on the page and in inbox.csv")]
    event: Annotated[int, Column("", "the event in events.csv")]


class WallTimeRow(NamedTuple):
    """The end of a step, in `wall_times.csv`."""

    step: Annotated[int, Column("", "the step")]
    time_s: Annotated[float, Column("s", "its time")]
    utc: Annotated[str, Column("", "when the operator closed it, in UTC to the millisecond")]
    monotonic_s: Annotated[float, Column(_MONOTONIC, "when the operator closed it")]


TABLES: dict[str, type[NamedTuple]] = {
    "actions": OperatorAction,
    "probes": ProbeRow,
    "situation": SituationRow,
    "judgements": JudgementRow,
    "inbox": InboxRow,
    "commands": CommandRow,
    "event_numbers": EventNumberRow,
    "wall_times": WallTimeRow,
}
"""All tables by name."""


def columns_of(table: type[NamedTuple]) -> dict[str, tuple[str, Column]]:
    """Return each column's type in words, and its unit and meaning."""
    found: dict[str, tuple[str, Column]] = {}
    for name, hint in get_type_hints(table, include_extras=True).items():
        plain, *notes = get_args(hint)
        (column,) = [note for note in notes if isinstance(note, Column)]
        found[name] = _TYPES[_first(plain)], column
    return found


_TYPES: dict[Any, str] = {int: "whole number", float: "number", str: "text"}


def _first(hint: Any) -> Any:
    return next(iter(get_args(hint)), hint)
