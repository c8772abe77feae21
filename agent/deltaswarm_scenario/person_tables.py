"""Rows of the tables about a person at the console: what was done, asked, shown and read, and when.

Each column has its unit and meaning beside it, from which the data dictionary is made. Times in `_s` are simulated
unless the unit says wall; `utc` is the wall clock, `monotonic_s` a clock that no correction of the wall clock moves.
"""

from typing import Annotated, Any, NamedTuple

from deltaswarm_scenario.columns import MONOTONIC, PAGE, Column, Utc
from deltaswarm_scenario.operator_settings import CHANGE, INFO, NEWS
from deltaswarm_scenario.techniques import NAMED, SCORED, TECHNIQUES

_ANSWERS = dict.fromkeys(technique.kind for technique in TECHNIQUES)
_KINDS = ("command", "proposal", "veto", "read", "pace", "note", "help", "end", "ready", *_ANSWERS)

PERSON, SIMULATED, SCRIPT, SYSTEM, CONDUCTOR = "person", "simulated", "script", "system", "conductor"


class OperatorAction(NamedTuple):
    """An act at the console, in `actions.csv`."""

    time_s: Annotated[float, Column("s", "time of the newest closed step at the act")]
    kind: Annotated[str, Column("", ", ".join(_KINDS) + " or page")]
    by: Annotated[str, Column("", "who acted: person, simulated, script, system or (the experiment's) conductor")] = (
        PERSON
    )
    utc: Utc = ""
    monotonic_s: Annotated[float | None, Column(MONOTONIC, "time of the act")] = None
    name: Annotated[
        str,
        Column(
            "",
            "the command; target or decoy; pause, resume, step or speed; help asked, seen or over; what happened to "
            "the page",
        ),
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
    input: Annotated[str, Column("", "id of the page's input, which counts once however often it was sent")] = ""
    page_s: Annotated[float | None, Column(PAGE, "time of the act")] = None
    delay_s: Annotated[
        float | None, Column(PAGE, "from the act until it was sent; above 0 if there was no connection")
    ] = None


class ProbeRow(NamedTuple):
    """An answer, or its absence, in `probes.csv`: each planned question has its rows."""

    probe: Annotated[str, Column("", f"the question: {', '.join(NAMED)}, or the name of a form")]
    number: Annotated[int, Column("", "number of the question among those of its kind, from 0")]
    item: Annotated[str, Column("", "isa, a scale of NASA-TLX or its weight, or the name of a form's question")]
    value: Annotated[str | float | None, Column("", "the answer; empty: none was given")]
    asked_s: Annotated[float | None, Column("s", "time of the question; empty: it was not asked")]
    latency_s: Annotated[
        float | None, Column(MONOTONIC, "time until the answer, without pauses unless the question holds the run")
    ]
    asked_utc: Utc = ""
    asked_monotonic_s: Annotated[float | None, Column(MONOTONIC, "time of the question")] = None
    answered_utc: Utc = ""
    answered_monotonic_s: Annotated[float | None, Column(MONOTONIC, "time of the answer")] = None
    shown_page_s: Annotated[float | None, Column(PAGE, "when the page first painted the question")] = None
    answered_page_s: Annotated[float | None, Column(PAGE, "time of the answer")] = None
    reaction_s: Annotated[float | None, Column(PAGE, "from `shown_page_s` to `answered_page_s`")] = None
    ready_s: Annotated[
        float | None, Column("s", "when the person was ready, and the question was shown; empty: there was no prompt")
    ] = None
    ready_latency_s: Annotated[
        float | None, Column(MONOTONIC, "time from the prompt until the person was ready, without pauses")
    ] = None
    ready_reaction_s: Annotated[float | None, Column(PAGE, "the same, from the frame that first showed it")] = None
    known: Annotated[
        str, Column("", "what the page showed at the question about the situation, or several with or between them")
    ] = ""
    planned_s: Annotated[float | None, Column("s", "time for which the question was planned")] = None
    late_s: Annotated[float | None, Column("s", "from `planned_s` to `asked_s`")] = None
    outcome: Annotated[
        str,
        Column(
            "",
            "answered; missed: its time to answer passed; cut off by the end or by a restart: there was time left; "
            "not asked, and why",
        ),
    ] = ""


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
    shown_monotonic_s: Annotated[float | None, Column(MONOTONIC, "when it was first sent to the page")] = None
    read_s: Annotated[float | None, Column("s", "when it was read; empty: it was not")] = None
    read_utc: Utc = ""
    read_monotonic_s: Annotated[float | None, Column(MONOTONIC, "when it was read")] = None
    news: Annotated[str, Column("", f"what it tells: {', '.join(NEWS)}")] = CHANGE
    severity: Annotated[str, Column("", "info, notice or alert")] = INFO
    shown_s: Annotated[float | None, Column("s", "when the inbox showed it; empty: it did not")] = None
    line: Annotated[int | None, Column("", "its line of the inbox: the number of the first item put on it")] = None
    is_quiet: Annotated[int | None, Column("", "1: its line only counts it, and did not ask to be read for it")] = None
    held_because: Annotated[str, Column("", "why it was not shown when it arrived; empty: it was")] = ""
    is_opened: Annotated[int, Column("", "1: the person opened it while it was held back")] = 0


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
    monotonic_s: Annotated[float, Column(MONOTONIC, "when the operator closed it")]


TABLES: dict[str, type[Any]] = {
    "actions": OperatorAction,
    "probes": ProbeRow,
    **{name: table.row for name, table in SCORED.items()},
    "inbox": InboxRow,
    "commands": CommandRow,
    "event_numbers": EventNumberRow,
    "wall_times": WallTimeRow,
}
"""All tables by name."""
