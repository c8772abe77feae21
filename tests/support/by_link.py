"""A study by link and scripted participants of it, who speak as the pages do."""

import csv
import json
import os
import random
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from ssl import SSLContext
from typing import Any
from urllib.parse import urljoin, urlsplit

from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from tests.support.cable import cable
from tests.support.persons import headless
from tests.support.swarms import BOUND_S, COMMAND, PATIENCE_S, told

Message = dict[str, Any]

BEARS = (ConnectionClosed, InvalidHandshake, TimeoutError)
"""After these a participant connects anew."""

FILE = """
schema = 1

[session]
speed = {speed}
consent = "consent.txt"
set = ["record=off", "operator.probes.isa_every_s=0", "operator.probes.tlx=true"]

[session.training]
label = "training"
scenario = "smoke"
set = ["run.duration_s={training_s}"]

[[session.condition]]
label = "A"
scenario = "smoke"
set = ["run.duration_s={condition_s}"]

[serve]
outside_id = "PID"
return_url = "https://example.org/done?cc={{code}}"
"""


def a_study(folder: Path, *, speed: float = 50.0, training_s: int = 60, condition_s: int = 100, more: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    file = folder / "study.toml"
    file.write_text(FILE.format(speed=speed, training_s=training_s, condition_s=condition_s) + more)
    (folder / "consent.txt").write_text("You may stop at any time.\n")
    return file


def links_of(file: Path, count: int) -> None:
    """Make links of their own."""
    made = told("serve", str(file), "--out", str(file.parent / "out"), "--links", str(count))
    assert made.returncode == 0, made.stderr


def tokens(file: Path) -> list[str]:
    content = json.loads((file.parent / "out" / "links.json").read_text())
    return [link["token"] for link in content["links"]]


def states(file: Path) -> list[str]:
    content = json.loads((file.parent / "out" / "links.json").read_text())
    return [link["state"] for link in content["links"]]


def rows(file: Path, number: int, run: str, table: str) -> list[dict[str, str]]:
    with (file.parent / "out" / f"participant-{number:03}" / run / f"{table}.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


@dataclass
class Service:
    process: subprocess.Popen[str]
    open_link: str
    overview: str

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@contextmanager
def serving(file: Path, *options: str) -> Iterator[Service]:
    """Serve a study in its folder, and end the service at the end of the block."""
    command = [*COMMAND, "serve", str(file), "--out", str(file.parent / "out"), "--json", "--listen", "127.0.0.1:0"]
    with subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True, env=headless()) as process:
        try:
            assert process.stdout is not None
            told = json.loads(process.stdout.readline())
            yield Service(process, told["open link"], told["overview"])
        finally:
            process.terminate()
            try:
                process.wait(BOUND_S)
            finally:
                process.kill()


def hosted(folder: Path) -> list[int]:
    """Processes of sessions below a folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"deltaswarm_serving.hosted" in words and os.fsencode(folder / "out") in words:
            found.append(int(entry.parent.name))
    return found


def kill(folder: Path) -> None:
    """End the processes of sessions below a folder at once."""
    for process in hosted(folder):
        os.kill(process, signal.SIGKILL)


def socket_at(page: str, name: str, ssl: SSLContext | None = None) -> ClientConnection:
    """Open a page's WebSocket."""
    address = urlsplit(urljoin(page, name))
    origin = Origin(f"{address.scheme}://{address.netloc}")
    live = address._replace(scheme="wss" if address.scheme == "https" else "ws", query=urlsplit(page).query)
    return connect(live.geturl(), origin=origin, ssl=ssl, max_size=1 << 22, close_timeout=1, ping_interval=None)


def heard(socket: ClientConnection, is_it: Callable[[Message], bool], within_s: float = BOUND_S) -> Message:
    deadline = time.monotonic() + within_s
    while (left_s := deadline - time.monotonic()) > 0.0:
        message: Message = json.loads(socket.recv(min(left_s, PATIENCE_S)))
        if is_it(message):
            return message
    raise TimeoutError


@dataclass
class Participant:
    """One person with a link."""

    link: str
    patience_s: float = PATIENCE_S
    """After this long without a message it connects anew."""
    orders: list[str] = field(default_factory=list)
    """Ids of the inputs that were noted."""
    delays_s: list[float] = field(default_factory=list)
    """From each input to its answer [s]."""
    pictures: int = 0
    seen_s: float = 0.0
    _beat_due: float = 0.0
    done: set[str] = field(default_factory=set)
    """What was answered, by run."""
    bears: tuple[type[Exception], ...] = BEARS
    """After these it connects anew."""
    _code: int = 0
    _pending: tuple[str, Message] | None = None
    """What was sent and is not noted yet, and its run."""

    def at_door(self, *states: str) -> Message:
        """Agree if that is asked, and wait at the door until it shows one of these states."""
        with socket_at(self.link, "door") as door:
            while True:
                told = heard(door, lambda message: message["type"] == "door")
                if told["state"] in states:
                    return told
                if told["state"] == "new":
                    door.send('{"type":"agree"}')

    def go_through(self, until: Callable[[Message, Message], bool] = lambda hello, picture: False) -> Message | None:
        """Do all runs with an order in each; return what the door says then, or None once `until` holds."""
        while True:
            with suppress(*self.bears):
                told = self.at_door("running", "complete", "screened out", "ended", "failed", "declined")
                if told["state"] != "running":
                    return told
                if self._at_page(until):
                    return None

    def _at_page(self, until: Callable[[Message, Message], bool]) -> bool:
        """Be at the station's page until it has moved, or `until` holds; return whether it does."""
        with socket_at(self.link, "run/live") as page:
            hello: Message = {}
            began_s = time.monotonic()
            while True:
                message = json.loads(page.recv(self.patience_s))
                if message["type"] == "moved":
                    return False
                if message["type"] == "hello":
                    hello = message
                    self.settle(page, hello["run"])
                elif message["type"] == "picture" and hello:
                    self.pictures += 1
                    self.seen_s += time.monotonic() - began_s
                    began_s = time.monotonic()
                    if until(hello, message):
                        return True
                    self._act(page, hello, message)

    def _act(self, page: ClientConnection, hello: Message, picture: Message) -> None:
        run = hello["run"]
        kind = (picture["probe"] or {}).get("kind")
        is_done = picture["over"] and kind is None
        if time.monotonic() >= self._beat_due or is_done:
            self._beat_due = time.monotonic() + 1.0
            page.send(json.dumps({"type": "beat", "rtt_s": 0.0, "done": is_done}))
        if kind == "sheet" and f"{run} sheet" not in self.done:
            sheet = {name: hello["session"]["sheet"][name] for name in ("participant", "condition")}
            self.done.add(f"{run} sheet")
            self.put(page, run, "sheet", consent=True, **sheet)
        if kind == "tlx" and f"{run} tlx" not in self.done:
            scales = dict.fromkeys(("mental", "physical", "temporal", "performance", "effort", "frustration"), 50)
            self.done.add(f"{run} tlx")
            self.put(page, run, "tlx", scales=scales)
        if not picture["over"] and picture["step"] > 10 and f"{run} order" not in self.done:
            self.done.add(f"{run} order")
            self.put(page, run, "command", name="set delta", target={"kind": "all"}, arguments={"delta": 2})

    def put(self, page: ClientConnection, run: str, kind: str, **what: Any) -> None:
        """Put something in, and wait until it is noted; what a dead link swallowed is sent again by `settle`."""
        self._code += 1
        self._pending = (run, {"type": kind, "id": f"{kind}-{self._code}", **what})
        self.settle(page, run)

    def settle(self, page: ClientConnection, run: str) -> None:
        """Send what is not noted yet, if it is of this run, as the page does; again if the page is told so."""
        if self._pending is None or self._pending[0] != run:
            self._pending = None
            return
        what, began_s = self._pending[1], time.monotonic()

        def is_answer(message: Message) -> bool:
            return message["type"] in ("noted", "refused") and message.get("id") == what["id"]

        answer: Message = {"again": True}
        while answer.get("again"):
            page.send(json.dumps(what))
            answer = heard(page, is_answer, self.patience_s)
        self.delays_s.append(time.monotonic() - began_s)
        self._pending = None
        if what["type"] == "command" and answer["type"] == "noted":
            self.orders.append(what["id"])


def person(open_link: str, token: str) -> Participant:
    return Participant(f"{open_link.partition('/j/')[0]}/p/{token}/")


def together(people: list[Participant], within_s: float = BOUND_S) -> list[Message | None]:
    """Let all go through their sessions at once; what the door says to each at the end."""
    ends: list[Any] = [None] * len(people)

    def go(index: int) -> None:
        ends[index] = people[index].go_through()

    threads = [threading.Thread(target=go, args=(index,)) for index in range(len(people))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(within_s)
    return ends


@contextmanager
def bad_links(service: Service, tokens: Sequence[str], seed: int = 1) -> Iterator[list[Participant]]:
    """People each of whom has a link that is slow, or is cut, stalls or dies every few seconds, and comes back."""
    chance, over = random.Random(seed), threading.Event()
    port = urlsplit(service.open_link).port or 0

    with ExitStack() as stack:
        wires = [stack.enter_context(cable(port)) for _ in tokens]
        for index, wire in enumerate(wires):
            wire.delay_s = (0.0, 0.05, 0.2)[index % 3]

        def disturb() -> None:
            while not over.wait(3.6 / len(wires)):
                wire = chance.choice(wires)
                chance.choice([wire.cut, wire.hold, wire.die, wire.mend])()
                over.wait(3.6 / len(wires))
                chance.choice(wires).mend()

        disturbing = threading.Thread(target=disturb)
        disturbing.start()
        links = [f"http://127.0.0.1:{wire.port}/p/{token}/" for wire, token in zip(wires, tokens, strict=True)]
        try:
            yield [Participant(link, patience_s=5.0, bears=(*BEARS, OSError)) for link in links]
        finally:
            over.set()
            disturbing.join()
