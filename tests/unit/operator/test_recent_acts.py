"""The conductor of an experiment: what is told of the participant, and what the conductor may do."""

import json
from typing import Any

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import CONDUCTOR_KIND, page_hello
from deltaswarm_operator.core.intents import INTENTS, carry_out
from deltaswarm_operator.core.recent_acts import RecentActs
from deltaswarm_scenario.person_tables import CONDUCTOR, OperatorAction, ProbeRow
from tests.support.commanding import briefing
from tests.unit.operator.test_console import close, report, say


def test_the_conductor_may_pause_note_help_and_end_and_nothing_else() -> None:
    """Also where the participant may not pause; acts are under the conductor's name, and mirror the participant's."""
    console = Console(briefing(operator={"page": {"pace": False}}))
    console.start(0.0)
    close(console, 0, report(1, 0))

    def conduct(kind: str, **intent: Any) -> list[dict[str, Any]]:
        return carry_out(console, json.dumps({"type": kind, "from": 1, **intent}).encode(), 0.0, CONDUCTOR)

    for kind in INTENTS.keys() - {"pace", "note", "help", "end", "catch_up", "held", "page", "beat"}:
        [refusal] = conduct(kind, items=[0], text="x", name="go", target={"kind": "all"})
        assert refusal["type"] == "refused", kind
    assert conduct("page", event="opened") == []
    assert not console.actions
    assert say(console, "pace", paused=True)[0]["type"] == "refused"
    assert conduct("pace", paused=True) == conduct("note", text="tired") == []
    assert console.is_held
    say(console, "read", items=[0])
    told = console.recent_acts.take(console.actions)
    assert [(act["kind"], act["by"]) for act in told] == [
        ("pace", "conductor"),
        ("note", "conductor"),
        ("read", "person"),
    ]
    assert conduct("catch_up")[0]["acts"] == told
    assert "acts" not in say(console, "catch_up")[0]
    hello = page_hello(console, "run", CONDUCTOR_KIND)
    assert hello["event_numbers"] == list(console.picture.event_numbers.items()) != []
    assert page_hello(console, "run")["event_numbers"] == ()


def test_a_call_for_help_is_for_the_conductor_who_says_that_somebody_comes() -> None:
    """It counts once, is in the table, and needs a conductor, without whom the page has no button for it."""
    console = Console(briefing())
    console.start(0.0)
    assert say(console, "help", state="asked")[0]["why"] == "nobody conducts this run"
    assert "help" not in page_hello(console, "run")["panels"]
    console.has_conductor = True
    assert "help" in page_hello(console, "run")["panels"]
    for _ in range(2):
        assert say(console, "help", state="asked", id="h") == [{"type": "noted", "to": 3, "id": "h"}]
    assert console.show(0.0)["help"] == "asked"
    assert say(console, "help", state="seen")[0]["type"] == "refused"
    seen = {"type": "help", "from": 1, "state": "seen"}
    assert carry_out(console, json.dumps(seen).encode(), 0.0, CONDUCTOR) == []
    assert console.show(0.0)["help"] == "seen"
    acts = [(act.by, act.name) for act in console.actions if act.kind == "help"]
    assert acts == [("person", "asked"), ("conductor", "seen")]


def test_the_conductor_is_told_of_a_form_once() -> None:
    """Its answers are rows of their own in the tables, and one act on the page."""
    acts = RecentActs().take(
        [
            OperatorAction(3.0, "form", name="you"),
            OperatorAction(4.0, "isa", value=2.0),
            ProbeRow("you", 0, "age", 30, 2.0, 1.0),
            ProbeRow("you", 0, "why", None, 2.0, 1.0),
            ProbeRow("isa", 0, "isa", 2, 3.0, 1.0),
            ProbeRow("isa", 1, "isa", None, 9.0, None),
        ]
    )
    assert [(act["kind"], act.get("name"), act.get("text")) for act in acts] == [
        ("answer", "you", "age: 30; why: no answer"),
        ("answer", "isa", "2"),
        ("answer", "isa", "no answer"),
    ]
