"""Pictures of the truth for those who look on: what is in them, and that no reader makes a run wait."""

import json
import socket
import stat
from pathlib import Path

import orjson
import pytest

from deltaswarm_orchestrator.live import views
from deltaswarm_orchestrator.live.observers import Paced, Tap
from deltaswarm_orchestrator.live.views import (
    LIVE_SOCKET,
    LiveSocket,
    ResearcherFeed,
    connected,
    hello,
    picture,
)
from deltaswarm_scenario.page_messages import FROM_PAGE
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from tests.support.looking import BODIES, EVENTS, STATUS, WORKLOAD, Seen, a_truth, always, pair, received, shown

SCENARIO = load(Scenario, {"name": "here", "uplink": {"base_m": [50.0, 40.0], "range_m": 20.0}})


def test_hello_says_what_does_not_change() -> None:
    """Arena, base, thresholds, length; and that the researcher looks on, who commands nothing."""
    said = orjson.loads(hello("here-1", SCENARIO))
    assert (said["type"], said["kind"], said["run"]) == ("hello", "researcher", "here-1")
    assert said["title"] == f"here, {SCENARIO.control.mode}"
    assert (said["arena_m"], said["base_m"], said["range_m"]) == ([100.0, 100.0], [50.0, 40.0], 20.0)
    assert said["duration_s"] == SCENARIO.run.duration_s
    assert said["thresholds_hz"] == [SCENARIO.operator.threshold_hz]
    assert (said["commands"], said["session"]) == ([], None)


def test_a_picture_has_the_truth_and_no_report() -> None:
    """Every agent with role, parent and root, to a millimetre; every event that is not complete; nothing reported."""
    said = shown(Seen())
    assert (said["type"], said["step"], said["time_s"], said["over"]) == ("picture", 7, 7.0, False)
    assert said["truth"]["agents"][:2] == [[0, 10.0, 20.0, "root", -1, 0, 0], [1, 11.0, 20.0, "member", 0, 0, 0]]
    assert len(said["truth"]["agents"]) == len(BODIES)
    assert said["truth"]["events"] == [[EVENTS[0].event, 92.0, 70.0, 3.0]]
    assert (said["agents"], said["events"], said["inbox"], said["commands"]) == ([], [], [], [])
    assert said["workload"] == {
        "messages": 41,
        "rate_1s_hz": WORKLOAD.rate_1s_hz,
        "rate_60s_hz": WORKLOAD.rate_60s_hz,
        "senders": WORKLOAD.senders,
        "residue": 0.0,
        "above_s": [WORKLOAD.time_above_s],
    }
    assert said["status"] == STATUS._asdict()


def test_a_picture_shows_what_there_is() -> None:
    """Before anything is heard there is none; a run that is not recorded has no truth; an ended one says so."""
    assert picture(Seen(None, None, None, None)) is None
    waiting = shown(Seen(STATUS._replace(phase="waiting"), None, None, None))
    assert (waiting["truth"], waiting["workload"]["messages"]) == (None, None)
    assert shown(Seen(STATUS._replace(phase="ended")))["over"]


def test_the_researchers_feed_greets_first_and_then_shows() -> None:
    """One hello, then a picture each time that it is due."""
    ours, theirs = pair()
    feed = ResearcherFeed(ours, "here-1", SCENARIO, always())
    for step in (7, 8):
        feed.look(Seen(newest_truth=a_truth(step)))
    found = received(theirs)
    assert [one["type"] for one in found] == ["hello", "picture", "picture"]
    assert [one["step"] for one in found[1:]] == [7, 8]
    ours.close()


def test_the_feed_shows_ten_pictures_per_second_at_most() -> None:
    """Of wall time, however fast the run is."""
    now_s = [0.0]
    ours, theirs = pair()
    feed = ResearcherFeed(ours, "here-1", SCENARIO, Paced(lambda: now_s[0]))
    for tick in range(1000):
        now_s[0] = tick / 1000
        feed.look(Seen())
    assert len(received(theirs)) == 1 + 10
    ours.close()


def test_a_station_that_does_not_read_makes_nobody_wait() -> None:
    """What finds no room is dropped; once it reads again, it gets what is new."""
    ours, theirs = pair()
    feed = ResearcherFeed(ours, "here-1", SCENARIO, always())
    for step in range(20_000):
        feed.look(Seen(newest_truth=a_truth(step)))
    kept = received(theirs)
    assert len(kept) < 5_000
    feed.look(Seen(newest_truth=a_truth(20_000)))
    assert [one["step"] for one in received(theirs)] == [20_000]
    theirs.close()
    for _ in range(3):  # it went
        feed.look(Seen())


def test_the_researchers_page_is_told_that_it_only_looks_on() -> None:
    """Whatever a browser asks for is refused, or empty; nonsense is dropped."""
    ours, theirs = pair()
    feed = ResearcherFeed(ours, "here-1", SCENARIO, always())
    feed.look(Seen())
    received(theirs)
    asked = sorted(kind for kind, form in FROM_PAGE.items() if kind != "catch_up" and not form.is_notice)
    for kind in asked:
        theirs.send(json.dumps({"type": kind, "from": 17}).encode())
    for nonsense in (b"[]", b"7", b"\xff", b'{"type":"pace"}', b'{"type":"page","from":1}'):
        theirs.send(nonsense)
    feed.look(Seen())
    *refused, shown_next = received(theirs)
    assert [(said["type"], said["to"], said["id"], said["why"]) for said in refused] == [
        ("refused", 17, kind, "the researcher's view only looks on") for kind in asked
    ]
    assert shown_next["type"] == "picture"
    theirs.send(b'{"type":"catch_up","from":18}')
    feed.look(Seen())
    caught_up, shown_next = received(theirs)
    assert (caught_up["type"], caught_up["to"], caught_up["inbox"]) == ("catch_up", 18, [])
    assert caught_up["history"] == [[WORKLOAD.time_s, WORKLOAD.rate_1s_hz, WORKLOAD.rate_60s_hz]]
    assert shown_next["type"] == "picture"
    ours.close()


def test_the_socket_is_the_owners_and_goes_with_the_run(tmp_path: Path) -> None:
    """Nobody else may connect, from its first moment on; nothing is left of it."""
    with LiveSocket(tmp_path, "here-1", SCENARIO, always()):
        mode = (tmp_path / LIVE_SOCKET).stat().st_mode
        assert stat.S_ISSOCK(mode)
        assert stat.S_IMODE(mode) == 0o600
    assert list(tmp_path.iterdir()) == []


def test_readers_come_and_go(tmp_path: Path) -> None:
    """Each is greeted, sees what is new while it is there, and one that went is forgotten."""
    with LiveSocket(tmp_path, "here-1", SCENARIO, always()) as live:
        first = connected(tmp_path, 1.0)
        live.look(Seen())
        second = connected(tmp_path, 1.0)
        for _ in range(2):
            live.look(Seen())
        for end, count in ((first, 3), (second, 2)):
            end.setblocking(False)
            assert [one["type"] for one in received(end)] == ["hello", *["picture"] * count]
        first.close()
        live.look(Seen())
        live.look(Seen())
        assert len(received(second)) == 2
    second.setblocking(True)
    assert second.recv(100) == b"", "it is told that the run has ended"
    second.close()


def test_no_more_than_so_many_readers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next is let in when one leaves."""
    monkeypatch.setattr(views, "MAX_READERS", 1)
    with LiveSocket(tmp_path, "here-1", SCENARIO, always()) as live:
        first, second = connected(tmp_path, 1.0), connected(tmp_path, 1.0)
        second.setblocking(False)
        live.look(Seen())
        live.look(Seen())
        assert received(second) == []
        first.close()
        live.look(Seen())
        live.look(Seen())
        assert received(second)[0]["type"] == "hello"
        second.close()


def test_a_folder_with_a_long_name_has_a_socket(tmp_path: Path) -> None:
    """Though an address has room for 108 bytes; the socket of a run that was killed is replaced."""
    folder = tmp_path / ("x" * 200)
    folder.mkdir()
    left = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with views.short_path(folder / LIVE_SOCKET) as name:
        left.bind(name)
    left.close()
    with pytest.raises(ConnectionRefusedError):
        connected(folder, 1.0)
    with LiveSocket(folder, "here-1", SCENARIO, always()) as live, connected(folder, 1.0) as end:
        live.look(Seen())
        assert orjson.loads(end.recv(10_000))["type"] == "hello"


def test_where_there_can_be_no_socket_the_run_goes_on(tmp_path: Path) -> None:
    """Nobody can look on, and nothing fails."""
    with LiveSocket(tmp_path / "nowhere", "here-1", SCENARIO, always()) as live:
        live.look(Seen())


def test_nobody_there_costs_no_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a reader none is made."""
    monkeypatch.setattr(views, "picture", lambda seen: pytest.fail("a picture for nobody"))
    with LiveSocket(tmp_path, "here-1", SCENARIO, always()) as live:
        for _ in range(100):
            live.look(Seen())


class Heard:
    """A sink, and an observer, that note what they get."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.seen: list[tuple[int, int | None]] = []

    def __getattr__(self, name: str) -> object:
        return lambda *arguments: self.calls.append(name)

    def look(self, seen: Seen) -> None:
        assert seen.newest_truth is not None
        self.seen.append((seen.newest_truth.step, seen.messages))


def test_a_tap_hands_on_everything() -> None:
    """The recorder of a run in one process gets what it would get anyway; observers see each step."""
    heard = Heard()
    tap = Tap(heard, [heard])  # type: ignore[list-item, arg-type]
    for step in (0, 1):
        tap.step(a_truth(step), ())
        tap.workload(WORKLOAD)
    tap.log(20, "world", "text", 1.0)
    tap.radio(0, 1, b"")
    assert heard.calls == ["step", "workload", "step", "workload", "log", "radio"]
    assert heard.seen == [(0, 3), (1, 6)]
