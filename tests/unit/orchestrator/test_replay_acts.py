"""What a replay shows of a person's tables: acts by their time, each form once."""

from deltaswarm_orchestrator.recording.replay import acts_of

ACTION = {"time_s": "9.0", "by": "person", "name": "", "target": "", "value": "", "text": "", "event": ""}
ANSWER = {"asked_s": "5.0", "probe": "sagat", "number": "0"}


def test_a_form_is_one_act_and_what_only_tells_how_the_page_looks_is_none() -> None:
    """In the order of their times; an answer that is missing says so."""
    actions = [
        {**ACTION, "kind": "judge", "name": "decoy", "event": "3"},
        {**ACTION, "kind": "read"},
        {**ACTION, "kind": "page", "name": "zoom", "text": "4 px/m"},
        {**ACTION, "kind": "page", "name": "selected", "text": "event 3"},
        {**ACTION, "kind": "form"},
    ]
    answers = [{**ANSWER, "item": "trees", "value": "2"}, {**ANSWER, "item": "open_events", "value": ""}]
    assert acts_of(actions, answers) == [
        {"time_s": 5.0, "kind": "answer", "name": "sagat", "text": "trees: 2; open_events: no answer"},
        {"time_s": 9.0, "kind": "judge", "by": "person", "name": "decoy", "event": 3},
        {"time_s": 9.0, "kind": "page", "by": "person", "name": "selected", "text": "event 3"},
    ]
