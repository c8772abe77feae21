"""The table of the page's messages: who may send them, and what their fields may be."""

import json
from typing import Any

import pytest

from deltaswarm_operator.core.intents import INTENTS
from deltaswarm_scenario import page_messages
from deltaswarm_scenario.page_messages import CONDUCTOR, FROM_PAGE, PARTICIPANT, RefusedError, answers, checked, made
from tests.support.tiers import in_one_test

RIGHT: dict[str, dict[str, Any]] = {
    "command": {"name": "go", "target": {"kind": "all"}},
    "judge": {"event": 1, "answer": "target"},
    "help": {"state": "asked"},
    "isa": {"number": 0, "answer": 3},
    "tlx": {"scales": {}},
    "form": {"form": "trust", "answers": {}},
    "ready": {"form": "spam", "number": 0},
    "note": {"text": "x"},
    "page": {"event": "opened"},
    "sheet": {"consent": True},
    "seek": {"time_s": 4},
}


def test_the_console_carries_out_what_participant_and_conductor_may_send() -> None:
    assert INTENTS.keys() == {kind for kind, form in FROM_PAGE.items() if {PARTICIPANT, CONDUCTOR} & {*form.pages}}


@pytest.mark.parametrize("page", page_messages.EVERYBODY)
@pytest.mark.parametrize("kind", FROM_PAGE)
def test_a_page_is_answered_whatever_it_sends(page: str, kind: str) -> None:
    data = json.dumps({"type": kind, "from": 7, "extra": 1, **RIGHT.get(kind, {})}).encode()
    carried_out: list[Any] = []

    def carry_out(message: dict[str, Any]) -> list[Any]:
        carried_out.append(message)
        return []

    said = answers(data, page, carry_out)
    if page in FROM_PAGE[kind].pages:
        assert said == []
        assert carried_out == [{"type": kind, "from": 7, **RIGHT.get(kind, {})}]
    else:
        why = page_messages.WHY_NOT[page]
        assert said == ([] if FROM_PAGE[kind].is_notice else [{"type": "refused", "to": 7, "id": kind, "why": why}])
        assert not carried_out


@in_one_test(
    ("kind", "field", "value", "why"),
    [
        ("isa", "answer", 6, "an integer from 1 to 5"),
        ("isa", "answer", True, "an integer from 1 to 5"),
        ("isa", "answer", 2.0, "an integer from 1 to 5"),
        ("pace", "speed", 1000.5, "a number from -1,000 to 1,000"),
        ("pace", "paused", 1, "true or false"),
        ("note", "text", "\ud800", "must be text"),
        ("note", "text", None, "must have the field text"),
        ("read", "items", [1, 2.5], "a list of integers"),
        ("command", "target", "all", "an object"),
    ],
)
def test_a_wrong_field_is_named(kind: str, field: str, value: Any, why: str) -> None:
    with pytest.raises(RefusedError, match=why) as refused:
        checked({"type": kind, **RIGHT.get(kind, {}), field: value})
    assert field in str(refused.value)
    assert refused.value.what == kind


def test_long_texts_are_cut() -> None:
    assert checked({"type": "note", "text": "a" * 3000})["text"] == "a" * 2000


def test_a_message_to_the_page_has_the_fields_of_its_type() -> None:
    told = {"inbox": (), "counts": (), "read": [1], "history": ()}
    assert made("catch_up", to=3, read=[1]) == {"type": "catch_up", "to": 3, **told}
    for kind, fields in (("read", {}), ("read", {"items": [], "more": 1}), ("act", {"acts": []})):
        with pytest.raises(TypeError, match=kind):
            made(kind, **fields)
