"""Reading recordings back: exactly what was written, also after a kill."""

import random
import signal
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from deltaswarm_orchestrator.recording.reader import RecordingError, read_recording
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import EventState, Truth
from deltaswarm_wire.checked import load
from deltaswarm_wire.codec import MAX_ABS_CM, MAX_ABS_M, MAX_AGENT_ID, MAX_ID
from deltaswarm_wire.messages import MAX_TIME_S, Event
from deltaswarm_wire.operator_messages import HEARD, REFUSED, Answer, Report, ReportedMember, Workload
from tests.support.strategies import deltas, step_records
from tests.support.swarms import PATIENCE_S
from tests.support.truths import recorded, steps

SCENARIO = load(Scenario, {"agents": {"count": 5}, "run": {"step_s": 0.3}})

times = st.floats(0, MAX_TIME_S)
places = st.floats(-MAX_ABS_M, MAX_ABS_M)
counts = st.integers(0, MAX_ID)
agents = st.integers(0, MAX_AGENT_ID)
centimetres = st.integers(-MAX_ABS_CM, MAX_ABS_CM)
not_yet = st.none()

reports = st.builds(
    Report,
    agents,
    counts,
    counts,
    st.sampled_from(["attending", "root"]),
    places,
    places,
    agents,
    st.lists(st.builds(Event, counts, places, places), max_size=3).map(tuple),
    st.lists(st.builds(ReportedMember, agents, agents, centimetres, centimetres), max_size=3).map(tuple),
    st.lists(st.builds(Answer, counts, st.integers(HEARD, REFUSED)), max_size=3).map(tuple),
    deltas,
)
events = st.builds(EventState, st.integers(0, 5), places, places, times, *[times | not_yet] * 3, times)


@st.composite
def lives(draw: st.DrawFn) -> list[tuple[Truth, tuple[Report, ...], Workload]]:
    """Some steps with any figures that the wire allows."""
    made = []
    for step in range(draw(st.integers(0, 4))):
        now_s = draw(times)
        record = draw(step_records)._replace(step=step, time_s=now_s)
        shown = draw(st.lists(events, max_size=4, unique_by=lambda event: event.event))
        rates = [draw(st.floats(0, MAX_ID)) for _ in range(2)]
        workload = Workload(step, now_s, draw(counts), draw(counts), *rates, draw(times), *[draw(counts)] * 3)
        made.append(
            (Truth(step, now_s, (), tuple(shown), (), record), tuple(draw(st.lists(reports, max_size=2))), workload)
        )
    return made


def write(folder: Path, told: list[tuple[Truth, tuple[Report, ...], Workload]], **manifest: Any) -> None:
    with Recorder(folder, SCENARIO) as recorder:
        for truth, sent, workload in told:
            recorder.step(truth, sent)
            recorder.workload(workload)
        recorder.complete(manifest)


def check_same(folder: Path, told: list[tuple[Truth, tuple[Report, ...], Workload]]) -> None:
    found = read_recording(folder)
    assert found.step_records == [truth.step_record for truth, _, _ in told]
    assert found.workloads == [workload for _, _, workload in told]
    assert found.reports == {truth.step: sent for truth, sent, _ in told}
    newest = {event.event: event for truth, _, _ in told for event in truth.events}
    assert found.events == sorted(newest.values(), key=lambda event: (event.arrived_s, event.event))


@given(lives())
def test_any_figures_read_back_as_they_were_written(told: list[tuple[Truth, tuple[Report, ...], Workload]]) -> None:
    """Tallies, events, workloads and reports are equal to the last bit, whatever the wire allows in them."""
    with tempfile.TemporaryDirectory() as name:
        write(Path(name), told)
        check_same(Path(name), told)


@pytest.mark.parametrize("seed", range(5))
def test_a_plausible_run_reads_back_as_it_was_written(tmp_path: Path, seed: int) -> None:
    """Over many chunks, with events that come, are worked on and go."""
    told = list(steps(SCENARIO, 300, seed=seed))
    write(tmp_path, told)
    check_same(tmp_path, told)


def test_a_finished_recording_is_complete(tmp_path: Path) -> None:
    """It has its manifest, and the scenario from which it came."""
    write(tmp_path, list(steps(SCENARIO, 3)), digest="ab12", seed=5)
    found = read_recording(tmp_path / "recording.mcap")
    assert found.complete
    assert found.metadata == {"digest": "ab12", "seed": "5"}
    assert load(Scenario, tomllib.loads(found.scenario)) == SCENARIO


def test_a_finished_recording_is_preferred_to_a_part(tmp_path: Path) -> None:
    write(tmp_path, list(steps(SCENARIO, 3)))
    (tmp_path / "recording.mcap.part").write_bytes(b"")
    assert len(read_recording(tmp_path).step_records) == 3


def test_a_cut_anywhere_leaves_the_steps_before_it(tmp_path: Path) -> None:
    """A file cut at any byte is read without an error: whole steps from the first on, and incomplete."""
    told = list(steps(SCENARIO, 24))
    ticks = iter(range(10_000))
    with Recorder(tmp_path, SCENARIO, wall=lambda: next(ticks) / 3) as recorder:
        for truth, sent, workload in told:
            recorder.step(truth, sent)
            recorder.workload(workload)
        recorder.complete({"digest": "ab12"})
    whole = (tmp_path / "recording.mcap").read_bytes()
    part = tmp_path / "cut.mcap.part"
    rng = random.Random(1)
    cuts = sorted({0, 1, 7, 8, 9, len(whole) - 9, len(whole) - 1} | {rng.randrange(len(whole)) for _ in range(300)})
    step_records = [truth.step_record for truth, _, _ in told]
    before = 0
    for cut in cuts:
        part.write_bytes(whole[:cut])
        found = read_recording(part)
        assert not found.complete
        assert found.step_records == step_records[: len(found.step_records)]
        assert len(found.step_records) >= before
        before = len(found.step_records)
    assert before == len(told)


def test_a_damaged_recording_is_incomplete(tmp_path: Path) -> None:
    """A flipped bit is noticed: what came before it is kept, what follows is not believed."""
    data = bytearray(recorded(tmp_path, SCENARIO, 200).read_bytes())
    told = [truth.step_record for truth, _, _ in steps(SCENARIO, 200)]
    rng = random.Random(1)
    for place in (rng.randrange(8, len(data) // 2) for _ in range(100)):
        bit = 1 << rng.randrange(8)
        data[place] ^= bit
        (tmp_path / "recording.mcap").write_bytes(data)
        data[place] ^= bit
        found = read_recording(tmp_path)
        assert not found.complete
        assert found.step_records == told[: len(found.step_records)]


def test_other_files_are_refused(tmp_path: Path) -> None:
    """What is no MCAP file is named; what is not there is not found."""
    (tmp_path / "notes.txt").write_text("no recording at all")
    with pytest.raises(RecordingError, match=r"notes\.txt"):
        read_recording(tmp_path / "notes.txt")
    with pytest.raises(FileNotFoundError):
        read_recording(tmp_path)


def test_a_recording_of_an_earlier_version_is_refused(tmp_path: Path) -> None:
    """It was in JSON; nothing is read out of it as if it were empty."""
    with (tmp_path / "recording.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("deltaswarm.SwarmState", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/swarm/state", "json", schema), 0, b'{"step": 0}', 0)
        writer.finish()
    with pytest.raises(RecordingError, match="json"):
        read_recording(tmp_path)


WRITER = """
import sys
from pathlib import Path
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_scenario.scenario import Scenario
from tests.support.truths import steps

now_s = 0.0
told = steps(Scenario(), 500)
recorder = Recorder(Path(sys.argv[1]), Scenario(), wall=lambda: now_s)
for step, (truth, reports, workload) in enumerate(told):
    recorder.workload(workload)
    now_s = 1.0 if step >= 299 else 0.0  # a wall second passes once: the flush
    recorder.step(truth, reports)
print("written", flush=True)
sys.stdin.read()
"""


@pytest.mark.processes
def test_a_killed_recorder_leaves_all_steps_up_to_its_last_flush(tmp_path: Path) -> None:
    """After SIGKILL of a real process the file has every step until the flush, figures and all."""
    root = Path(__file__).parents[3]
    with subprocess.Popen(
        [sys.executable, "-P", "-c", f"import sys; sys.path.insert(0, {str(root)!r})\n{WRITER}", str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "written\n"
        writer.kill()
        assert writer.wait(PATIENCE_S) == -signal.SIGKILL
    assert not (tmp_path / "recording.mcap").exists()
    found = read_recording(tmp_path)
    told = list(steps(Scenario(), 500))
    assert 300 <= len(found.step_records) <= 500
    assert found.step_records == [truth.step_record for truth, _, _ in told[: len(found.step_records)]]
    assert found.workloads[:300] == [workload for _, _, workload in told[:300]]
    assert [found.reports[step] for step in range(300)] == [sent for _, sent, _ in told[:300]]
    assert load(Scenario, tomllib.loads(found.scenario)) == Scenario()
    assert not found.complete
