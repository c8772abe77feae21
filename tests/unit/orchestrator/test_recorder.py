"""The recorder: what viewers need of a recording, and that figures are neither thinned nor lost."""

import itertools
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader

from deltaswarm_orchestrator.recording import RECORDING
from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.recording.recorder import Recorder, layout
from deltaswarm_orchestrator.recording.scene import EPOCH_S
from deltaswarm_orchestrator.recording.schemas import TOPICS, VIEW_TOPICS
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import EventState
from deltaswarm_wire.checked import load
from tests.support.truths import messages, on, recorded, shown, steps, truth


def scenario(**run: float) -> Scenario:
    return load(Scenario, {"run": run, "agents": {"count": 12}})


def test_every_channel_is_protobuf_with_its_schema(tmp_path: Path) -> None:
    """Foxglove, Lichtblick and Rerun all read it; every topic is announced, and has messages."""
    path = recorded(tmp_path, scenario(), 30)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    found = {channel.topic: channel for channel in summary.channels.values()}
    assert set(found) == set(TOPICS) == {topic for topic, _, _ in messages(path)}
    for topic, channel in found.items():
        schema = summary.schemas[channel.schema_id]
        assert (channel.message_encoding, schema.encoding) == ("protobuf", "protobuf")
        assert schema.name == TOPICS[topic].DESCRIPTOR.full_name


@pytest.mark.parametrize("step_s", [1.0, 0.1, 0.05, 0.03, 0.01])
def test_views_come_at_most_ten_times_a_second(tmp_path: Path, step_s: float) -> None:
    """However short the steps: above that viewers warn and browsers run out of memory."""
    found = messages(recorded(tmp_path, scenario(step_s=step_s), round(3 / step_s)))
    for topic in VIEW_TOPICS.keys() - {"/swarm/agents"}:  # which is told when it changes
        times_ns = [at for one, at, _ in found if one == topic]
        spans = [later - earlier for earlier, later in itertools.pairwise(times_ns)]
        assert min(spans) >= 100_000_000 - 1
        assert max(spans) < max(step_s, 0.2) * 1e9 + 1


@pytest.mark.parametrize("step_s", [1.0, 0.05])
def test_figures_are_never_thinned(tmp_path: Path, step_s: float) -> None:
    """Every step has its statistics, its inbox and its workload, also where views are thinned."""
    found = messages(recorded(tmp_path, scenario(step_s=step_s), 40))
    for topic in ("/net/stats", "/swarm/state", "/operator/inbox", "/operator/workload"):
        assert [message.step for message in on(topic, found)] == list(range(40))


def test_log_time_is_simulated_time_since_2000(tmp_path: Path) -> None:
    """So that runs align, whenever they were made; stamps in messages agree."""
    for topic, log_time, message in messages(recorded(tmp_path, scenario(step_s=0.5), 5)):
        if topic.startswith("/scene"):
            (entity,) = message.entities
            assert log_time == entity.timestamp.ToNanoseconds()
        elif "time_s" in message.DESCRIPTOR.fields_by_name:
            assert log_time == (EPOCH_S + message.time_s) * 10**9


def test_an_event_is_told_when_it_changes(tmp_path: Path) -> None:
    """When it arrives, when it is first sensed, when it is complete; at the end once more if it is not."""
    arrived = EventState(1, 1.0, 2.0, 0.0, None, None, None, 0.0)
    sensed = arrived._replace(sensed_s=1.0, work_agent_s=1.0)
    later = sensed._replace(work_agent_s=90.5)
    done = later._replace(completed_s=3.0, work_agent_s=200.0)
    other = EventState(2, 3.0, 4.0, 1.0, None, None, None, 0.0)
    lives = [(arrived,), (sensed, other), (later, other), (done, other), (other,)]
    told = on("/swarm/event", shown(tmp_path, *(truth(events=events) for events in lives)))
    assert [(message.event, message.work_agent_s) for message in told] == [
        (1, 0.0),
        (1, 1.0),
        (2, 0.0),
        (1, 200.0),
        (2, 0.0),
    ]
    assert not told[0].HasField("sensed_s")
    assert not told[0].HasField("completed_s")
    assert (told[3].sensed_s, told[3].completed_s) == (1.0, 3.0)


def test_scenario_and_layout_come_with_the_recording(tmp_path: Path) -> None:
    """As attachments, and the layout also beside the file, to be imported into a viewer."""
    with recorded(tmp_path, scenario(), 2).open("rb") as stream:
        attached = {one.name: (one.media_type, one.data) for one in make_reader(stream).iter_attachments()}
    assert set(attached) == {"scenario.toml", "layout.json"}
    assert attached["layout.json"] == ("application/json", (tmp_path / "layout.json").read_bytes())
    assert json.loads(attached["layout.json"][1]) == layout(100.0, 100.0)
    assert "count = 12" in attached["scenario.toml"][1].decode()


def test_the_manifest_ends_the_recording(tmp_path: Path) -> None:
    """Closing adds it as metadata and gives the file its name; texts stay texts, the rest becomes JSON."""
    with Recorder(tmp_path, scenario()) as recorder:
        assert (tmp_path / "recording.mcap.part").exists()
        assert not (tmp_path / "recording.mcap").exists()
        recorder.complete({"digest": "ab12", "seed": 7, "versions": {"deltaswarm": "0.1.0"}})
    assert not (tmp_path / "recording.mcap.part").exists()
    with (tmp_path / "recording.mcap").open("rb") as stream:
        (manifest,) = make_reader(stream).iter_metadata()
    assert manifest.name == "manifest"
    assert manifest.metadata == {"digest": "ab12", "seed": "7", "versions": '{"deltaswarm":"0.1.0"}'}


def test_an_error_leaves_a_readable_part(tmp_path: Path) -> None:
    """Without `close` the file keeps its provisional name, has an index, and is marked incomplete."""
    told = list(steps(scenario(), 5))

    def fail() -> None:
        with Recorder(tmp_path, scenario(), wire=True) as recorder:
            for one, reports, _ in told:
                recorder.step(one, reports)
            raise RuntimeError("the world died")

    with pytest.raises(RuntimeError, match="the world died"):
        fail()
    assert not (tmp_path / "recording.mcap").exists()
    assert (tmp_path / "wire.mcap.part").exists()
    assert len(on("/swarm/state", messages(tmp_path / "recording.mcap.part"))) == 5
    found = read_recording(tmp_path)
    assert (found.complete, found.metadata) == (False, {})


def test_raw_frames_are_kept_only_when_asked_for(tmp_path: Path) -> None:
    """With `wire` a second file has every frame byte for byte, by agent and kind; else there is none."""
    frames = [(step, agent, bytes([step, agent, 0xC1])) for step in range(3) for agent in (4, 11)]
    for wire in (False, True):
        with Recorder(tmp_path, scenario(step_s=2.0), wire=wire) as recorder:
            for step, agent, data in frames:
                recorder.radio(step, agent, data)
            recorder.report_bytes(2, 4, b"\x80")
            recorder.complete({})
        assert (tmp_path / "wire.mcap").exists() == wire
    with (tmp_path / "wire.mcap").open("rb") as stream:
        found = [
            (channel.topic, channel.message_encoding, message.sequence, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
        ]
    expected = [(f"/agent/{agent}/radio", "msgpack", step, data) for step, agent, data in frames]
    expected.append(("/agent/4/report", "msgpack", 2, b"\x80"))
    assert sorted((topic, encoding, step, data) for topic, encoding, step, _, data in found) == sorted(expected)
    assert all(log_time == (EPOCH_S + 2 * step) * 10**9 for _, _, step, log_time, _ in found)


def test_log_levels_are_those_of_the_schema(tmp_path: Path) -> None:
    """Python's levels become debug 1, info 2, warning 3, error 4, fatal 5, as viewers filter by them."""
    with Recorder(tmp_path, scenario()) as recorder:
        for level in (10, 20, 25, 30, 40, 50, 90):
            recorder.log(level, "agent/3", "text", 1.5)
        recorder.complete({})
    found = on("/log", messages(tmp_path / "recording.mcap"))
    assert [message.level for message in found] == [1, 2, 2, 3, 4, 5, 5]
    assert found[0].timestamp.ToNanoseconds() == EPOCH_S * 10**9 + 1_500_000_000


def test_a_line_of_log_may_hold_anything(tmp_path: Path) -> None:
    """Bytes that a part wrote and that are no text do not end the recording."""
    with Recorder(tmp_path, scenario()) as recorder:
        recorder.log(20, "agent/3", b"caf\xe9".decode(errors="surrogateescape"), 0.0)
        recorder.complete({})
    (line,) = on("/log", messages(tmp_path / "recording.mcap"))
    assert line.message == "caf?"


def test_what_was_written_is_flushed_each_wall_second(tmp_path: Path) -> None:
    """Nothing is lost to a kill but what came within one wall second."""
    clock = SimpleNamespace(now_s=100.0)
    told = steps(scenario(), 4)
    with Recorder(tmp_path, scenario(), wall=lambda: clock.now_s) as recorder:
        for (one, reports, _), now_s, on_disk in zip(told, (100.0, 100.9, 101.0, 101.5), (0, 0, 3, 3), strict=True):
            clock.now_s = now_s
            recorder.step(one, reports)
            assert len(read_recording(tmp_path).step_records) == on_disk
        clock.now_s = 102.0
        recorder.flush_when_due()
        assert len(read_recording(tmp_path).step_records) == 4


@pytest.mark.parametrize(
    ("kept", "lost"), [(20, []), (8, ["steps 8 to 19"]), (None, ["steps 0 to 19"]), (0, ["steps 0 to 19"])]
)
def test_what_a_damaged_recording_has_lost_is_told(kept: int | None, lost: list[str], tmp_path: Path) -> None:
    """A run is resumed after step 19; its recording may have been cut off before that, be another file, or be gone."""
    before = tmp_path / "before"
    if kept:
        recorded(tmp_path, scenario(), kept).rename(before)
    else:
        before.write_bytes(b"This is no recording.")
    with Recorder(tmp_path, scenario()) as recorder:
        told = recorder.continue_from({} if kept is None else {RECORDING: before}, 19)
    assert len(told) == len(lost)
    assert all(part in line for part, line in zip(lost, told, strict=True))
