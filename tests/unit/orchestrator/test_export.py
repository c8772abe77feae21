"""Exports of a recording: each is opened by the library of its format, and holds what was recorded."""

import csv
import itertools
import random
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from rerun.chunk import RrdReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from deltaswarm_cli import one_run as command
from deltaswarm_cli import run as run_command
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.export.formats import FORMATS
from deltaswarm_orchestrator.export.picture import Picture
from deltaswarm_orchestrator.export.snapshots import Film, Snapshot
from deltaswarm_orchestrator.inspect.info import finish_recordings
from deltaswarm_orchestrator.recording.reader import Recording, read_recording
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_orchestrator.recording.scene import log_time_ns
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_scenario.scenario import RECORDS, Scenario
from deltaswarm_scenario.truth import AgentState, EventState, Truth
from deltaswarm_wire.checked import load
from deltaswarm_wire.messages import NOBODY
from tests.support.complaints import Printed
from tests.support.truths import recorded, steps, truth

STEPS = 12
OBSTACLE = {"corners_m": [[10, 10], [30, 10], [20, 40]]}
SCENARIO = load(Scenario, {"agents": {"count": 9}, "arena": {"obstacles": [OBSTACLE]}})
TOLD = list(steps(SCENARIO, STEPS))
TRUTHS = [truth for truth, _, _ in TOLD]
MM = 0.001


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run").mkdir()
    recorded(tmp_path / "run", SCENARIO, STEPS)
    return tmp_path / "run"


def export(run: Path, name: str, *more: str) -> int:
    return main(["export", str(run), "--format", name, *more])


def near(place: tuple[float, float], body: Any) -> bool:
    return abs(place[0] - body.x_m) < MM and abs(place[1] - body.y_m) < MM


def test_tables_hold_poses_events_and_workload(run: Path, capsys: Printed) -> None:
    """A row per view and agent, per event, per step; the folder is beside the run, and is printed."""
    assert export(run, "csv") == 0
    out = run.with_name("run-csv")
    assert capsys.readouterr().out.strip() == str(out)
    rows = {file.stem: list(csv.DictReader(file.open())) for file in out.iterdir()}
    assert set(rows) == {"poses", "events", "workload"}
    bodies = [(one.step, body) for one in TRUTHS for body in one.bodies]
    assert len(rows["poses"]) == len(bodies)
    for row, (step, body) in zip(rows["poses"], bodies, strict=True):
        assert near((float(row["x_m"]), float(row["y_m"])), body)
        said = ["" if agent == NOBODY else str(agent) for agent in (body.parent, body.root)]
        assert [row["parent"], row["root"]] == said
        assert (int(row["step"]), int(row["agent"]), row["role"]) == (step, body.agent, body.role)
    assert len(rows["events"]) == len({event.event for one in TRUTHS for event in one.events})
    assert [float(row["rate_60s_hz"]) for row in rows["workload"]] == [workload.rate_60s_hz for _, _, workload in TOLD]


def test_a_bag_opens_with_its_library(run: Path) -> None:
    """Poses of each role and of events, and the workload, at simulated times."""
    assert export(run, "rosbag2") == 0
    assert "version: 8\n" in (run.with_name("run-rosbag2") / "metadata.yaml").read_text(), (
        "the newest that Humble reads"
    )
    found: dict[str, list[Any]] = {}
    with AnyReader([run.with_name("run-rosbag2")], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, time_ns, data in reader.messages():
            found.setdefault(connection.topic, []).append((time_ns, reader.deserialize(data, connection.msgtype)))
    roles = {body.role for body in TRUTHS[0].bodies}
    assert set(found) == {
        *(f"/swarm/{role}" for role in roles),
        "/events",
        "/operator/messages",
        "/operator/rate_60s_hz",
    }
    for one, (time_ns, message) in zip(TRUTHS, found["/swarm/free"], strict=True):
        assert time_ns == log_time_ns(one.time_s)
        assert message.header.frame_id == "arena"
        free = [body for body in one.bodies if body.role == "free"]
        places = [(pose.position.x, pose.position.y) for pose in message.poses]
        assert all(near(place, body) for place, body in zip(places, free, strict=True))
    counts = [message.data for _, message in found["/operator/messages"]]
    assert counts == [workload.messages for _, _, workload in TOLD]


def test_rerun_opens_what_is_exported_to_it(run: Path) -> None:
    """Agents by role, trees, events, walls; curves of the figures."""
    assert export(run, "rrd") == 0
    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(run.with_name("run.rrd")).stream().to_chunks():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            found.setdefault(f"{chunk.entity_path} {name}", []).extend(batch.column(name).to_pylist())
    places = found["/arena/agents/free Points3D:positions"]
    assert len(places) == STEPS
    free = [body for body in TRUTHS[0].bodies if body.role == "free"]
    assert all(near((x, y), body) for (x, y, _), body in zip(places[0], free, strict=True))
    assert any(found["/arena/trees LineStrips3D:strips"])
    assert [len(wall) for wall in found["/arena/walls LineStrips3D:strips"][0]] == [5, 4]
    assert len(found["/arena/events Points3D:positions"]) == STEPS
    rates = [value for (value,) in found["/operator/rate_60s_hz Scalars:scalars"]]
    assert rates == [workload.rate_60s_hz for _, _, workload in TOLD]


FRAME_BYTES = 900 * 720 * 4


@pytest.fixture
def stand_in(run: Path) -> Iterator[None]:
    """For ffmpeg: writes how many bytes came, so that it runs everywhere."""
    program = run.parent / "ffmpeg"
    program.write_text(
        f"#!{sys.executable}\nimport sys\nopen(sys.argv[-1], 'w').write(str(len(sys.stdin.buffer.read())))"
    )
    program.chmod(0o755)
    with matplotlib.rc_context({"animation.ffmpeg_path": str(program)}):
        yield


@pytest.mark.usefixtures("stand_in")
def test_a_video_has_a_frame_for_each_view(run: Path, capsys: Printed) -> None:
    """As far as it may be so long; what is left out is told."""
    assert export(run, "mp4") == 0
    assert int(run.with_name("run.mp4").read_text()) == STEPS * FRAME_BYTES
    assert "views" not in capsys.readouterr().err
    assert export(run, "mp4", "--longest-s", "0.2", "--force") == 0
    assert int(run.with_name("run.mp4").read_text()) == 4 * FRAME_BYTES
    assert "1 of 3 views" in capsys.readouterr().err
    assert export(run, "mp4", "--longest-s", "0", "--force") == 0
    assert int(run.with_name("run.mp4").read_text()) == STEPS * FRAME_BYTES
    assert export(run, "csv", "--longest-s", "9") == 2


def test_a_video_names_events_by_their_arrival() -> None:
    """A name stays with its event while others come and go."""
    picture = Picture(Film(Path(), Recording(), 100.0, 100.0, []))

    def names(*events: int) -> list[str]:
        states = tuple(EventState(event, 1.0, 1.0, float(event), None, None, None, 0.0) for event in events)
        picture.show(Snapshot(1, 1.0, (), states))
        return [name.get_text() for name in picture.figure.axes[0].texts]

    assert names(7) == ["e1"]
    assert names(9, 8, 7) == ["e3", "e2", "e1"]
    assert names(9) == ["e3"]


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="there is no ffmpeg on this machine")
def test_ffmpeg_makes_a_video(run: Path) -> None:
    """An MP4 file, by its first box."""
    assert export(run, "mp4") == 0
    assert run.with_name("run.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_video_needs_ffmpeg(run: Path, capsys: Printed) -> None:
    """What is missing is named, and nothing is left behind."""
    with matplotlib.rc_context({"animation.ffmpeg_path": "no-such-ffmpeg"}):
        assert export(run, "mp4") == 2
    assert "ffmpeg" in capsys.readouterr().err
    assert [path.name for path in run.parent.iterdir()] == ["run"]


@pytest.mark.parametrize(("name", "library"), [("rosbag2", "rosbags"), ("rrd", "rerun")])
def test_a_missing_library_is_named_with_its_extra(
    run: Path, name: str, library: str, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.delitem(sys.modules, f"deltaswarm_orchestrator.export.{name}", raising=False)
    for module in [module for module in sys.modules if module.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, library, None)
    assert export(run, name) == 2
    assert "deltaswarm[export]" in capsys.readouterr().err


def test_an_export_replaces_its_like_alone_and_with_force(run: Path) -> None:
    """Nothing is overwritten without --force, and with it no folder that holds anything else."""
    for name in ("csv", "rosbag2", "rrd"):
        assert export(run, name) == 0
        assert export(run, name) == 2
        assert export(run, name, "--force") == 0
    assert export(run, "csv", "--out", str(run), "--force") == 2
    assert (run / "recording.mcap").exists()
    assert export(run, "rrd", "--out", str(run), "--force") == 2
    notes, own = run.parent / "notes.txt", run.parent / "own"
    notes.write_text("mine")
    own.mkdir()
    (own / "events.csv").write_text("x_m,y_m\n")
    for name, out in (("mcap", notes), ("csv", own)):
        assert export(run, name, "--out", str(out), "--force") == 2
    assert (notes.read_text(), (own / "events.csv").read_text()) == ("mine", "x_m,y_m\n")
    assert not list(run.parent.glob(".deltaswarm-*"))


def test_an_export_replaces_no_result_of_a_run(run: Path, tmp_path: Path) -> None:
    """Though it has the form of one."""
    other = tmp_path / "other"
    assert main(["run", "smoke", "--set", "run.duration_s=20", "--in-process", "-q", "--out", str(other)]) == 0
    recording = (other / "recording.mcap").read_bytes()
    assert export(run, "mcap", "--out", str(other / "recording.mcap"), "--force") == 2
    assert (other / "recording.mcap").read_bytes() == recording


def test_a_recording_that_was_cut_off_is_exported_as_far_as_it_goes(run: Path, capsys: Printed) -> None:
    """With a word about it; a file may be given instead of a folder."""
    data = (run / "recording.mcap").read_bytes()
    cut = run.parent / "cut.mcap.part"
    cut.write_bytes(data[: len(data) // 2])
    assert export(cut, "csv") == 0
    assert "incomplete" in capsys.readouterr().err
    assert (run.parent / "cut-csv" / "poses.csv").exists()


def test_what_is_no_recording_is_refused(tmp_path: Path, capsys: Printed) -> None:
    (tmp_path / "notes.txt").write_text("no recording at all")
    for path in (tmp_path, tmp_path / "notes.txt", tmp_path / "nothing"):
        assert export(path, "csv") == 2
        assert str(path) in capsys.readouterr().err


def test_a_recording_without_a_valid_scenario_is_refused(run: Path, capsys: Printed) -> None:
    """A bit flipped in its text, which is not compressed; or the file was cut off after its first bytes."""
    file = run / "recording.mcap"
    data = file.read_bytes()
    for damaged in (data.replace(b"[arena]", b"[are=a]", 1), data[:8]):
        file.write_bytes(damaged)
        assert export(run, "csv") != 0
        assert str(file) in capsys.readouterr().err


def test_roles_of_any_name_are_exported(tmp_path: Path) -> None:
    """ROS allows letters, digits and _ in a topic; a role may be any printable text."""
    (tmp_path / "run").mkdir()
    odd = [AgentState(0, 1.0, 2.0, "9 lives/day", 0, NOBODY), AgentState(1, 3.0, 4.0, "~", 0, NOBODY)]
    told: list[Truth] = [truth(*odd), truth(odd[0])]
    with Recorder(tmp_path / "run", SCENARIO) as recorder:
        for one in told:
            recorder.step(one, ())
        recorder.complete({})
    for name in ("csv", "rosbag2", "rrd"):
        assert export(tmp_path / "run", name) == 0
    with AnyReader([tmp_path / "run-rosbag2"], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        counts = Counter(connection.topic for connection, _, _ in reader.messages())
    assert counts == {"/swarm/_9_lives_day": 2, "/swarm/_": 2, "/events": 2}


def test_the_command_line_offers_every_format() -> None:
    """It names them, and what can be recorded, itself, since it must not load what they need."""
    assert set(command.FORMATS) == set(FORMATS)
    assert run_command.RECORDS == RECORDS


def cut_off(run: Path) -> Path:
    """The recording of a killed run, in many chunks, the last of which was not written to its end."""
    shutil.rmtree(run)
    run.mkdir()
    clock = itertools.count()
    with Recorder(run, SCENARIO, wall=lambda: float(next(clock))) as recorder:
        for told, reports, _ in TOLD:
            recorder.step(told, reports)
        data = (run / "recording.mcap.part").read_bytes()
    part = run / "recording.mcap.part"
    part.write_bytes(data[:-20])
    return part


def messages_in(file: Path) -> list[tuple[str, int, int, bytes]]:
    """Topic, times and data of all messages, by the index of the file; a file without one is refused."""
    with file.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_summary() is not None
        return [(c.topic, m.log_time, m.sequence, m.data) for _, c, m in reader.iter_messages()]


def test_a_whole_mcap_is_made_of_one_that_was_cut_off(run: Path, capsys: Printed) -> None:
    """Other readers need the index at its end; all of its records up to the cut are there, each once."""
    whole = messages_in(run / "recording.mcap")
    part = cut_off(run)
    with part.open("rb") as stream, pytest.raises(McapError):
        make_reader(stream).get_summary()
    assert export(part, "mcap", "--out", str(run / "new.mcap")) == 0
    assert "incomplete" in capsys.readouterr().err
    kept = messages_in(run / "new.mcap")
    steps_kept = {step for topic, _, step, _ in kept if topic == "/swarm/state"}
    assert steps_kept == set(range(len(steps_kept)))
    assert len(steps_kept) >= STEPS - 2
    assert {row for row in kept if row[0] == "/tf"} <= set(whole)
    with (run / "new.mcap").open("rb") as stream:
        assert [a.name for a in make_reader(stream).iter_attachments()] == ["scenario.toml", "layout.json"]
    assert export(run / "new.mcap", "mcap", "--out", str(run / "again.mcap")) == 0
    assert messages_in(run / "again.mcap") == kept
    assert export(run / "new.mcap", "mcap", "--out", str(run / "new.mcap"), "--force") == 2


def test_a_complete_recording_is_copied_with_its_manifest(run: Path, capsys: Printed) -> None:
    assert export(run, "mcap") == 0
    assert capsys.readouterr().err == ""
    assert messages_in(run.with_name("run.mcap")) == messages_in(run / "recording.mcap")
    assert read_recording(run.with_name("run.mcap")).complete


def test_the_recording_of_a_killed_run_gets_its_end(run: Path) -> None:
    """In place, once; what was recorded stays, and nothing else is left in the folder."""
    part = cut_off(run)
    before = read_recording(part)
    assert finish_recordings(run) == [part]
    assert messages_in(part)
    assert read_recording(part) == before
    assert finish_recordings(run) == []
    assert {path.name for path in run.iterdir()} <= {part.name, "layout.json", ".lock"}


def test_a_file_that_is_no_recording_hides_no_other(run: Path) -> None:
    """Whatever has the name of the raw frames: the recording beside it gets its end."""
    part = cut_off(run)
    (run / "wire.mcap.part").write_text("no recording at all")
    assert finish_recordings(run) == [part]
    assert (run / "wire.mcap.part").read_text() == "no recording at all"


@pytest.mark.parametrize("reason", ["held", "damaged", "read-only"])
def test_a_recording_is_left_alone(run: Path, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """While a run writes it, where more than its end is missing, and where nothing can be written."""
    part = cut_off(run)
    data = bytearray(part.read_bytes())
    lock = FolderLock(run) if reason == "held" else None
    if reason == "damaged":
        place = data.index(b"[arena]")
        data[place : place + 7] = b"[harem]"
        part.write_bytes(data)
    if reason == "read-only":
        monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(PermissionError(1, "not permitted")))
    assert finish_recordings(run) == []
    assert part.read_bytes() == data
    assert not list(run.glob("*.whole"))
    if lock:
        lock.release()


@pytest.mark.parametrize("seed", range(30))
def test_damage_anywhere_is_reported_and_never_a_traceback(run: Path, seed: int, capsys: Printed) -> None:
    """Changed bytes, zeros as after a power failure, pieces of elsewhere: exported up to there, or refused."""
    file = run / "recording.mcap"
    data, draw = bytearray(file.read_bytes()), random.Random(seed)
    place, size = draw.randrange(len(data)), draw.choice([1, 20, 200])
    other = draw.randrange(len(data) - size)
    data[place : place + size] = draw.choice([bytes(size), draw.randbytes(size), data[other : other + size]])
    file.write_bytes(data)
    for name in ("csv", "mcap"):
        code = export(run, name)
        errors = capsys.readouterr().err
        assert code in (0, 2)
        assert (code == 0) == run.with_name(f"run{FORMATS[name].suffix}").exists()
        assert "Traceback" not in errors
        assert code == 0 or errors.count("\n") == 1
