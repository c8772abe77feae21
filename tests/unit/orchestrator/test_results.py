"""The run folder: its summary, tables that read back, and the same from the recording alone."""

import csv
import json
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.base.exits import Reporter
from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.results.outcome import EventLife, Outcome, RunData
from deltaswarm_orchestrator.results.run_tables import OPERATOR_COLUMNS, read_outcome, write_json, write_tables
from deltaswarm_orchestrator.results.summary import computed, main_rows, summarise
from deltaswarm_orchestrator.run.lifecycle import run
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import COLUMNS, EventState, StepRecord
from deltaswarm_wire.checked import load
from deltaswarm_wire.digest import combine
from deltaswarm_wire.operator_messages import Workload
from tests.support.strategies import event_states, step_records, workloads
from tests.support.tiers import in_one_test

STEP_S = 0.5
UNKNOWN = {"covered_area_m2": None, "roots_from_densest_m": None, "delta": None}


def record(step: int, **more: Any) -> StepRecord:
    zeros: dict[str, Any] = dict.fromkeys(COLUMNS, 0)
    return StepRecord.of({**zeros, "step": step, "time_s": step * STEP_S, **UNKNOWN, **more})


def workload(step: int, messages: int = 0, **more: Any) -> Workload:
    zeros: dict[str, Any] = dict.fromkeys(Workload._fields, 0)
    return Workload(**{**zeros, "step": step, "time_s": step * STEP_S, "messages": messages, **more})


def event(number: int, arrived_s: float, sensed_s: float | None, completed_s: float | None = None) -> EventState:
    return EventState(number, 1.0, 2.0, arrived_s, sensed_s, None, completed_s, 0.0)


def a_scenario(**run: Any) -> Scenario:
    return load(Scenario, {"run": {"step_s": STEP_S, **run}})


def whole(**more: Any) -> Outcome:
    """A run of 6 steps that came to its end."""
    return Outcome(
        step_records=[record(step, **{name: value[step] for name, value in more.items()}) for step in range(6)],
        world={"complete": True, "digest": "aa", "wall_s": 2.0, "agents_lost": [], "refused_claims": 0},
        operator={"complete": True, "digest": "bb"},
    )


def test_speed_is_told_both_ways() -> None:
    found = summarise(whole(), a_scenario())
    assert (found["steps"], found["wall_s"], found["steps_per_s"], found["real_time_factor"]) == (6, 2.0, 3.0, 1.5)


def test_a_whole_run_is_valid_and_has_a_digest() -> None:
    found = summarise(whole(), a_scenario())
    assert (found["valid"], found["invalid_because"]) == (True, [])
    assert found["digest"] == combine("aa", "bb") != combine("bb", "aa")


@in_one_test(
    ("change", "reason"),
    [
        ({"world": {}}, "did not reach its last step"),
        ({"operator": {"complete": False, "digest": "bb"}}, "did not reach its last step"),
        ({"step_records": [record(0, transport_lost=2)]}, "2 messages were lost on the fabric"),
        ({"workloads": [workload(0, lost=3)]}, "3 messages were lost on the fabric"),
    ],
)
def test_a_run_is_not_valid_if_anything_is_missing(change: dict[str, Any], reason: str) -> None:
    outcome = whole()
    for name, value in change.items():
        setattr(outcome, name, value)
    found = summarise(outcome, a_scenario())
    assert not found["valid"]
    assert any(reason in because for because in found["invalid_because"])


@in_one_test(
    ("world", "per_sender", "reasons"),
    [
        (
            {"transport_lost": {"3": 3, "5": 4}},
            {"5": {"lost": 2}, "9": {"lost": 0}, "world": {"lost": 8}},
            ["9 messages were lost on the fabric (6 of agent 5, 3 of agent 3)"],
        ),
        (
            {"transport_lost": {str(agent): 10 - agent for agent in range(8)}},
            {},
            [
                "9 messages were lost on the fabric"
                " (10 of agent 0, 9 of agent 1, 8 of agent 2, 7 of agent 3, 6 of agent 4)"
            ],
        ),
        (
            {"fell_back": {"2": 4, "5": 5}},
            {},
            ["agent 5's sequence number reset 5 times; two processes may share its id"],
        ),
        (
            {"excess": {"7": 1, "8": 30}},
            {},
            [
                "agent 7 sent 1 samples more than one radio frame, one report and one act in a step",
                "agent 8 sent 30 samples more than one radio frame, one report and one act in a step",
            ],
        ),
    ],
)
def test_a_reason_names_its_agents(
    world: dict[str, Any], per_sender: dict[str, dict[str, int]], reasons: list[str]
) -> None:
    """Of those that lost messages by the counts of world and operator at most five, most first."""
    outcome = whole()
    outcome.step_records = [record(0, transport_lost=9 if "transport_lost" in world else 0)]
    outcome.world |= world
    outcome.operator |= {"per_sender": per_sender}
    found = summarise(outcome, a_scenario())
    assert (found["invalid_because"], found["valid"]) == (reasons, False)


def test_late_answers_are_summed_over_the_run() -> None:
    assert summarise(whole(agents_late=[0, 3, 0, 4, 0, 2]), a_scenario())["agents_late"] == 9


def same(found: Outcome, outcome: Outcome) -> bool:
    return (found.step_records, found.workloads, found.lives) == (
        outcome.step_records,
        outcome.workloads,
        outcome.lives,
    )


@st.composite
def outcomes(draw: st.DrawFn) -> Outcome:
    """Any figures that the wire allows; the operator may have come less far than the world."""
    steps = draw(st.integers(0, 5))
    return Outcome(
        [draw(step_records)._replace(step=step) for step in range(steps)],
        draw(st.lists(event_states, max_size=3)),
        [draw(workloads)._replace(step=step) for step in range(draw(st.integers(0, steps)))],
    )


@given(outcome=outcomes())
def test_tables_read_back_as_they_were_written(tmp_path_factory: pytest.TempPathFactory, outcome: Outcome) -> None:
    """To the last bit; what is not yet is empty, and None again."""
    folder = tmp_path_factory.mktemp("tables")
    write_tables(folder, outcome)
    found = read_outcome(folder)
    steps = {workload.step: workload for workload in outcome.workloads}
    outcome.workloads = [w._replace(time_s=outcome.step_records[step].time_s) for step, w in sorted(steps.items())]
    assert same(found, outcome)


def test_the_columns_are_named(tmp_path: Path) -> None:
    """One row per step: the world's columns, then the operator's; one row per event."""
    outcome = whole()
    outcome.events = [event(1, 0.0, None)]
    write_tables(tmp_path, outcome)
    rows = list(csv.DictReader((tmp_path / "series.csv").open(newline="")))
    assert list(rows[0]) == [*COLUMNS, *OPERATOR_COLUMNS.values()]
    assert [row["step"] for row in rows] == list("012345")
    assert (tmp_path / "events.csv").read_text().splitlines()[0] == ",".join(
        name for name in EventLife._fields if name not in ("told_s", "shown_s", "read_s")
    )


def put(file: Path, fields: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows([fields, *rows])
    return file.read_bytes()


def test_a_row_that_was_cut_off_is_left_out(tmp_path: Path) -> None:
    """Wherever a killed part's file ends: the whole rows before it count, half a number never does."""
    told = [record(step, frames_sent=1000 + step, covered_area_m2=123.25) for step in range(3)]
    data = put(tmp_path / "world.csv", COLUMNS, [row.columns().values() for row in told])
    counted = set()
    for end in range(len(data) + 1):
        (tmp_path / "world.csv").write_bytes(data[:end])
        found = read_outcome(tmp_path).step_records
        assert found == told[: len(found)]
        counted.add(len(found))
    assert counted == {0, 1, 2, 3}


def test_parts_that_were_not_merged_are_read_as_well(tmp_path: Path) -> None:
    """What an interrupted run left: the world's rows and the operator's, each as far as they go."""
    outcome = whole()
    outcome.workloads = [workload(step, messages=step) for step in range(4)]
    put(tmp_path / "world.csv", COLUMNS, [record.columns().values() for record in outcome.step_records])
    put(tmp_path / "operator.csv", Workload._fields, outcome.workloads)
    write_json(tmp_path / "world.json", outcome.world)
    found = read_outcome(tmp_path)
    assert same(found, outcome)
    assert (found.is_complete, found.digest) == (False, None)
    write_tables(tmp_path, found)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["events.csv", "series.csv"]
    assert same(read_outcome(tmp_path), outcome)


def test_the_recording_alone_gives_the_figures_of_the_summary(tmp_path: Path) -> None:
    scenario = load_scenario("smoke", ["radio.loss=0.1", "control.delta=2"])
    result = run(scenario, RunOptions(out=tmp_path / "run", in_process=True), Reporter())
    recorded = read_recording(result.folder)
    assert recorded.complete
    again = load(Scenario, tomllib.loads(recorded.scenario))
    assert again == scenario
    outcome = Outcome(recorded.step_records, recorded.events, recorded.workloads, told_s=recorded.told_s)
    reports = [report for step in sorted(recorded.reports) for report in recorded.reports[step]]
    named = [{event for event, _, _ in report.events} for report in reports]
    news = sum(bool(events.difference(*named[:number])) for number, events in enumerate(named))
    found = computed(RunData(replace(outcome, operator={"news": news}), again))
    told = json.loads((result.folder / "summary.json").read_text())
    assert found == {name: told[name] for name in found}
    assert found["waiting_time_s"]["n"] > 10
    assert told["valid"]
    assert recorded.metadata["digest"] == told["digest"]
    assert same(read_outcome(result.folder), outcome)
    assert found["told_s"]["median"] > found["waiting_time_s"]["restricted_median"]


def test_a_mean_at_the_horizon_is_shown_as_longer() -> None:
    """What took longer than events are followed is no measured time; what is below it is."""
    outcome = whole()
    outcome.events = [event(1, 0.0, 0.5, None), event(2, 0.5, 1.0, None)]
    shown = {label: value for label, value, _ in main_rows(summarise(outcome, a_scenario()))}
    assert shown["mean time until complete"] is None  # no event could be followed for 600 s
    scenario = load(Scenario, {"run": {"step_s": STEP_S}, "metrics": {"horizon_s": 2.0}})
    shown = {label: value for label, value, _ in main_rows(summarise(outcome, scenario))}
    assert (shown["mean time until sensed"], shown["mean time until complete"]) == (0.5, "> 2")


def test_the_main_rows_are_the_labelled_metrics() -> None:
    """Each with its value and unit, and after the dropped reports a row for each reason that occurred."""
    summary = summarise(whole(reports_dropped_loss=range(6)), a_scenario(duration_s=3.0))
    rows = list(main_rows(summary))
    assert ("steps", 6, "") in rows
    assert ("speed", 3.0, "1/s") in rows
    assert ("valid", True, "") in rows
    assert [row for row in rows if row[0].startswith("reports dropped: ")] == [("reports dropped: loss", 15, "")]
    assert all(label for label, _, _ in rows)


def missing(failed: Sequence[int] = (), hung: Sequence[int] = (), longest: int = 3) -> Outcome:
    """A whole run in which these agents missed steps."""
    outcome = whole()
    rows = [
        [{"agent": agent, "step": 2, "steps": 4, "longest": longest} for agent in those] for those in (failed, hung)
    ]
    outcome.world |= {"agents_failed": rows[0], "agents_late": rows[1], "agent_steps": {"due": 60, "answered": 45}}
    outcome.causes |= dict.fromkeys(failed, "killed by SIGKILL")
    return outcome


@pytest.mark.parametrize(
    ("accepted", "failed", "hung", "is_valid"),
    [
        (0, [], [], True),
        (0, [3], [], False),
        (0, [], [3], False),
        (1, [3], [], True),
        (1, [3], [3], True),
        (1, [3], [4], False),
        (2, [3], [4], True),
        (0.1, [3], [], True),
        (0.1, [3], [4], False),
        (0.19, [3, 4], [], False),
        (0.3, [3, 4, 5], [], True),
        (10, [*range(10)], [], True),
    ],
)
def test_a_run_is_valid_if_no_more_agents_fail_or_hang_than_it_accepts(
    accepted: float, failed: list[int], hung: list[int], is_valid: bool
) -> None:
    """Of ten agents: as a number, or below 1 as a share."""
    scenario = load(Scenario, {"run": {"step_s": STEP_S, "accept_lost": float(accepted)}, "agents": {"count": 10}})
    summary = summarise(missing(failed, hung), scenario)
    assert summary["valid"] is is_valid
    assert summary["agent_steps"] == {"due": 60, "answered": 45, "answered_share": 0.75}
    assert [row["agent"] for row in summary["agents_failed"]] == failed


def test_the_reasons_name_agent_step_and_cause_of_the_first_five() -> None:
    reasons = summarise(missing([*range(6)], [9]), a_scenario())["invalid_because"]
    assert reasons[0] == "agent 0 failed in step 2 (4 steps missed): killed by SIGKILL"
    assert len(reasons) == 6
    assert reasons[-1] == "2 more agents failed or hung"
    [reason] = summarise(missing(hung=[7]), a_scenario(step_timeout_s=2.0))["invalid_because"]
    assert reason == "agent 7 hung in step 2 (4 steps missed): no answer within 2 s (run.step_timeout_s)"


@pytest.mark.parametrize(
    ("factor", "timeout_s", "longest", "hangs"),
    [
        *((1.0, 5.0, 9, False), (1.0, 5.0, 10, True), (1.0, 60.0, 19, False), (1.0, 60.0, 20, True)),
        *((100.0, 5.0, 199, False), (100.0, 5.0, 200, True), (1.0, 0.4, 1, True)),
    ],
)
def test_by_the_wall_clock_an_agent_hangs_that_misses_several_steps_in_a_row(
    factor: float, timeout_s: float, longest: int, hangs: bool
) -> None:
    """20 steps of 0.5 s, at a fast pace those of a second, at most those of the time-out; slightly late is not hung."""
    run = {"step_s": STEP_S, "clock": "realtime", "real_time_factor": factor, "step_timeout_s": timeout_s}
    found = summarise(missing(hung=[3], longest=longest), load(Scenario, {"run": run}))
    assert ([row["agent"] for row in found["agents_hung"]], found["valid"]) == ([3] * hangs, not hangs)


def test_a_run_of_a_deserted_swarm_says_so() -> None:
    outcome = missing([0])
    outcome.world |= {"complete": False, "deserted": True}
    assert summarise(outcome, a_scenario())["invalid_because"][0] == (
        "the run did not reach its last step: no agent was left"
    )
