"""Answers about the situation are compared with the truth of their moment."""

from deltaswarm_orchestrator.results.situation import is_open, score
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.questions import QUARTERS


def test_what_is_open_is_what_the_truth_calls_open() -> None:
    """In each step of a run, also where a step is half a second; each answer has one row with its error."""
    for step_s in (0.5, 1.0):
        scenario = load_scenario("smoke", ["run.duration_s=150", f"run.step_s={step_s}", "control.mode=decentralised"])
        outcome = run_in_process(scenario)
        records, events = outcome.step_records, outcome.events
        assert any(record.events_completed for record in records)
        for record in records:
            assert sum(is_open(event, record.time_s) for event in events) == record.events_open
        at = records[-1]
        asked = [
            {"probe": "spam", "number": "0", "item": item, "asked_s": str(at.time_s), "value": value}
            for item, value in (
                ("open_events", str(at.events_open + 2)),
                ("trees", str(at.trees)),
                ("agents_in_trees", ""),
            )
        ]
        asked += [{**asked[0], "item": "most_events", "value": quarter} for quarter in QUARTERS]
        rows = score([*asked, {**asked[0], "asked_s": "1e6"}], records, events, scenario)
        assert [(row.is_right, row.error) for row in rows[:3]] == [(0, 2.0), (1, 0.0), (None, None)]
        truth = rows[3].truth.split(" or ")
        assert [row.is_right for row in rows[3:]] == [int(quarter in truth) for quarter in QUARTERS]
        assert 1 <= len(truth) <= 4
