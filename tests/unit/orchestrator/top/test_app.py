"""`deltaswarm top` on a pretended terminal: what it shows, its keys, and a run that comes to its end."""

import asyncio
import os
import socket
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.widgets import Sparkline, Static, TabbedContent

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.live.views import LIVE_SOCKET, LiveSocket, short_path
from deltaswarm_orchestrator.results.folder import RunFolder
from deltaswarm_orchestrator.top.app import BANNER, NO_TRUTH, Top
from deltaswarm_orchestrator.top.link import Link, NoRunError, linked
from deltaswarm_scenario.scenario import Scenario
from tests.support.complaints import Printed
from tests.support.looking import STATUS, Seen, a_truth, always

SCENARIO = Scenario(name="here")


def on_screen(folder: Path, seen: Seen, use: Callable[[Top, LiveSocket, Pilot[None]], Awaitable[None]]) -> None:
    """Attach to a pretended run, and use the terminal."""

    async def begin() -> None:
        with LiveSocket(folder, "here-1", SCENARIO, always()) as live:
            app = Top(linked(folder, Path()))
            live.look(seen)  # type: ignore[arg-type]
            async with app.run_test(size=(120, 40)) as pilot:
                await use(app, live, pilot)

    asyncio.run(begin())


def text(app: Top, name: str) -> str:
    return str(app.query_one(f"#{name}", Static).render())


def test_it_shows_map_rate_and_agents(tmp_path: Path) -> None:
    """And says on its screen that it shows the truth."""

    async def use(app: Top, live: LiveSocket, pilot: Pilot[None]) -> None:
        app.draw()
        await pilot.pause()
        app.draw()
        assert text(app, "banner") == BANNER
        assert "A" in text(app, "map")
        assert "attending" in text(app, "agents-table")
        assert "3.0 per s" in text(app, "summary")
        assert app.query_one("#rates", Sparkline).data == [3.0]
        assert app.title == f"here, {SCENARIO.control.mode}"

    on_screen(tmp_path, Seen(), use)


def test_keys_change_between_agents_and_events(tmp_path: Path) -> None:
    """And q leaves; the run stays as it is."""

    async def use(app: Top, live: LiveSocket, pilot: Pilot[None]) -> None:
        await pilot.press("e")
        await pilot.pause()
        assert app.query_one(TabbedContent).active == "events"
        assert "4 s" in text(app, "events-table")
        await pilot.press("a")
        assert app.query_one(TabbedContent).active == "agents"
        await pilot.press("q")
        assert not app.is_running
        live.look(Seen())

    on_screen(tmp_path, Seen(), use)


def test_it_follows_the_run_to_its_end(tmp_path: Path) -> None:
    """The newest picture is shown, older ones are left out; the last one stays."""

    async def use(app: Top, live: LiveSocket, pilot: Pilot[None]) -> None:
        for step in range(8, 20):
            live.look(Seen(newest_truth=a_truth(step)))
        app.draw()
        assert "step 19" in text(app, "summary")
        live.__exit__(None, None, None)
        app.draw()
        assert "the run has ended" in text(app, "banner")
        assert "step 19" in text(app, "summary")
        await pilot.resize_terminal(80, 24)
        await pilot.pause()
        assert "A" in text(app, "map")

    on_screen(tmp_path, Seen(), use)


def test_a_run_without_a_recording_has_figures_and_no_map(tmp_path: Path) -> None:
    """It says why, and what to do."""

    async def use(app: Top, live: LiveSocket, pilot: Pilot[None]) -> None:
        app.draw()
        await pilot.pause()
        assert text(app, "map") == NO_TRUTH
        assert "11 in trees" in text(app, "summary")

    on_screen(tmp_path, Seen(STATUS, None, None, None), use)


def test_the_newest_run_is_found(tmp_path: Path) -> None:
    """Below the current folder, also in a sweep; one that was killed left a socket that leads nowhere."""
    old, new, killed = (tmp_path / name for name in ("runs/old.part", "sweeps/all/new.part", "runs/killed.part"))
    for folder in (old, new, killed):
        folder.mkdir(parents=True)
    with LiveSocket(old, "old", SCENARIO), LiveSocket(new, "new", SCENARIO):
        left = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with short_path(killed / LIVE_SOCKET) as name:
            left.bind(name)
        left.close()
        for age_s, folder in enumerate((killed, new, old)):
            os.utime(folder / LIVE_SOCKET, (1e9 - age_s, 1e9 - age_s))
        link = linked(None, tmp_path)
        assert link.folder == new
        link.end.close()
        named = linked(old.with_name("old"), tmp_path)
        assert named.folder == old
        named.end.close()


@pytest.mark.parametrize("exists", [False, True])
def test_without_a_run_it_says_so(tmp_path: Path, exists: bool) -> None:
    """Whether or not a folder is named; and what to do."""
    if exists:
        (tmp_path / "runs" / "first").mkdir(parents=True)
    with pytest.raises(NoRunError, match="start one with `deltaswarm run`"):
        linked(None, tmp_path)
    with pytest.raises(NoRunError, match="deltaswarm info" if exists else "must be the folder"):
        linked(tmp_path / "runs" / "first", tmp_path)


def test_a_run_that_cannot_be_looked_at_is_told_from_one_that_ended(tmp_path: Path) -> None:
    """A folder that somebody writes to, without a socket."""
    message = "is in progress but cannot be watched"
    with RunFolder(tmp_path / "run", force=False) as folder, pytest.raises(NoRunError, match=message):
        linked(folder.target, tmp_path)


def test_a_link_keeps_the_newest_picture() -> None:
    """However many have come."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    link = Link(theirs, Path())
    assert not link.receive()
    for data in (b'{"type":"hello"}', b'{"step":1}', b'{"step":2}'):
        ours.send(data)
    assert link.receive()
    assert (link.hello, link.picture) == ({"type": "hello"}, {"step": 2})
    ours.close()
    assert not link.wait() or link.picture
    assert link.is_over


def test_the_command_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    """A terminal, the extra, a run: exit codes as everywhere."""
    monkeypatch.chdir(tmp_path)
    assert main(["top"]) == 2
    assert "--json" in capsys.readouterr().err
    assert main(["top", "--json"]) == 1
    assert "no run in progress that can be watched" in capsys.readouterr().err
    for stream in ("stdin", "stderr"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: True)
    monkeypatch.delitem(sys.modules, "deltaswarm_orchestrator.top.app")
    monkeypatch.setitem(sys.modules, "textual.app", None)
    assert main(["top"]) == 2
    assert "pip install 'deltaswarm[top]'" in capsys.readouterr().err
