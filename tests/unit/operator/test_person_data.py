"""What a person at the console did, was asked and was shown: acts, answers, inbox, forms, and when."""

import csv
import hashlib
import json
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import page_hello
from deltaswarm_operator.io.action_log import ActionLog
from deltaswarm_orchestrator.results.run_tables import read_rows
from deltaswarm_scenario.situation import SITUATION
from tests.support.commanding import RIGHT, briefing, taken_over
from tests.unit.operator.test_console import attended, close, report, say, shown


def test_an_act_has_its_time_by_both_clocks(tmp_path: Path) -> None:
    """A pause of six seconds is two acts of one step; the wall clock's time is that of the act, not of the writing."""
    console = Console(briefing())
    console.attend()
    tables = ActionLog(tmp_path, has_station=True)
    close(console, 0)
    now = time.monotonic()
    tables.close_step(0, 0.0, now - 20.0)
    say(console, "pace", now - 16.0, paused=True)
    say(console, "pace", now - 10.0, paused=False)
    say(console, "command", now - 9.0, name="test", target={"kind": "tree", "root": 4}, arguments=RIGHT)
    tables.close(console)
    before = datetime.now(UTC)
    *acts, command = rows_of(tmp_path / "actions.csv")
    assert [(act["kind"], act["name"], act["time_s"], act["by"], act["page"]) for act in acts] == [
        ("pace", name, "0.0", "person", "3") for name in ("pause", "resume")
    ]
    moments = [datetime.fromisoformat(act["utc"]) for act in acts]
    assert (moments[1] - moments[0]).total_seconds() == pytest.approx(6.0, abs=0.002)
    assert (before - moments[1]).total_seconds() == pytest.approx(10.0, abs=5.0)
    assert (command["target"], command["agent"], command["x_m"]) == ("tree", "4", "")
    assert json.loads(command["arguments"]) == RIGHT
    [step] = rows_of(tmp_path / "wall_times.csv")
    assert float(acts[0]["monotonic_s"]) - float(step["monotonic_s"]) == pytest.approx(4.0)
    assert [row["command"] for row in rows_of(tmp_path / "commands.csv")] == [command["command"]]


def test_notes_and_answers_are_no_formulas(tmp_path: Path) -> None:
    form = {"name": "free", "when": "before", "question": [{"name": "t", "text": "?", "kind": "text"}]}
    console = attended(probes={"form": [form], "isa_every_s": 0})
    tables = ActionLog(tmp_path)
    say(console, "sheet", 1.0, consent=True)
    say(console, "form", 2.0, form="free", answers={"t": "=1+1"})
    say(console, "note", 3.0, text="@SUM(A1)")
    tables.close(console)
    assert rows_of(tmp_path / "probes.csv")[0]["value"] == "'=1+1"
    assert rows_of(tmp_path / "actions.csv")[-1]["text"] == "'@SUM(A1)"
    assert read_rows(tmp_path / "probes.csv")[0]["value"] == "=1+1"
    assert read_rows(tmp_path / "actions.csv")[-1]["text"] == "@SUM(A1)"


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_inbox_says_what_was_shown_and_read(tmp_path: Path) -> None:
    """And what was missed, though it was read late; after a restart of the operator too."""
    console = Console(briefing(operator={"person": {"patience_s": 10.0}}))
    console.attend()
    for step in range(30):
        close(console, step, *([report(step, step)] if step < 3 else []), wall_s=float(step))
        if step == 1:
            shown(console, 1.5)
    say(console, "read", 6.0, items=[0])
    other = taken_over(console, has_station=True)
    shown(other, 7.0)
    say(other, "read", 8.0, items=[2])
    person = other.totals["person"]
    assert (person["items"], person["read"], person["missed"], person["unread"]["last"]) == (3, 2, 3, 1)
    assert person["acknowledge_s"] == pytest.approx((29 + 27) / 2)
    assert person["utilisation"] is person["load"] is None
    ActionLog(tmp_path).close(other)
    inbox = rows_of(tmp_path / "inbox.csv")
    assert [row["shown_monotonic_s"] for row in inbox] == ["1.5", "1.5", "7.0"]
    assert [(row["read_s"], row["read_monotonic_s"]) for row in inbox] == [("29.0", "6.0"), ("", ""), ("29.0", "8.0")]
    numbers = {row["number"]: row["event"] for row in rows_of(tmp_path / "event_numbers.csv")}
    assert [numbers[row["events"]] for row in inbox] == ["1", "2", "3"]


def test_the_sheet_is_the_planned_one() -> None:
    """Nobody takes another's place, nobody orders before consent, and the text that was agreed to has a hash."""
    console = Console(briefing(operator={"probes": {"consent": "Please", "participant": "P001", "condition": "1 A"}}))
    console.start(0.0)
    [refused] = say(console, "command", name="go", target={"kind": "all"})
    assert refused["type"] == "refused"
    [refused] = say(console, "sheet", consent=True, participant="P999", condition="1 A")
    assert "P001" in refused["why"]
    assert console.pace.hold_step == 0
    assert not say(console, "sheet", 5.0, consent=True, participant="P001", condition="1 A")
    act = console.actions[-1]
    assert (act.kind, act.monotonic_s) == ("sheet", 5.0)
    assert hashlib.sha256(b"Please").hexdigest() in act.text


def test_a_run_may_leave_the_pace_and_orders_out() -> None:
    """The page offers them no more, and the console takes them from nobody."""
    console = Console(briefing(operator={"page": {"pace": False, "orders": ["go"], "title": "Run B"}}))
    hello = page_hello(console, "run")
    assert (hello["title"], hello["speeds"]) == ("Run B", ())
    assert [form["name"] for form in hello["commands"]] == ["go"]
    for intent in ({"paused": True}, {"speed": 5}, {"steps": 1}):
        assert say(console, "pace", **intent)[0]["type"] == "refused"
    assert say(console, "command", name="test", target={"kind": "all"}, arguments=RIGHT)[0]["type"] == "refused"
    assert say(console, "command", name="go", target={"kind": "all"})[0]["type"] == "accepted"


def test_a_run_is_held_for_questions_about_the_situation() -> None:
    """From the step on that closes at their time, until all is answered; whoever steps does not step past them."""
    numbers = [name for name, question in SITUATION.items() if question.kind == "number"]
    asks = {"sagat_at_s": [5.0, 8.0], "sagat_questions": numbers, "isa_every_s": 0}
    console = attended(probes=asks)
    assert console.pace.hold_step == 6
    assert shown(console)["pace"]["paused"] is False
    close(console, 0)
    say(console, "pace", steps=100)
    assert console.pace.hold_step == 6
    for step in range(1, 6):
        assert shown(console)["probe"] is None
        close(console, step)
    probe = shown(console)["probe"]
    assert (probe["kind"], probe["hides"], shown(console)["pace"]["paused"]) == ("form", True, True)
    assert say(console, "pace", paused=False)[0]["type"] == "refused"
    answers = {"open_events": 3, "agents_in_trees": 2, "trees": 1}
    for wrong in (
        {},
        {**answers, "trees": -1},
        {**answers, "most_events": "left"},
        {**answers, "more": 1},
        {**answers, "trees": True},
    ):
        assert say(console, "form", form="sagat", answers=wrong)[0]["type"] == "refused"
    assert not say(console, "form", 4.5, form="sagat", answers=answers)
    assert (console.pace.hold_step, shown(console)["probe"]) == (9, None)
    order = [question["name"] for question in probe["form"]["question"]]
    assert [(row.item, row.value, row.asked_s, row.latency_s) for row in console.probes.rows] == [
        (item, answers[item], 5.0, 4.5) for item in order
    ]
    for step in range(6, 9):
        close(console, step)
    other = taken_over(console, has_station=True)
    other.start(0.0)
    assert (other.pace.hold_step, shown(other)["probe"]) == (-1, None)
    assert [row.value for row in other.probes.rows] == [*(answers[item] for item in order), *[None] * 3]
    assert [row.value for row in other.probes.take_rows()] == [None] * 3
    assert other.probes.outcomes["questions_lost"] == 1


def test_a_question_that_waits_for_another_is_missing_after_a_restart_too() -> None:
    """The run was held for it while ISA was open: both have their rows, and the run goes on."""
    asks = {"probes": {"sagat_at_s": [5.0], "sagat_questions": ["trees"], "isa_every_s": 4}}
    console = attended(**asks)
    for step in range(6):
        close(console, step)
    assert shown(console)["probe"]["kind"] == "isa"
    other = taken_over(console, has_station=True)
    other.start(0.0)
    assert (other.is_held, shown(other)["probe"]) == (False, None)
    assert [(row.probe, row.value) for row in other.probes.rows] == [("isa", None), ("sagat", None)]
    assert (other.probes.outcomes["questions"], other.probes.outcomes["questions_lost"]) == (2, 2)


def test_questions_in_passing_let_the_run_go_on() -> None:
    """One question at a time, in a drawn order; not beside another, and missing after its time."""
    spam = {"spam_at_s": [2.0, 4.0, 6.0], "spam_questions": ["trees", "open_events"], "spam_wait_s": 10.0}
    spam |= {"spam_ready": False}
    console = attended(probes={**spam, "isa_every_s": 5})
    for step in range(3):
        close(console, step)
    probe = shown(console)["probe"]
    assert (probe["form"]["name"], probe["hides"], probe["left_s"]) == ("spam", False, 10.0)
    [first] = [question["name"] for question in probe["form"]["question"]]
    [second] = {"trees", "open_events"} - {first}
    assert (console.pace.hold_step, console.probes.holds_run) == (-1, False)
    assert not say(console, "form", 3.5, form="spam", answers={first: 2})
    for step in (3, 4, 5):
        close(console, step, wall_s=20.0)
    assert shown(console, 21.0)["probe"]["form"]["question"][0]["name"] == second
    assert say(console, "form", 40.0, form="spam", answers={second: 2})[0]["type"] == "refused"
    close(console, 6, wall_s=41.0)
    rows = [(row.probe, row.number, row.item, row.value, row.latency_s) for row in console.probes.rows]
    assert rows == [("spam", 0, first, 2, 3.5), ("spam", 1, second, None, None)]
    other = taken_over(console)
    assert [(row.probe, row.value) for row in other.probes.take_rows()] == [("spam", None)]


def test_nobody_is_asked_where_nobody_sits() -> None:
    """Without a station nothing would let the run go on; a station that goes releases it."""
    console = Console(briefing(operator={"probes": {"sagat_at_s": [2.0]}}))
    console.start(0.0)
    assert console.pace.hold_step == -1
    for step in range(5):
        close(console, step)
    assert shown(console)["probe"] is None


def test_forms_come_one_after_another() -> None:
    """Those before the run hold it, after the sheet; those after it come after NASA-TLX."""
    likert = {"name": "trust", "text": "I trust the swarm."}
    forms = [
        {"name": "you", "when": "before", "question": [{"name": "age", "text": "Age?", "kind": "number", "high": 99}]},
        {"name": "read", "when": "before", "text": "Your task is to watch."},
        {"name": "free", "when": "before", "question": [{"name": "t", "text": "?", "kind": "text", "required": False}]},
        {"name": "end", "when": "after", "question": [likert]},
    ]
    console = attended(probes={"consent": "Yes?", "tlx": True, "form": forms, "isa_every_s": 0})
    say(console, "sheet", 1.0, consent=True)
    assert shown(console)["probe"]["form"]["name"] == "you"
    assert say(console, "form", form="end", answers={"trust": 1})[0]["type"] == "refused"
    say(console, "form", 3.0, form="you", answers={"age": 30.5})
    assert console.pace.hold_step == 0
    assert shown(console)["probe"]["form"]["text"] == "Your task is to watch."
    assert not say(console, "form", 3.0, form="read", answers={})
    assert not say(console, "form", 4.0, form="free", answers={})
    assert console.pace.hold_step == -1
    close(console, 0, last=True)
    say(
        console,
        "tlx",
        scales=dict.fromkeys(("mental", "physical", "temporal", "performance", "effort", "frustration"), 5),
    )
    assert say(console, "form", form="end", answers={"trust": 8})[0]["type"] == "refused"
    say(console, "form", form="end", answers={"trust": 7})
    rows = [row for row in console.probes.rows if row.probe != "tlx"]
    assert [(row.probe, row.item, row.value, row.latency_s) for row in rows[:2]] == [
        ("you", "age", 30.5, 2.0),
        ("free", "t", None, 1.0),
    ]
    assert (rows[2].probe, rows[2].value) == ("end", 7)
    assert console.probes.outcomes["questions"] == 4


@pytest.mark.parametrize(("name", "holds"), [("spam", False), ("sagat", True)])
def test_an_answer_lets_only_a_run_go_on_that_was_held_for_it(name: str, holds: bool) -> None:
    asks = {"probes": {f"{name}_at_s": [2.0], f"{name}_questions": ["trees"], "isa_every_s": 0, "spam_ready": False}}
    console = attended(**asks)
    for step in range(3):
        close(console, step)
    if not holds:
        say(console, "pace", paused=True)
    assert console.is_held
    assert not say(console, "form", 1.0, form=name, answers={"trees": 2})
    assert console.is_held == (not holds)
