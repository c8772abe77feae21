"""Whole runs with every model of air and uplink: the same digest by processes, exact books, bytes as encoded."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.results.run_tables import read_outcome
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from tests.support.airs import EVERYTHING, OBSTACLES
from tests.support.swarms import run, sets
from tests.support.tiers import first_of

AGENTS, SECONDS = 8, 200
OWN = (f"agents.count={AGENTS}", f"run.duration_s={SECONDS}", "events.rate_hz=0.3", "control.delta=2")
BUSY_SEED = 11
"""Of a run in which every model drops frames."""


def a_scenario(*radio: str, seed: int = 1) -> Scenario:
    return load_scenario("smoke", [*OWN, "record=off", *radio], seed)


def check_books(step_records: list[StepRecord]) -> None:
    """Nothing is lost from them, in any step."""
    before = 0
    for record in step_records:
        dropped = sum(record.frames_dropped.values())
        came = record.frames_sent * (AGENTS - 1) + record.frames_duplicated
        assert before + came == record.frames_received + dropped + record.frames_in_flight
        before = record.frames_in_flight


@pytest.mark.processes
def test_with_every_model_at_once_processes_have_the_same_digest(tmp_path: Path) -> None:
    """By real processes and twice in one; the tables, the recording and the summary hold every reception."""
    outside = run(tmp_path / "run", *sets(*OWN, *EVERYTHING, f"seed={BUSY_SEED}"))
    first, second = (run_in_process(a_scenario(*EVERYTHING, seed=BUSY_SEED)) for _ in range(2))
    assert outside["digest"] == first.digest == second.digest
    assert outside["valid"]
    kept = read_outcome(tmp_path / "run").step_records
    assert kept == first.step_records == read_recording(tmp_path / "run").step_records
    check_books(kept)
    frames = outside["frames"]
    came = frames["sent"] * (AGENTS - 1) + frames["duplicated"]
    assert came == frames["received"] + sum(outside["frames_dropped"].values()) + frames["in_flight"]
    assert min(outside["frames_dropped"][reason] for reason in ("range", "jam", "loss", "burst", "contention")) > 0


@pytest.mark.processes
def test_with_obstacles_processes_have_the_same_digest(tmp_path: Path) -> None:
    """Agents walk by the same map in either case."""
    outside = run(tmp_path / "run", *sets(*OWN, "run.duration_s=100", OBSTACLES, f"seed={BUSY_SEED}"))
    assert outside["digest"] == run_in_process(a_scenario("run.duration_s=100", OBSTACLES, seed=BUSY_SEED)).digest
    assert outside["frames_dropped"]["obstacle"] > 0


@pytest.mark.parametrize("model", EVERYTHING, ids=lambda model: model.partition("=")[0])
def test_each_model_alone_keeps_the_books(model: str) -> None:
    """And is there: the run is another one, unless the model only prepares for another."""
    swarm = InProcess(a_scenario(model))
    check_books([swarm.step(step, last=False) for step in range(SECONDS)])


class Sink:
    """Counts the bytes that agents hand to their radios, by step."""

    def __init__(self) -> None:
        self.sent_bytes = Counter[int]()

    def radio(self, step: int, agent: int, data: bytes) -> None:
        self.sent_bytes[step] += len(data)

    def __getattr__(self, name: str) -> Any:
        return lambda *_: None


@pytest.mark.parametrize("radio", [(), EVERYTHING], ids=["disc", "everything"])
def test_bytes_counted_are_the_bytes_encoded(radio: tuple[str, ...]) -> None:
    """In each step, of the very frames that agents sent."""
    sink = Sink()
    outcome = run_in_process(a_scenario(*radio), Wanted(sink))
    assert sum(sink.sent_bytes.values()) > 1000
    assert [record.bytes_sent for record in outcome.step_records] == [sink.sent_bytes[step] for step in range(SECONDS)]


def test_bandwidth_counts_the_bytes_of_frames_as_encoded() -> None:
    """What wide radios let through is what agents sent, what they took in is what was heard; the run is the same."""
    swarm = InProcess(a_scenario("radio.bandwidth={sender_bytes_per_s=1e6, receiver_bytes_per_s=1e6}"))
    air = swarm.world.air
    assert air._sending is not None
    assert air._taking_in is not None
    sent = heard = 0
    for step in range(SECONDS):
        record = swarm.step(step, last=False)
        heard += sum(len(data) for frames in swarm.world._carried.heard for _, data in frames)
        assert (air._sending.passed_bytes, air._taking_in.passed_bytes) == (sent, heard)
        sent += record.bytes_sent
    assert heard > 10_000
    assert swarm.world.digest.hex() == plain_digest()


def plain_digest() -> str:
    """Of the same run without a bandwidth."""
    swarm = InProcess(a_scenario())
    for step in range(SECONDS):
        swarm.step(step, last=False)
    return swarm.world.digest.hex()


@pytest.mark.parametrize("rate", [60.0, 10.0])
def test_a_swarm_with_narrow_radios_sends_less(rate: float) -> None:
    """No sender has more on the air than its bandwidth allows."""
    swarm = InProcess(a_scenario(f"radio.bandwidth.sender_bytes_per_s={rate}", "radio.bandwidth.queue_bytes=200"))
    for step in range(SECONDS):
        swarm.step(step, last=False)
        air = swarm.world.air
        assert air._sending is not None
        assert air._sending.passed_bytes <= rate * AGENTS * (step + 1)


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


def check_reports(step_records: list[StepRecord]) -> None:
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
    check_reports(kept.step_records)
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
    check_reports(on.step_records)
