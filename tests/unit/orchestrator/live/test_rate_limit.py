"""What a live viewer is shown: the newest of each topic ten times per second, and every line of log."""

import itertools
from pathlib import Path

import pytest

from deltaswarm_orchestrator.live.rate_limit import MAX_WAITING, RateLimited, ViewersOnly
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_orchestrator.recording.schemas import TOPICS
from deltaswarm_orchestrator.recording.transcriber import Transcriber
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from tests.support.truths import messages, steps

SCENARIO = load(Scenario, {"agents": {"count": 12}})


class Screen:
    """A viewer whose clock stands until it is told, and what it was sent."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.sent: list[tuple[str, float, bytes]] = []
        self.viewer = RateLimited(lambda *one: self.sent.append(one), lambda: self.now_s)

    def taken(self) -> list[tuple[str, float, bytes]]:
        sent, self.sent = self.sent, []
        return sent


def test_the_newest_of_each_topic_is_shown_ten_times_per_second() -> None:
    """What came between is left out."""
    screen = Screen()
    for step in range(1000):
        screen.now_s = step / 1000
        screen.viewer.put("/tf", float(step), b"%d" % step)
        screen.viewer.tick()
    shown = [time_s for _, time_s, _ in screen.taken()]
    assert len(shown) == 10
    assert all(99 <= later - earlier <= 101 for earlier, later in itertools.pairwise(shown))


def test_the_log_and_events_are_not_thinned() -> None:
    """No line stands in for another; of very many the newest are kept."""
    screen = Screen()
    screen.viewer.put("/tf", 0.0, b"")
    screen.viewer.tick()
    screen.taken()
    for number in range(MAX_WAITING + 5):
        screen.viewer.put("/log", 1.0, b"%d" % number)
    screen.viewer.tick()
    assert screen.taken() == [], "not due yet"
    screen.now_s = 0.2
    screen.viewer.tick()
    assert [data for _, _, data in screen.taken()] == [b"%d" % number for number in range(5, MAX_WAITING + 5)]


def test_the_end_of_a_run_is_shown_though_it_is_not_due() -> None:
    """No tick follows it."""
    screen = Screen()
    screen.viewer.put("/tf", 0.0, b"first")
    screen.viewer.tick()
    screen.viewer.put("/swarm/event", 1.0, b"last")
    screen.viewer.later(1.0, lambda: [("/tf", b"last")])
    screen.viewer.tick()
    screen.viewer.flush()
    assert {topic: data for topic, _, data in screen.taken()} == {"/tf": b"last", "/swarm/event": b"last"}


def test_who_comes_late_is_shown_all() -> None:
    """Also the topics that are told when they change; and in a run that stands still."""
    screen = Screen()
    screen.viewer.put("/swarm/agents", 1.0, b"a")
    screen.viewer.put("/tf", 1.0, b"b")
    screen.viewer.tick()
    screen.taken()
    screen.now_s = 5.0
    screen.viewer.tick()
    assert screen.taken() == []
    screen.viewer.show_all()
    screen.viewer.tick()
    assert {topic for topic, _, _ in screen.taken()} == {"/swarm/agents", "/tf"}


def test_a_slow_run_is_shown_at_once() -> None:
    """A moment at which there was nothing to show is not the last for a while."""
    screen = Screen()
    screen.now_s = 1.0
    screen.viewer.tick()
    screen.now_s = 1.01
    screen.viewer.put("/tf", 1.0, b"")
    screen.viewer.tick()
    assert len(screen.taken()) == 1


def test_what_is_shown_is_what_is_recorded(tmp_path: Path) -> None:
    """The same bytes go to the file and to the viewer; a viewer changes no byte of the file."""
    files = []
    screen = Screen()
    for viewer in (None, screen.viewer):
        folder = tmp_path / ("shown" if viewer else "alone")
        folder.mkdir()
        with Recorder(folder, SCENARIO, wall=lambda: 0.0, viewer=viewer) as recorder:
            for truth, reports, workload in steps(SCENARIO, 20):
                screen.now_s = float(truth.step)
                recorder.step(truth, reports)
                recorder.workload(workload)
            recorder.complete({})
        files.append((folder / "recording.mcap").read_bytes())
    assert files[0] == files[1]
    recorded = {(topic, message.SerializeToString()) for topic, _, message in messages(folder / "recording.mcap")}
    shown = screen.taken()
    assert {(topic, TOPICS[topic].FromString(data).SerializeToString()) for topic, _, data in shown} <= recorded
    assert {topic for topic, _, _ in shown} == TOPICS.keys() - {"/log"}


def test_without_a_recording_views_are_made_when_they_are_due(monkeypatch: pytest.MonkeyPatch) -> None:
    """All topics are shown, and a step that nobody is shown costs little."""
    screen = Screen()
    sink = ViewersOnly(SCENARIO, screen.viewer, lambda: 0.0)
    views, made = Transcriber.views, list[int]()
    monkeypatch.setattr(Transcriber, "views", lambda self, truth: made.append(1) or views(self, truth))
    for truth, reports, workload in steps(SCENARIO, 100):
        screen.now_s = truth.step / 100
        sink.step(truth, reports)
        sink.workload(workload)
        sink.log(20, "world", "text", truth.time_s)
    assert 8 <= len(made) <= 11
    shown = screen.taken()
    assert {topic for topic, _, _ in shown} == set(TOPICS)
    lines = [time_s for topic, time_s, _ in shown if topic == "/log"]
    assert lines == [float(step) for step in range(len(lines))]
    screen.now_s = 9.0
    screen.viewer.tick()
    last = {topic: time_s for topic, time_s, _ in screen.taken()}
    assert last["/tf"] == 99.0, "the last step is shown, though it was not due"
