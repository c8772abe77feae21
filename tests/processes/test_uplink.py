"""Whole runs with an uplink model: by processes as in one, exact books, and nothing changed where it is off."""

from pathlib import Path

import pytest

from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.results.run_tables import read_outcome
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from tests.support.swarms import run, sets
from tests.support.tiers import first_of

OWN = ("agents.count=8", "run.duration_s=200", "events.rate_hz=0.3", "control.delta=2")
BASE = ("uplink.base_m=[5, 5]", "uplink.range_m=20.0")
UPLINK = (
    *BASE,
    "uplink.loss=0.1",
    "uplink.burst.p_good_to_bad=0.05",
    "uplink.latency_s=1.0",
    "uplink.jitter_s=3.0",
    "uplink.outages=[{from_s=100, until_s=110}]",
    "uplink.relay=true",
    "uplink.bandwidth={sender_bytes_per_s=120.0, receiver_bytes_per_s=600.0, queue_bytes=1000}",
)


def a_scenario(*sets: str, seed: int = 1) -> Scenario:
    return load_scenario("smoke", [*OWN, "record=off", *sets], seed)


def check_books(step_records: list[StepRecord]) -> None:
    before = 0
    for record in step_records:
        dropped = sum(record.reports_dropped.values())
        assert before + record.reports_sent == record.reports_arrived + dropped + record.reports_in_flight
        before = record.reports_in_flight


@pytest.mark.processes
@pytest.mark.parametrize("record", first_of(["wire", "views"]))
def test_processes_and_one_process_have_the_same_uplink(tmp_path: Path, record: str) -> None:
    """Digest, rows, the operator's own figures, the recording's inbox; nothing is lost on the fabric."""
    outside = run(tmp_path / "run", *sets(*OWN, *UPLINK, f"record={record}"))
    inside = run_in_process(a_scenario(*UPLINK))
    assert outside["digest"] == inside.digest
    assert (outside["valid"], outside["transport_lost"], outside["samples_rejected"]) == (True, 0, 0)
    kept, recorded = read_outcome(tmp_path / "run"), read_recording(tmp_path / "run")
    assert kept.step_records == inside.step_records == recorded.step_records
    check_books(kept.step_records)
    plain = [[w._replace(backlog=0) for w in workloads] for workloads in (kept.workloads, inside.workloads)]
    assert plain[0] == plain[1]
    assert [len(reports) for reports in recorded.reports.values()] == [t.reports_arrived for t in kept.step_records]
    reports, dropped = outside["reports"], outside["reports_dropped"]
    assert outside["operator"]["messages"] == reports["arrived"] == sum(w.messages for w in kept.workloads)
    assert reports["sent"] == reports["arrived"] + sum(dropped.values()) + reports["in_flight"]
    assert min(dropped[reason] for reason in ("outage", "loss", "burst")) > 0


@pytest.mark.parametrize("model", UPLINK, ids=lambda model: model.partition("=")[0])
def test_agents_do_not_notice(model: str) -> None:
    """What they do and say is the same with each model; without any, reports sent are reports counted."""
    off, on = run_in_process(a_scenario()), run_in_process(a_scenario(*BASE, model))
    assert [t.reports_sent for t in off.step_records] == [t.reports_sent for t in on.step_records]
    assert [t.reports_arrived for t in off.step_records] == [w.messages for w in off.workloads]
    assert [t.reports_arrived for t in on.step_records] == [w.messages for w in on.workloads]
    assert [t.bytes_sent for t in off.step_records] == [t.bytes_sent for t in on.step_records]
    assert off.events == on.events
    check_books(on.step_records)
