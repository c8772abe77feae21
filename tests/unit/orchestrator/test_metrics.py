"""The metrics of a run: from what happened, and again by a script that knows nothing but the tables."""

import csv
import dataclasses
import math
import tomllib
from pathlib import Path
from statistics import fmean, median
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from deltaswarm_orchestrator.results.outcome import (
    COMPLETED,
    SENSED,
    EventLife,
    Outcome,
    RunData,
    arrival_digests,
    followed,
    percentile_95,
    time_until,
    worst_tenth,
)
from deltaswarm_orchestrator.results.summary import computed
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import DROP_REASONS, EventState
from deltaswarm_wire.checked import load
from tests.support.swarms import run
from tests.unit.orchestrator.test_results import STEP_S, event, record, whole, workload


def a_scenario(horizon_s: float = 1.0) -> Scenario:
    return load(Scenario, {"run": {"step_s": STEP_S}, "metrics": {"horizon_s": horizon_s}})


def metrics(outcome: Outcome, scenario: Scenario) -> dict[str, Any]:
    return computed(RunData(outcome, scenario))


def test_waiting_times_are_until_first_sensed() -> None:
    """Mean, median and number of those sensed, to the end of the run; the others are counted apart."""
    outcome = whole()
    outcome.events = [event(1, 0.0, 0.0), event(2, 0.5, 1.0), event(3, 0.5, 2.0), event(4, 1.0, None)]
    assert metrics(outcome, a_scenario(2.0))["waiting_time_s"] == {
        "mean": pytest.approx(2.0 / 3),
        "median": 0.5,
        "n": 3,
        "never_sensed": 1,
        "restricted_mean": (0.0 + 0.5 + 1.5 + 2.0) / 4,
        "restricted_median": 1.0,
        "p95": 2.0,
        "worst_tenth": 2.0,
        "beyond_horizon": 0.25,
    }


def test_restricted_means_follow_each_event_for_the_horizon() -> None:
    """Neither more, nor less: an event younger than it is left out, what has not happened by then counts as it."""
    outcome = whole(events_open=[1, 2, 2, 3, 1, 0])
    outcome.events = [event(1, 0.0, 0.2, 0.5), event(2, 1.0, 1.5, 2.9), event(3, 2.0, None), event(4, 2.1, 2.2, 2.3)]
    found = metrics(outcome, a_scenario(1.0))
    assert found["completion_s"] == {
        "mean": pytest.approx((0.5 + 1.0 + 1.0) / 3),
        "median": 1.0,
        "p95": 1.0,
        "worst_tenth": 1.0,
        "beyond_horizon": pytest.approx(2 / 3),
    }
    assert found["waiting_time_s"]["restricted_mean"] == pytest.approx((0.2 + 0.5 + 1.0) / 3)
    assert (found["completed"], found["open_events"]) == (3, {"mean": 1.5})
    assert (found["arrivals"]["n"], found["arrivals"]["followed"]) == (4, 3)


def test_four_times_of_an_event_are_told_apart() -> None:
    """Who is told late, or never, waits on: what anybody senses the operator need not know."""
    outcome = whole()
    outcome.events = [
        event(1, 0.0, 0.1, 0.9)._replace(worked_s=0.3),
        event(2, 0.5, 0.5)._replace(worked_s=1.1),
        event(3, 1.0, 1.0),
        event(4, 9.0, 9.0),  # nobody can follow it for the horizon
    ]
    outcome.told_s = {1: 0.2, 2: 1.3, 99: 0.0}  # of 99 a phantom was told
    found = metrics(outcome, a_scenario(1.5))
    assert found["waiting_time_s"]["restricted_mean"] == pytest.approx((0.1 + 0.0 + 0.0) / 3)
    assert found["told_s"] == {
        "mean": pytest.approx((0.2 + 0.8 + 1.5) / 3),
        "median": pytest.approx(0.8),
        "p95": 1.5,
        "worst_tenth": 1.5,
        "beyond_horizon": pytest.approx(1 / 3),
    }
    assert found["worked_s"]["mean"] == pytest.approx((0.3 + 0.6 + 1.5) / 3)
    assert found["completion_s"]["mean"] == pytest.approx((0.9 + 1.5 + 1.5) / 3)
    outcome.told_s = None  # the operator's process was lost
    assert set(metrics(outcome, a_scenario(1.5))["told_s"].values()) == {None}


@pytest.mark.parametrize(("count", "rank"), [(1, 1), (19, 19), (20, 19), (21, 20), (100, 95), (101, 96)])
def test_the_95th_percentile_is_a_value_that_95_of_100_do_not_exceed(count: int, rank: int) -> None:
    """The smallest such value: no number that nobody measured."""
    assert percentile_95([float(value) for value in range(count, 0, -1)]) == rank


@pytest.mark.parametrize(("count", "tenth"), [(1, [1]), (10, [10]), (11, [11, 10]), (20, [20, 19]), (21, [21, 20, 19])])
def test_the_worst_tenth_is_the_mean_of_the_longest_times(count: int, tenth: list[float]) -> None:
    """A tenth rounded up to whole events: of a few events, the longest."""
    assert worst_tenth([float(value) for value in range(1, count + 1)]) == fmean(tenth)


def test_a_swarm_that_ignores_the_rim_is_seen_in_the_worst_tenth() -> None:
    """Two swarms with the same mean: one serves all events alike, the other never finds two of twenty."""
    outcome = whole()
    mean_s, tenths = [], []
    for sensed_s in ([0.3] * 20, [*[0.2] * 17, 0.6, None, None]):
        outcome.events = [event(number, 0.0, time_s) for number, time_s in enumerate(sensed_s)]
        found = metrics(outcome, a_scenario(1.0))["waiting_time_s"]
        mean_s.append(found["restricted_mean"])
        tenths.append(found["worst_tenth"])
    assert mean_s == [pytest.approx(0.3), pytest.approx(0.3)]
    assert tenths == [pytest.approx(0.3), 1.0]


TIMES = st.lists(st.tuples(st.floats(0, 100), st.none() | st.floats(0, 50), st.none() | st.floats(0, 50)), max_size=20)


@given(TIMES, st.floats(1, 40), st.floats(0, 60))
def test_neither_late_arrivals_nor_a_longer_run_bend_the_means(
    events: list[tuple[float, float | None, float | None]], horizon_s: float, longer_s: float
) -> None:
    """What a run of 100 s says of an event, a longer one says too; events that both follow have equal times."""

    def seen_until(end_s: float) -> list[EventLife]:
        made = []
        for number, (arrived_s, waits_s, works_s) in enumerate(events):
            sensed_s = None if waits_s is None else arrived_s + waits_s
            completed_s = None if sensed_s is None or works_s is None else sensed_s + works_s
            times = [None if time_s is None or time_s > end_s else time_s for time_s in (sensed_s, completed_s)]
            made.append(EventLife(**event(number, arrived_s, *times)._asdict(), told_s=None))
        return made

    short = followed(seen_until(100.0), 100.0, horizon_s)
    long = followed(seen_until(100.0 + longer_s), 100.0 + longer_s, horizon_s)
    known = {number.event: times_s(number, horizon_s) for number in long}
    assert [known[number.event] for number in short] == [times_s(number, horizon_s) for number in short]
    assert {number.event for number in short} == {e.event for e in long if e.arrived_s + horizon_s <= 100.0}
    assert all(0 <= waiting_s <= completion_s <= horizon_s for waiting_s, completion_s in known.values())


def times_s(event: EventLife, horizon_s: float) -> tuple[float, float]:
    """Until it was sensed and until it was complete."""
    return time_until(event, SENSED, horizon_s), time_until(event, COMPLETED, horizon_s)


def test_rates_are_per_second_not_per_step() -> None:
    """With steps of half a second each count is worth twice as much."""
    outcome = whole(frames_sent=[3] * 6, frames_received=[0, 6] * 3, bytes_sent=[100] * 6)
    outcome.workloads = [workload(step, messages=step, senders=2, time_above_s=step / 2) for step in range(6)]
    found = metrics(outcome, a_scenario())
    assert found["frames_sent_per_s"] == {"mean": 6.0}
    assert found["frames_received_per_s"] == {"mean": 6.0}
    assert found["bytes_sent_per_s"] == {"mean": 200.0}
    assert found["operator_messages_per_s"] == {"mean": 5.0}
    assert found["operator_senders"] == {"mean": 2.0}
    assert found["operator_time_above_threshold_s"] == 2.5


def test_minutes_above_the_threshold() -> None:
    """Of three whole minutes one has 6 messages per s, one none, one just 1, the threshold; a fourth is cut off."""
    steps = round(200 / STEP_S)
    outcome = whole()
    outcome.step_records = [record(step) for step in range(steps)]
    counts = [3 if step * STEP_S < 60 else 0 if step * STEP_S < 120 else step % 2 for step in range(steps)]
    above = {*range(10, 40), *range(41, 60), 70}
    outcome.workloads = [
        workload(step, time_s=step * STEP_S, messages=counts[step], rate_60s_hz=1.5 if step in above else 1.0)
        for step in range(steps)
    ]
    outcome.operator = {"news": 5}
    found = metrics(outcome, load(Scenario, {"run": {"step_s": STEP_S}, "operator": {"threshold_hz": 1.0}}))
    assert found["operator_minutes"] == {"above_share": pytest.approx(1 / 3), "p95_per_s": 3 / STEP_S}
    assert found["operator_longest_above_s"] == 30 * STEP_S
    assert found["operator_news_per_s"] == 5 / 200


def test_drops_are_told_by_reason() -> None:
    """Loss on the air is no loss on the fabric, and each reason has its own sum."""
    outcome = whole(**{f"dropped_{reason}": [number] * 6 for number, reason in enumerate((*DROP_REASONS, "fog"), 1)})
    found = metrics(outcome, a_scenario())
    assert found["frames_dropped"] == {reason: 6 * number for number, reason in enumerate((*DROP_REASONS, "fog"), 1)}
    assert found["transport_lost"] == 0


def test_what_is_still_under_way_at_the_end_is_told() -> None:
    """Sums over the run, but the newest number in flight, of frames and of reports; nothing without steps."""
    sums = {"frames_sent": 5, "frames_received": 2, "frames_duplicated": 1, "reports_sent": 4, "reports_arrived": 3}
    outcome = whole(
        frames_in_flight=[1, 5, 2, 3, 4, 7],
        reports_in_flight=[0, 1, 2, 3, 4, 2],
        **{name: [number] * 6 for name, number in sums.items()},
    )
    found = metrics(outcome, a_scenario())
    assert found["frames"] == {"sent": 30, "received": 12, "duplicated": 6, "in_flight": 7}
    assert found["reports"] == {"sent": 24, "arrived": 18, "in_flight": 2}
    nothing = metrics(Outcome(), a_scenario())
    assert nothing["frames"] == {"sent": 0, "received": 0, "duplicated": 0, "in_flight": 0}
    assert nothing["reports"] == {"sent": 0, "arrived": 0, "in_flight": 0}


def test_trees_are_averaged_over_the_run_and_its_last_third() -> None:
    """Area and distance over the steps in which they were measured, and the area over those of them with trees."""
    areas, distances = [0.0, None, 60.0, None, 120.0, None], [None, None, 4.0, 6.0, 8.0, None]
    outcome = whole(
        agents_in_trees=[0, 0, 3, 6, 9, 12],
        trees=[0, 0, 1, 2, 2, 1],
        covered_area_m2=areas,
        roots_from_densest_m=distances,
    )
    found = metrics(outcome, a_scenario())
    assert found["agents_in_trees"] == {"mean": 5.0, "last_third_mean": 10.5}
    assert found["trees"] == {"mean": 1.0}
    assert found["covered_area_m2"] == {"mean": 60.0, "mean_while_trees": 90.0}
    assert found["roots_from_densest_m"] == {"mean": 6.0}


def test_nothing_is_no_number() -> None:
    """A run without events, steps or trees has None for what it cannot know, never a zero or NaN."""
    found = metrics(Outcome(), a_scenario())
    waiting = found["waiting_time_s"]
    assert (waiting.pop("n"), waiting.pop("never_sensed")) == (0, 0)
    for times in (waiting, *(found[name] for name in ("told_s", "worked_s", "completion_s"))):
        assert set(times.values()) == {None}
    assert (found["completed"], found["open_events"]) == (0, {"mean": None})
    assert found["operator_messages_per_s"] == {"mean": None}
    assert found["covered_area_m2"] == {"mean": None, "mean_while_trees": None}
    assert (found["steps"], found["transport_lost"], found["operator_time_above_threshold_s"]) == (0, 0, None)


def test_digests_of_arrivals_do_not_depend_on_what_became_of_them() -> None:
    """Nor on the order in which they are given; each time and each place counts."""
    events = [event(1, 0.5, 1.0), event(2, 1.5, None)]
    times, places = arrival_digests(events)
    assert arrival_digests([event(2, 1.5, 3.0, 4.0), event(1, 0.5, None)]) == (times, places)
    assert arrival_digests([events[0], events[1]._replace(arrived_s=1.6)]) != (times, places)
    moved = arrival_digests([events[0], events[1]._replace(x_m=9.0)])
    assert (moved[0] == times, moved[1] == places) == (True, False)


def test_the_digest_of_events_covers_all_that_became_of_each() -> None:
    """Every field of every event counts, and not the order; without a digest of the run there is none."""
    events = [event(1, 0.5, 1.0), event(2, 1.5, None)]
    outcome = dataclasses.replace(whole(), events=events)
    assert outcome.events_digest is not None
    assert dataclasses.replace(outcome, events=events[::-1]).events_digest == outcome.events_digest
    others = [[events[0], events[1]._replace(**{name: 9})] for name in EventState._fields]
    found = {dataclasses.replace(outcome, events=each).events_digest for each in [events, events[:1], *others]}
    assert len(found) == 2 + len(EventState._fields)
    assert dataclasses.replace(outcome, operator={}).events_digest is None


def test_digests_of_arrivals_are_those_of_earlier_versions() -> None:
    """In the order of arrival, and of their numbers if events arrive together: as `b2sum -l 64` of the lists."""
    outcome = whole()
    together = [event(2, 0.5, None)._replace(x_m=3.0), event(1, 0.5, None), event(0, 1.5, None)._replace(y_m=4.0)]
    for outcome.events in (together, together[::-1]):
        found = metrics(outcome, a_scenario())["arrivals"]
        assert (found["times"], found["places"]) == ("c23c9664c7e9e89b", "3540434fd1165efe")


def test_what_broke_the_protocol_or_was_lost_counts_on_both_sides() -> None:
    outcome = whole(rejected=[0, 1, 0, 0, 4, 0], transport_lost=[2, 0, 0, 0, 0, 1])
    outcome.workloads = [workload(step, rejected=step, lost=10 * step) for step in range(3)]
    found = metrics(outcome, a_scenario())
    assert (found["samples_rejected"], found["transport_lost"]) == (5 + 3, 3 + 30)


Row = dict[str, float]


def recomputed(folder: Path) -> dict[str, Any]:
    """The outcome of the task by its definitions alone, from `events.csv` and `scenario.toml`."""
    scenario = tomllib.loads((folder / "scenario.toml").read_text())
    horizon_s, step_s = scenario["metrics"]["horizon_s"], scenario["run"]["step_s"]
    end_s = scenario["run"]["duration_s"]
    with (folder / "events.csv").open(newline="") as stream:
        rows: list[Row] = [
            {name: float(text) if text else math.inf for name, text in row.items()} for row in csv.DictReader(stream)
        ]
    old = [row for row in rows if end_s - row["arrived_s"] >= horizon_s]
    waits, told, begun, works = (
        [min(horizon_s, row[then] - row["arrived_s"]) for row in old]
        for then in ("sensed_s", "told_s", "worked_s", "completed_s")
    )
    ends_s = [step * step_s for step in range(round(end_s / step_s))]
    still_open = [sum(row["arrived_s"] <= now_s < row["completed_s"] for row in rows) for now_s in ends_s]
    return {
        "waiting_time_s.restricted_mean": fmean(waits),
        "told_s.mean": fmean(told),
        "told_s.beyond_horizon": fmean([time_s == horizon_s for time_s in told]),
        "worked_s.median": median(begun),
        "completion_s.mean": fmean(works),
        "completion_s.median": median(works),
        "completed": sum(row["completed_s"] < math.inf for row in rows),
        "open_events.mean": fmean(still_open),
        "arrivals.followed": len(old),
    }


def told_by_the_recording(file: Path) -> dict[int, float]:
    """When a report first named each event, from what the recording says arrived at the operator, by its own schema."""
    told: dict[int, float] = {}
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, _, inbox in reader.iter_decoded_messages(topics=["/operator/inbox"]):
            for sighting in (sighting for report in inbox.reports for sighting in report.events):
                told.setdefault(sighting.event, inbox.time_s)
    return told


@pytest.mark.processes
@pytest.mark.parametrize("step_s", [0.5, 1.0, 2.0])
def test_the_outcome_is_that_of_the_events_table(tmp_path: Path, step_s: float) -> None:
    """By real processes and in one process, whatever the step: equal to the last bit, and to the script's."""
    own = ["run.duration_s=200", f"run.step_s={step_s}", "metrics.horizon_s=80", "events.work_agent_s=30"]
    own += ["events.rate_hz=0.2", "seed=5", "uplink.loss=0.5", "uplink.latency_s=3", "uplink.jitter_s=8"]
    summary = run(tmp_path / "run", *(text for one in own for text in ("--set", one)))
    ours = metrics(run_in_process(load_scenario("smoke", own)), load_scenario("smoke", own))
    assert {name: summary[name] for name in ours} == ours
    for name, value in recomputed(tmp_path / "run").items():
        top, _, part = name.partition(".")
        assert (summary[top][part] if part else summary[top]) == pytest.approx(value, rel=1e-12)
    told = told_by_the_recording(tmp_path / "run" / "recording.mcap")
    with (tmp_path / "run" / "events.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["told_s"] for row in rows] == [str(told.get(int(row["event"]), "")) for row in rows]
    assert sum(row["told_s"] > "" for row in rows) > 5
    assert summary["completed"] > 3
    assert summary["arrivals"]["followed"] > 10


def test_a_step_row_counts_completed_events() -> None:
    """The counts of a record are those of the step in which they stand."""
    outcome = run_in_process(load_scenario("smoke", ["events.work_agent_s=20", "events.rate_hz=0.3", "record=off"], 2))
    done = [
        sum(e.completed_s is not None and e.completed_s <= t.time_s for e in outcome.events)
        for t in outcome.step_records
    ]
    assert [t.events_completed for t in outcome.step_records] == done
    assert done[-1] > 5
