"""Answers about the situation are compared with the truth of their moment."""

import pytest

from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.situation import SITUATION, SituationRow, is_open, known, score
from deltaswarm_scenario.technique import Recorded, Seen
from deltaswarm_scenario.truth import COLUMNS, EventState, StepRecord
from tests.support.tiers import in_one_test

ARENA = {"width_m": 100.0, "height_m": 60.0}


def event(number: int, x_m: float, y_m: float, arrived_s: float = 0.0, completed_s: float | None = None) -> EventState:
    return EventState(number, x_m, y_m, arrived_s, None, None, completed_s, 0.0)


def step(time_s: float, **truth: int) -> StepRecord:
    empty = dict.fromkeys(COLUMNS, 0)
    return StepRecord.of({**empty, "time_s": time_s, **truth})


def scored(
    answers: list[tuple[str, str]], events: list[EventState], known: str = "", **truth: int
) -> list[SituationRow]:
    """The rows of (item, value), asked at 4 s and shown at 10 s."""
    asked = {"probe": "sagat", "number": "2", "asked_s": "4.0", "ready_s": "10.0", "known": known}
    rows = [{**asked, "item": item, "value": value} for item, value in answers]
    rows.append({**asked, "probe": "isa", "item": "isa", "value": "3"})
    found = score(Recorded({"probes": rows}.get, [step(9.0), step(10.0, **truth), step(11.0)], events, **ARENA))
    assert found is not None
    return found


@in_one_test(
    ("item", "value", "truth", "is_right", "error"),
    [
        ("open_events", "7", "7", 1, 0.0),
        ("open_events", "9", "7", 0, 2.0),
        ("agents_in_trees", "12", "12", 1, 0.0),
        ("agents_in_trees", "10.5", "12", 0, -1.5),
        ("trees", "3", "3", 1, 0.0),
        ("trees", "2", "3", 0, -1.0),
        ("trees", "", "3", None, None),
        ("most_events", "top left", "top left", 1, None),
        ("most_events", "bottom left", "top left", 0, None),
        ("most_events", "", "top left", None, None),
    ],
)
def test_an_answer_is_compared_with_the_truth(
    item: str, value: str, truth: str, is_right: int | None, error: float | None
) -> None:
    rows = scored([(item, value)], [event(1, 10.0, 50.0)], events_open=7, agents_in_trees=12, trees=3)
    asked = ("sagat", 2, item, 10.0, value)
    assert [row._replace(chance=None) for row in rows] == [
        SituationRow(*asked, "", truth, None, None, is_right, error, None, None)
    ]


@in_one_test(
    ("item", "value", "known", "scores"),
    [
        ("open_events", "5", "5", (1, 0.0, 0, -2.0, 0, -2.0)),
        ("open_events", "7", "5", (0, 2.0, 1, 0.0, 0, -2.0)),
        ("open_events", "7", "7", (1, 0.0, 1, 0.0, 1, 0.0)),
        ("open_events", "", "7", (None, None, None, None, 1, 0.0)),
        ("most_events", "top right", "top left or top right", (1, None, 0, None, 0, None)),
        ("most_events", "top left", "top left", (1, None, 1, None, 1, None)),
    ],
)
def test_an_answer_is_right_by_what_the_page_showed(
    item: str, value: str, known: str, scores: tuple[float | None, ...]
) -> None:
    [row] = scored([(item, value)], [event(1, 10.0, 50.0)], known, events_open=7)
    assert row[7:13] == scores


def test_what_the_page_shows_is_known() -> None:
    seen = Seen([(10.0, 50.0), (90.0, 50.0), (80.0, 40.0)], [4, 4, 4, 7], 100.0, 60.0)
    assert [known(item, seen) for item in SITUATION] == ["3", "4", "2", "top right"]
    nothing = [known(item, Seen((), (), 100.0, 60.0)) for item in SITUATION]
    assert nothing == ["0", "0", "0", "top left or top right or bottom left or bottom right"]


@in_one_test(
    ("places", "truth"),
    [
        ([(10, 50)], "top left"),
        ([(90, 50)], "top right"),
        ([(10, 10)], "bottom left"),
        ([(90, 10)], "bottom right"),
        ([(50, 30)], "top right"),
        ([(49.9, 29.9)], "bottom left"),
        ([(50, 29.9)], "bottom right"),
        ([(49.9, 30)], "top left"),
        ([(10, 50), (90, 10)], "top left or bottom right"),
        ([(10, 50), (90, 10), (80, 20)], "bottom right"),
        ([], "top left or top right or bottom left or bottom right"),
    ],
)
def test_the_quarter_with_most_events(places: list[tuple[float, float]], truth: str) -> None:
    """The origin is at the bottom left; what is on the middle is at the right and at the top; several may be right."""
    [row] = scored([("most_events", "top left")], [event(at, x_m, y_m) for at, (x_m, y_m) in enumerate(places)])
    assert row.truth == truth
    assert row.is_true == ("top left" in truth)


@in_one_test(
    ("arrived_s", "completed_s", "is_counted"),
    [(9.0, None, True), (10.0, None, True), (10.5, None, False), (1.0, 10.0, False), (1.0, 10.5, True)],
)
def test_an_event_is_open_from_its_arrival_until_it_is_complete(
    arrived_s: float, completed_s: float | None, is_counted: bool
) -> None:
    one = event(1, 10.0, 50.0, arrived_s, completed_s)
    assert is_open(one, 10.0) == is_counted
    [row] = scored([("most_events", "top left")], [one, event(2, 90.0, 50.0)])
    assert row.truth == ("top left or top right" if is_counted else "top right")


def test_the_chance_level_is_that_of_the_most_frequent_answer() -> None:
    """Of the run's steps, without those at which several answers are right."""
    answer = {"probe": "spam", "number": "0", "asked_s": "10.0", "value": "1", "known": "", "outcome": "missed"}
    rows = [{**answer, "item": item} for item in ("trees", "most_events")]
    rows += [{**answer, "item": "trees", "outcome": "cut off by the end"}, {**answer, "item": "trees", "asked_s": ""}]
    steps = [step(7.0 + at, trees=trees) for at, trees in enumerate((1, 0, 1, 1))]
    events = [event(1, 10.0, 50.0), event(2, 90.0, 50.0, 9.0), event(3, 90.0, 50.0, 10.0)]
    found = score(Recorded({"probes": rows}.get, steps, events, **ARENA))
    assert found is not None
    assert [(row.item, row.chance) for row in found] == [("trees", 0.75), ("most_events", pytest.approx(2 / 3))]


def test_an_answer_of_an_unknown_moment_is_left_out() -> None:
    asked = {"probe": "spam", "number": "0", "item": "trees", "asked_s": "10.5", "value": "1"}
    assert score(Recorded({"probes": [asked]}.get, [step(10.0)], **ARENA)) == []
    assert score(Recorded({"probes": [{**asked, "probe": "isa"}]}.get, [step(10.0)], **ARENA)) is None
    assert score(Recorded({}.get, [step(10.0)], **ARENA)) is None


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_what_is_open_is_what_the_world_calls_open(step_s: float) -> None:
    scenario = load_scenario("smoke", ["run.duration_s=150", f"run.step_s={step_s}", "control.mode=decentralised"])
    outcome = run_in_process(scenario)
    assert any(record.events_completed for record in outcome.step_records)
    for record in outcome.step_records:
        assert sum(is_open(one, record.time_s) for one in outcome.events) == record.events_open
