"""The station's process over real sockets: what it serves, whom it lets in, and that nobody can hold it up."""

import http.client
import json
import re
import select
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from deltaswarm_operator.station import room, rules, server, visitors
from deltaswarm_scenario.page_messages import FROM_PAGE
from tests.support.station_feed import PATIENCE_S, Feed, Message, Swarm

pytestmark = pytest.mark.processes

HELLO = Swarm().hello()


@pytest.fixture
def feed() -> Iterator[Feed]:
    with Feed() as made:
        yield made


def address(feed: Feed) -> tuple[str, str]:
    found = urlsplit(feed.url)
    return found.netloc, found.path.strip("/")


def browser(feed: Feed, **changes: Any) -> ClientConnection:
    """A WebSocket as the page opens it."""
    host, token = address(feed)
    given = {"origin": f"http://{host}", "max_size": 1 << 22, "close_timeout": 1} | changes
    return connect(f"ws://{host}/{token}/live", **given)


def told(client: ClientConnection, kind: str) -> Message:
    while True:
        message: Message = json.loads(client.recv(PATIENCE_S))
        if message["type"] == kind:
            return message


def fetch(feed: Feed, path: str, **headers: str) -> http.client.HTTPResponse:
    """One answer, its body read; the path goes out as it is."""
    link = http.client.HTTPConnection(address(feed)[0], timeout=PATIENCE_S)
    link.request("GET", path, headers=headers)
    answer = link.getresponse()
    answer.body = answer.read()  # type: ignore[attr-defined]
    link.close()
    return answer


def say(feed: Feed, message: Message) -> None:
    """Like `Feed.send`, but wait until the station has room for it."""
    while not select.select([], [feed.socket], [], PATIENCE_S)[1]:
        raise TimeoutError("the station takes nothing")
    feed.socket.send(json.dumps(message, separators=(",", ":")).encode())


def test_the_page_is_served_below_a_token(feed: Feed) -> None:
    """All its files, with their types and with headers that forbid everything from elsewhere."""
    _, token = address(feed)
    assert re.fullmatch(r"[\w-]{32}", token)
    page = fetch(feed, f"/{token}/")
    assert page.status == HTTPStatus.OK
    assert page.headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self'; style-src 'self'")
    assert page.headers["Referrer-Policy"] == "no-referrer"
    assert page.headers["X-Content-Type-Options"] == "nosniff"
    text = page.body.decode()  # type: ignore[attr-defined]
    linked = re.findall(r'(?:src|href)="([^":]+\.(?:js|css))"', text)
    assert sorted(linked) == ["page.css", "page.js"], "few requests, since a link may be slow"
    joined = {name: fetch(feed, f"/{token}/{name}").body.decode() for name in linked}  # type: ignore[attr-defined]
    scripts = [path for path in server.PAGE.glob("*.js") if path.name not in ("door.js", "overview.js")]
    for path in [*scripts, *server.PAGE.glob("*.css")]:
        assert path.read_text().splitlines()[0] in joined[f"page{path.suffix}"], path.name
    for name in linked:
        answer = fetch(feed, f"/{token}/{name}")
        kind = "text/javascript" if name.endswith(".js") else "text/css"
        assert (answer.status, answer.headers["Content-Type"].split(";")[0]) == (HTTPStatus.OK, kind)
    assert "style=" not in text
    assert not re.search(r"\son\w+=|<script>|<style", text)


def test_no_other_path_is_there(feed: Feed) -> None:
    """Neither without the token or with another one, nor out of the page's folder, nor a folder's list."""
    _, token = address(feed)
    others = ["/", "/favicon.ico", f"/{token}", f"/{token[:-1]}/", f"/{token}x/", f"/{'x' * 32}/", f"//{token}/"]
    outside = ["../server.py", "..%2fserver.py", "%2e%2e/server.py", "..\\server.py", "/etc/passwd", "vendor/", "x.js"]
    outside += ["types.d.ts", "vendor/../../server.py", "%00", "."]
    for path in [*others, *(f"/{token}/{name}" for name in outside)]:
        answer = fetch(feed, path)
        assert answer.status == HTTPStatus.NOT_FOUND, path
        assert b"import" not in answer.body  # type: ignore[attr-defined]
    with socket.create_connection(urlsplit(feed.url).netloc.split(":"), PATIENCE_S) as link:  # type: ignore[arg-type]
        link.sendall(b"GET /\xff\xfe/ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert b"HTTP/1.1 200" not in link.recv(4096)
    assert fetch(feed, f"/{token}/").status == HTTPStatus.OK


def test_a_name_from_elsewhere_is_not_answered(feed: Feed) -> None:
    """A page that points its own name at this machine reads nothing, even if it knows the token."""
    _, token = address(feed)
    for host in ("evil.example", "127.0.0.1.evil.example", "", "evil.example:80"):
        assert fetch(feed, f"/{token}/", Host=host).status == HTTPStatus.MISDIRECTED_REQUEST
    assert fetch(feed, f"/{token}/", Host="localhost:9000").status == HTTPStatus.OK


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", None])
def test_a_page_from_elsewhere_opens_no_socket(feed: Feed, origin: str | None) -> None:
    """A browser says whose page opens a WebSocket."""
    with pytest.raises(InvalidStatus) as refused, browser(feed, origin=origin):
        pass
    assert refused.value.response.status_code == HTTPStatus.FORBIDDEN


def test_the_socket_needs_the_token(feed: Feed) -> None:
    host, token = address(feed)
    for path in ("live", f"{token[::-1]}/live", f"{token}/live/", f"{token}/lives"):
        with pytest.raises(InvalidStatus) as refused, connect(f"ws://{host}/{path}", origin=Origin(f"http://{host}")):
            pass
        assert refused.value.response.status_code in (HTTPStatus.NOT_FOUND, HTTPStatus.OK)


def watching(feed: Feed) -> ClientConnection:
    host, path = urlsplit(feed.watch_url).netloc, urlsplit(feed.watch_url).path
    return connect(f"ws://{host}{path}live", origin=Origin(f"http://{host}"), close_timeout=1)


def test_who_watches_is_told_everything_and_forwards_nothing(feed: Feed) -> None:
    """Nothing but the wish to catch up; a watcher is no page of the participant, and the tokens tell nothing."""
    say(feed, HELLO)
    with browser(feed) as person, watching(feed) as watcher:
        assert told(watcher, "role")["role"] == "watch"
        assert told(watcher, "hello") == HELLO
        for kind in sorted(FROM_PAGE.keys() - {"catch_up"}):
            watcher.send(json.dumps({"type": kind, "id": "x"}))
            assert "watches" in told(watcher, "refused")["why"]
        watcher.send('{"type":"catch_up"}')
        person.send('{"type":"note","text":"mine"}')
        heard = [feed.hear_any() for _ in range(3)]
        assert sorted(intent["type"] for intent in heard) == ["catch_up", "note", "page"]
    assert feed.watch_url != feed.url
    assert fetch(feed, urlsplit(feed.watch_url).path).status == HTTPStatus.OK


def test_watchers_do_not_keep_the_participant_out(feed: Feed) -> None:
    say(feed, HELLO)
    with ExitStack() as stack:
        for _ in range(room.MAX_WATCHERS):
            stack.enter_context(watching(feed))
        with pytest.raises(InvalidStatus) as refused:
            stack.enter_context(watching(feed))
        assert refused.value.response.status_code == HTTPStatus.SERVICE_UNAVAILABLE
        with browser(feed) as person:
            assert told(person, "hello") == HELLO


def test_who_comes_late_gets_the_newest(feed: Feed) -> None:
    """The newest hello, then the newest picture, unchanged and once."""
    with browser(feed) as first:
        say(feed, HELLO)
        told(first, "hello")
        for step in range(3):
            say(feed, {"type": "picture", "step": step})
            assert told(first, "picture")["step"] == step
        say(feed, HELLO | {"title": "Ärger & <b>"})
        assert told(first, "hello")["title"] == "Ärger & <b>"
        with browser(feed) as late:
            assert json.loads(late.recv(PATIENCE_S)) == HELLO | {"title": "Ärger & <b>"}
            assert json.loads(late.recv(PATIENCE_S)) == {"type": "picture", "step": 2}


def test_intents_reach_the_feed_with_the_browsers_number(feed: Feed) -> None:
    with browser(feed) as one, browser(feed) as other:
        one.send('{"type":"catch_up","from":99}')
        first = feed.hear("catch_up")["from"]
        other.send('{"type":"note","text":"\\u00e4<script>"}')
        note = feed.hear("note")
        assert note == {"type": "note", "text": "ä<script>", "from": note["from"]}
        assert first != note["from"]
        assert 99 not in (first, note["from"])
        say(feed, {"type": "catch_up", "to": first, "inbox": []})
        say(feed, {"type": "accepted", "to": note["from"], "id": "c1", "number": 5})
        say(feed, {"type": "accepted", "to": 12345, "id": "gone", "number": 6})
        say(feed, {"type": "read", "items": [1]})
        assert [json.loads(one.recv(PATIENCE_S))["type"] for _ in range(2)] == ["catch_up", "read"]
        assert [json.loads(other.recv(PATIENCE_S))["type"] for _ in range(2)] == ["accepted", "read"]


BAD = ["", "{", "[]", "3", "null", '{"type":1}', '{"type":"sudo"}', '{"id":"c1"}', "[" * 5000, '{"type":NaN}']


def test_what_is_no_intent_is_refused(feed: Feed) -> None:
    with browser(feed) as client:
        for text in [*BAD, '{"type":"read","items":[1e999999]}', b"{}"]:
            client.send(text)
        for _ in BAD:
            assert "must be" in told(client, "refused")["why"]
        client.send('{"type":"command","id":"c6","name":"go"}')
        while "target" not in (refused := told(client, "refused"))["why"]:
            pass
        assert refused["id"] == "c6"
        client.send('{"type":"command","id":"c7","name":"go","target":{"kind":"all"}}')
        client.send('{"type":"sudo","id":"c8"}')
        assert feed.hear("command")["id"] == "c7"
        while told(client, "refused")["id"] != "c8":
            pass


def test_a_frame_of_a_megabyte_ends_its_own_connection_only(feed: Feed) -> None:
    with browser(feed) as good:
        for compression in (None, "deflate"):
            with browser(feed, compression=compression) as bad:
                with pytest.raises(ConnectionClosed) as closed:  # noqa: PT012 (either may notice)
                    bad.send('{"type":"note","text":"' + "a" * 1_000_000 + '"}')
                    bad.recv(PATIENCE_S)
                assert closed.value.rcvd is None or closed.value.rcvd.code == 1009
        good.send('{"type":"note","text":"still here"}')
        assert feed.hear("note")["text"] == "still here"


def test_who_floods_is_let_go(feed: Feed) -> None:
    with browser(feed) as client:
        with pytest.raises(ConnectionClosed) as closed:  # noqa: PT012
            for _ in range(100 * rules.MAX_INTENTS_PER_S):
                client.send('{"type":"catch_up"}')
            client.recv(PATIENCE_S)
        assert closed.value.rcvd is None or closed.value.rcvd.code == 1008


def test_only_so_many_browsers_at_a_time(feed: Feed) -> None:
    """Of a hundred 20 are let in; those go on, and when they have left others may come."""
    say(feed, HELLO)
    with ExitStack() as stack:
        inside: list[ClientConnection] = []
        for _ in range(100):
            with suppress(InvalidStatus):
                inside.append(stack.enter_context(browser(feed)))
        assert len(inside) == room.MAX_BROWSERS
        for client in inside:
            assert told(client, "hello")["run"] == HELLO["run"]
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        try:
            with browser(feed) as client:
                assert told(client, "hello")
            return
        except InvalidStatus:
            continue
    raise TimeoutError("nobody is let in any more")


def test_connections_that_say_nothing_do_not_keep_others_out(feed: Feed) -> None:
    host, port = urlsplit(feed.url).hostname, urlsplit(feed.url).port
    with ExitStack() as stack:
        idle = [stack.enter_context(socket.create_connection((host, port), PATIENCE_S)) for _ in range(100)]
        began_s = time.monotonic()
        assert fetch(feed, urlsplit(feed.url).path).status == HTTPStatus.OK
        assert time.monotonic() - began_s < visitors.OPEN_WITHIN_S, (
            "a page need not wait until the time of the idle ones is up"
        )
        for link in idle:  # the first ones are dropped at once, the others when their time is up
            assert link.recv(1) == b""


def test_a_browser_that_stops_reading_costs_the_others_nothing(feed: Feed) -> None:
    """It is skipped, the station's memory stays as it is, and when it goes on it soon shows the newest."""
    filling = "".join(chr(33 + (7 * i * i + i // 90) % 90) for i in range(20_000)).replace("\\", "").replace('"', "")
    with browser(feed, compression=None) as quick, browser(feed, compression=None, max_queue=1) as stopped:
        for step in range(400):
            say(feed, {"type": "picture", "step": step, "filling": filling})
            while told(quick, "picture")["step"] < step:
                pass
            if step == 100:
                before_kb = memory_kb(feed)
        assert memory_kb(feed) - before_kb < 4_000
        seen = []
        while not seen or seen[-1] < 1000:
            seen.append(told(stopped, "picture")["step"])
            say(feed, {"type": "picture", "step": 1000 if seen[-1] > 350 or len(seen) > 300 else 399})
        assert len(seen) < 400


def test_a_browser_that_stops_reading_does_not_keep_the_station(feed: Feed) -> None:
    """The library alone would wait until its pings are not answered, 20 s after the browser came."""
    host, port = str(urlsplit(feed.url).hostname), urlsplit(feed.url).port
    with socket.socket() as stuck:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stuck.connect((host, port))
        with browser(feed) as quick, browser(feed, sock=stuck, compression=None, max_queue=1):
            for _ in range(12):
                say(feed, {"type": "read", "items": ["x" * 60_000]})
                told(quick, "read")
            feed.process.send_signal(signal.SIGTERM)
            assert feed.process.wait(15) == 0


def memory_kb(feed: Feed) -> int:
    text = Path(f"/proc/{feed.process.pid}/status").read_text()
    return int(re.findall(r"VmRSS:\s+(\d+)", text)[0])


def test_a_stopped_station_costs_the_feed_nothing(feed: Feed) -> None:
    """Its sends return at once, and when the station goes on browsers get the newest that it was sent."""
    with browser(feed) as client:
        say(feed, HELLO)
        told(client, "hello")
        feed.process.send_signal(signal.SIGSTOP)
        before_s = time.thread_time()
        for step in range(5000):
            feed.send({"type": "picture", "step": step, "filling": "x" * 2000})
        assert time.thread_time() - before_s < 2.0
        feed.process.send_signal(signal.SIGCONT)
        say(feed, {"type": "picture", "step": 5000})
        count = 1
        while told(client, "picture")["step"] < 5000:
            count += 1
        assert count < 200


def test_a_feed_that_does_not_listen_holds_nobody_up(feed: Feed) -> None:
    text = json.dumps({"type": "form", "form": "f", "answers": {"why": "a" * 15_000}})
    with browser(feed) as client:
        refused = None
        for _ in range(40):
            client.send(text)
        client.send('{"type":"sudo"}')
        while refused is None or "type" not in refused["why"]:
            refused = told(client, "refused")
            if "busy" in refused["why"]:
                break
        assert "busy" in refused["why"]
        assert refused["again"] is True
        say(feed, {"type": "picture", "step": 1})
        assert told(client, "picture")["step"] == 1


def test_what_the_feed_should_not_say_is_passed_over(feed: Feed) -> None:
    for datagram in (b"{", b"[]", b"\xff\xfe", b'{"to":1}', b'{"type":"x","to":[1]}', b'{"type":"picture"\xff'):
        feed.socket.send(datagram)
    say(feed, HELLO)
    with browser(feed) as client:
        assert told(client, "hello")["run"] == HELLO["run"]


def test_the_station_ends_after_its_feed(feed: Feed) -> None:
    """Browsers are told, also who comes within the next seconds; the exit code is 0."""
    say(feed, HELLO)
    say(feed, {"type": "picture", "step": 7})
    with browser(feed) as client:
        assert told(client, "picture")["step"] == 7
        feed.hang_up()
        assert told(client, "ended")
        with browser(feed) as late:
            assert [json.loads(late.recv(PATIENCE_S))["type"] for _ in range(3)] == ["hello", "picture", "ended"]
            late.send('{"type":"note","text":"too late"}')
            assert "ended" in told(late, "refused")["why"]
        with pytest.raises(ConnectionClosed):
            told(client, "hello")
    assert feed.process.wait(PATIENCE_S) == 0


def test_a_page_is_told_of_the_end_after_the_last_picture(feed: Feed) -> None:
    """Also if both come at once; a picture after the end would mean that the run goes on."""
    say(feed, HELLO)
    with browser(feed) as page:
        told(page, "hello")
        feed.hear("page")
        feed.send({"type": "picture", "step": 1})
        feed.hang_up()
        assert [json.loads(page.recv(PATIENCE_S))["type"] for _ in range(2)] == ["picture", "ended"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_station(feed: Feed, number: signal.Signals) -> None:
    feed.process.send_signal(number)
    assert feed.process.wait(PATIENCE_S) == 0
