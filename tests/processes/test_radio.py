"""Whole runs with every model of the air: the same digest by processes, exact books, bytes as encoded."""

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
from tests.support.swarms import run

AGENTS, SECONDS = 8, 200
OWN = (f"agents.count={AGENTS}", f"run.duration_s={SECONDS}", "events.rate_hz=0.3", "control.delta=2")
BUSY_SEED = 11
"""Of a run in which every model drops frames."""


def a_scenario(*radio: str, seed: int = 1) -> Scenario:
    return load_scenario("smoke", [*OWN, "record=off", *radio], seed)


def settings(*overrides: str) -> list[str]:
    return [text for one in overrides for text in ("--set", one)]


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
    outside = run(tmp_path / "run", *settings(*OWN, *EVERYTHING, f"seed={BUSY_SEED}"))
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
    outside = run(tmp_path / "run", *settings(*OWN, "run.duration_s=100", OBSTACLES, f"seed={BUSY_SEED}"))
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
        """See the protocol `Sink`."""
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
