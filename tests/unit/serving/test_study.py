"""Who takes part, as the service keeps it, where several things happen at once."""

import asyncio
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from websockets.datastructures import Headers

from deltaswarm_operator.station.room import Room
from deltaswarm_operator.station.rules import OPERATE, WATCH
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.run.journal import BEGIN, STEP, Header, Journal, Row
from deltaswarm_serving.front import Front
from deltaswarm_serving.hosting import Hosted, Plan
from deltaswarm_serving.line import Line
from deltaswarm_serving.relayed import RelayedRunner
from deltaswarm_serving.routes import Site
from deltaswarm_serving.runner import HostedRunner
from deltaswarm_serving.settings import ServeSettings
from deltaswarm_serving.study import Study
from deltaswarm_serving.unfinished import identity_of, journal_of
from deltaswarm_sessions.folder import locked
from deltaswarm_sessions.links import ENDED, RUNNING, Link, Links
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.session import Session
from deltaswarm_sessions.settings import load_session
from tests.support.sessions import a_file


class Starting(Hosted):
    """A session whose process needs a while to start: meanwhile something happens."""

    meanwhile: Any = None

    async def start(self, plan: Plan, on_end: Any) -> None:
        self.meanwhile()
        self.process, self.is_let_go = SimpleNamespace(pid=0, send_signal=lambda _: None), False  # type: ignore[assignment]


def a_study(folder: Path, **keys: Any) -> tuple[Study, Link, Starting]:
    settings, _ = load_session(str(a_file(folder, 2)))
    links = Links()
    link = links.add(1)
    study = Study(settings, ServeSettings(**keys), Plan(folder / "study.toml", folder), links, Line(2))
    hosted = study.hosted[link.token] = Starting(link)
    hosted.meanwhile = lambda: None
    study.agree(link)
    return study, link, hosted


def test_a_session_that_is_ended_while_it_starts_stays_ended(tmp_path: Path) -> None:
    study, link, hosted = a_study(tmp_path)
    hosted.meanwhile = lambda: study.end(1)
    asyncio.run(study.admit([link.token]))
    assert (link.state, hosted.is_let_go, study.line.inside) == (ENDED, True, set())


def test_a_session_is_let_go_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second signal would break off the end of a run."""
    study, link, hosted = a_study(tmp_path, absent_after_s=1.0)
    asyncio.run(study.admit([link.token]))
    assert link.state == RUNNING
    signals: list[int] = []
    monkeypatch.setattr(hosted.process, "send_signal", signals.append)
    hosted.seen_s -= 5.0
    for _ in range(3):
        asyncio.run(study.admit([]))
    assert len(signals) == 1


def test_who_only_watches_keeps_nobodys_place(tmp_path: Path) -> None:
    study, link, hosted = a_study(tmp_path)
    front = Front(study, Site("127.0.0.1"), {})
    room = hosted.pages = Room(lambda: None)
    watcher, person = SimpleNamespace(role=WATCH), SimpleNamespace(role=OPERATE)
    room._browsers = {1: watcher}  # type: ignore[dict-item]
    assert front._inside == set()
    assert hosted.absent_s(hosted.seen_s + 50.0) == 50.0
    room._browsers = {1: watcher, 2: person}  # type: ignore[dict-item]
    assert front._inside == {link.token}
    assert hosted.absent_s(hosted.seen_s + 50.0) == 0.0


@pytest.mark.parametrize(("is_tls", "address"), [(False, "203.0.113.9"), (True, "198.51.100.1")])
def test_only_a_proxy_may_name_addresses(is_tls: bool, address: str, tmp_path: Path) -> None:
    """A service that speaks TLS itself is behind none: anybody could count as many people."""
    study, _, _ = a_study(tmp_path)
    site = Site("127.0.0.1", "https://study.example.org", is_tls=is_tls)
    connection = SimpleNamespace(remote_address=("198.51.100.1", 5000))
    request = SimpleNamespace(headers=Headers({"X-Forwarded-For": "192.0.2.7, 203.0.113.9"}))
    assert Front(study, site, {})._address(connection, request) == address  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [HostedRunner, RelayedRunner])
def test_what_was_cut_off_is_put_aside_by_who_has_the_session(
    kind: type[HostedRunner], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And only if it can go on: by processes the run is done again, and what was cut off is an attempt."""
    # A real channel ends its process when it is closed.
    monkeypatch.setattr("deltaswarm_serving.runner.Channel", lambda *_: None)
    settings, beside = load_session(str(a_file(tmp_path, 1)))
    runs = plan(settings, 1, beside)
    folder = tmp_path / "participant-001"
    runner = kind(session=Session(1, runs), folder=folder, speed=1.0, ends=socket.socketpair())
    cut_off = folder / f"{runs[0].folder}.part"
    cut_off.mkdir(parents=True)
    identity = identity_of(runs[0], runner._inputs[runs[0].folder], 1.0)
    journal = Journal(journal_of(folder, runs[0]), Header.now(runs[0].folder, identity))
    for row in (Row(BEGIN, 1.0), Row(STEP, 2.0)):
        journal.append(row)
    journal.close()
    other = locked(folder)
    with pytest.raises(CommandError):
        runner.begin()
    assert cut_off.exists()
    assert journal_of(folder, runs[0]).exists()
    other.release()
    runner.begin()
    can_go_on = kind is HostedRunner
    assert (cut_off.exists(), journal_of(folder, runs[0]).exists()) == (not can_go_on, can_go_on)
    runner._lock.release()
