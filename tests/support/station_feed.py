"""A feed for the station: a small scripted swarm, and an operator who answers what browsers ask.

`python -m tests.support.station_feed [live|replay|researcher|conductor]` plays it, to look at the page.
"""

import contextlib
import json
import math
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

Message = dict[str, Any]

PATIENCE_S = 30.0
SCALES = ("mental", "physical", "temporal", "performance", "effort", "frustration")
ISA: Message = {"kind": "isa", "number": 3, "asked_s": 90.0, "left_s": 21.0}
TLX: Message = {"kind": "tlx", "pairs": [list(pair) for pair in combinations(SCALES, 2)]}
"""NASA-TLX with weights."""

FORMS: list[Message] = [
    {
        "name": "set delta",
        "help": "From how many followers on a root reports for its tree.",
        "targets": ["all", "circle", "tree"],
        "arguments": [
            {"name": "delta", "kind": "integer", "low": 1, "high": 1000, "unit": "", "default": 3, "help": "followers"}
        ],
    },
    {"name": "recall a tree", "help": "Its members leave and search on.", "targets": ["tree"], "arguments": []},
    {
        "name": "attend a place",
        "help": "The nearest free agent goes there.",
        "targets": ["place"],
        "arguments": [
            {"name": "for", "kind": "number", "low": 1, "high": 600, "unit": "s", "default": 60, "help": ""},
            {"name": "pace", "kind": "choice", "choices": ["slow", "fast"], "default": "fast", "help": ""},
        ],
    },
    {"name": "hold", "help": "Stop and stay.", "targets": ["all", "circle", "tree", "agent"], "arguments": []},
]

CONSENT = "You watch a swarm for half an hour.\n\nYou may stop at any time, without giving a reason."

ROLES = {0: "root", 1: "member", 2: "member", 3: "member", 4: "root", 5: "member", 6: "attending", 7: "free"}
PARENTS = {1: 0, 2: 0, 3: 1, 5: 4}
ROOTS = {0: 0, 1: 0, 2: 0, 3: 0, 4: 4, 5: 4}


@dataclass
class Swarm:
    """Twelve agents, of which eleven are ever heard of; number 9 never is. Everything follows from the time."""

    kind: str = "live"
    agents: int = 12
    events: int = 5
    silent: tuple[int, ...] = (9,)
    read: set[int] = field(default_factory=set)
    commands: list[list[Any]] = field(default_factory=list)
    judged: dict[int, str] = field(default_factory=dict)
    probe: Message | None = None
    paused: bool = False
    speed: float = 5.0
    over: bool = False
    told: int = -1
    """The newest message of the inbox that a picture had."""
    language: Message | None = None
    """In which language the page speaks; None: English."""

    def hello(self, **changes: Any) -> Message:
        """What a browser gets first."""
        return {
            "type": "hello",
            "kind": self.kind,
            "run": "paper-25-test",
            "title": "paper-25, hybrid",
            "language": self.language,
            "step_s": 1.0,
            "duration_s": 900.0,
            "arena_m": [100, 100],
            "obstacles": [[[60, 62], [74, 62], [74, 70], [60, 70]], [[20, 30], [26, 30], [23, 40]]],
            "base_m": [50, 0],
            "range_m": 50.0,
            "agents": self.agents,
            "thresholds_hz": [5.0, 2.0],
            "commands": FORMS if self.kind == "live" else [],
            "speeds": [1, 2, 5, 10, 20, 0],
            "asks": True,
            "session": {"sheet": {"consent": CONSENT, "participant": "P07", "condition": "2"}},
        } | changes

    def agent_rows(self, time_s: float) -> list[list[Any]]:
        """Where each is and when it said so; the higher its number, the longer ago."""
        rows = []
        for number in range(self.agents):
            if number in self.silent:
                continue
            said_s = max(0.0, time_s - (number % 7) ** 2 * 3)
            angle = number * 2.4 + said_s / 60
            radius = 14 + 2.8 * (number % 12)
            x_m, y_m = 50 + radius * math.cos(angle), 50 + radius * math.sin(angle)
            same = number % 8 if self.agents > 12 else number
            base = number - same
            parent, root = PARENTS.get(same, -1 - base) + base, ROOTS.get(same, -1 - base) + base
            own = 0 if same in (2, 3) else 1
            role = ROLES.get(same, "free")
            rows.append([number, round(x_m, 2), round(y_m, 2), role, parent, root, round(said_s, 1), own, 3])
        return rows

    def event_rows(self, time_s: float) -> list[list[Any]]:
        """Events that were reported, one each 20 s."""
        rows = []
        for number in range(self.events):
            first_s = 20.0 * number
            if first_s <= time_s:
                x_m, y_m = (37 * number + 15) % 90 + 5, (53 * number + 20) % 90 + 5
                by, attending = (6, [6]) if number == 1 else (0, [])
                seen_s = round(time_s - number * 11 % 60, 1)
                trail_m = [[x_m - 6, y_m - 4], [x_m + 5, y_m - 6]] if number == 3 else []
                rows.append([number, x_m, y_m, first_s, seen_s, by, attending, trail_m])
        return rows

    def items(self, time_s: float) -> list[list[Any]]:
        """The whole inbox: a message each two seconds."""
        made = []
        for number in range(int(time_s // 2)):
            agent = (number * 5) % 9
            role = ROLES.get(agent, "free")
            events = [number % 5] if number % 3 else []
            made.append([number, 2.0 * number + 2, agent, role, 3 if role == "root" else 0, events, number % 10 == 0])
        return made

    def picture(self, time_s: float, **changes: Any) -> Message:
        """The picture at a time."""
        items = self.items(time_s)
        short, long = 2.0 + 2 * math.sin(time_s / 7) + (time_s % 3), 2.0 + 1.5 * math.sin(time_s / 40)
        fresh = items[max(0, min(self.told + 1, len(items) - 20)) :]
        self.told = max(self.told, len(items) - 1)
        picture: Message = {
            "type": "picture",
            "step": int(time_s),
            "time_s": time_s,
            "over": self.over,
            "agents": self.agent_rows(time_s),
            "events": self.event_rows(time_s),
            "inbox": fresh,
            "judged": list(self.judged.items()),
            "unread": len(items) - len(self.read),
            "closed": {"events": 7, "after_s": 61.5},
            "workload": {
                "messages": len(items),
                "rate_1s_hz": round(short, 1),
                "rate_60s_hz": round(long, 2),
                "senders": 4,
                "residue": 0.3,
                "above_s": [12.0, 80.0],
            },
            "commands": self.commands[-50:],
            "pace": {"paused": self.paused, "speed": self.speed},
            "probe": self.probe,
        }
        if self.kind == "replay":
            picture["replay"] = {"from_s": 0, "to_s": 600, "speed": self.speed, "paused": self.paused}
        if self.kind == "researcher":
            picture["truth"] = self.truth(time_s)
            picture |= {"agents": [], "events": [], "inbox": []}
        return picture | changes

    def truth(self, time_s: float) -> Message:
        """What no operator knows, here all that was reported and whoever is silent."""
        silent, self.silent = self.silent, ()
        agents = [[*row[:6], row[8]] for row in self.agent_rows(time_s)]
        self.silent = silent
        return {"agents": agents, "events": [row[:4] for row in self.event_rows(time_s)]}

    def answer(self, intent: Message, time_s: float) -> list[Message]:
        """What an operator says to an intent: what has an id is noted."""
        noted = {"type": "noted", "to": intent["from"], "id": intent.get("id")}
        return [*self.carry_out(intent, time_s), *([noted] if intent.get("id") else [])]

    def carry_out(self, intent: Message, time_s: float) -> list[Message]:
        """Do what an intent wants; return what is said to it besides."""
        to, kind = intent["from"], intent["type"]
        if kind == "beat":
            return [{"type": "beat", "to": to}]
        if kind == "catch_up":
            history = [[float(t), 2 + t % 3, 2.0 + 1.5 * math.sin(t / 40)] for t in range(int(time_s))]
            items = self.items(time_s)[-1000:]
            return [
                {"type": "catch_up", "to": to, "inbox": items, "read": sorted(self.read), "history": history[-600:]}
            ]
        if kind == "read":
            items = [item[0] for item in self.items(time_s)] if intent.get("all") else intent["items"]
            self.read |= set(items)
            return [{"type": "read", "items": items}]
        if kind == "command":
            number = len(self.commands) + 1
            target = list(intent["target"].values())
            fate = [0, 0, 0, time_s + 60, "sent", 0, [], "person"]
            row = [number, intent["name"], target, intent["arguments"], time_s, *fate]
            self.commands.append(row)
            return [{"type": "accepted", "to": to, "id": intent["id"], "number": number}]
        if kind == "judge":
            self.judged[intent["event"]] = intent["answer"]
        if kind == "pace":
            self.paused = intent.get("paused", self.paused)
            self.speed = intent.get("speed", self.speed)
        if kind in ("isa", "tlx", "sheet", "form"):
            self.probe = None
        return []


class Feed:
    """The other end of a station's channel, and the station's process."""

    def __init__(self, *arguments: str) -> None:
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-P", "-m", "deltaswarm_operator.station", "--watchers"]
        self.process = subprocess.Popen(
            [*command, "--channel-fd", str(theirs.fileno()), *arguments],
            pass_fds=[theirs.fileno()],
            stdout=subprocess.PIPE,
            text=True,
        )
        theirs.close()
        self.socket.setblocking(False)
        assert self.process.stdout
        self.url = self.process.stdout.readline().strip()
        self.watch_url = self.process.stdout.readline().strip()

    def send(self, *messages: Message) -> None:
        """Say something to the station; lost if that does not listen, or has gone."""
        for message in messages:
            with contextlib.suppress(BlockingIOError, BrokenPipeError):
                self.socket.send(json.dumps(message, separators=(",", ":")).encode())

    def hear_any(self, patience_s: float = PATIENCE_S) -> Message:
        """The next intent."""
        if not select.select([self.socket], [], [], max(0.0, patience_s))[0]:
            raise TimeoutError("no intent")
        intent: Message = json.loads(self.socket.recv(1 << 20))
        return intent

    def hear(self, kind: str, patience_s: float = PATIENCE_S) -> Message:
        """The next intent of that type; others are passed over."""
        deadline_s = time.monotonic() + patience_s
        while (intent := self.hear_any(deadline_s - time.monotonic()))["type"] != kind:
            pass
        return intent

    def hang_up(self) -> None:
        """Close the channel, also where a thread waits at it."""
        with contextlib.suppress(OSError):  # the station may have ended
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()

    def close(self) -> None:
        """End the station's process, which this one started."""
        self.hang_up()
        self.process.terminate()
        self.process.wait(PATIENCE_S)
        if self.process.stdout:
            self.process.stdout.close()

    def __enter__(self) -> "Feed":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Player:
    """Answers browsers from a thread, as an operator would, and keeps what they asked.

    A beat is answered by the newest picture: a page over whose connection nothing comes connects anew.
    """

    def __init__(self, feed: Feed, swarm: Swarm, time_s: float = 100.0) -> None:
        self.swarm = swarm
        self.time_s = time_s
        self.intents: list[Message] = []
        self._feed = feed
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._run, daemon=True)
        feed.send(swarm.hello())
        self.show()
        self._thread.start()

    def show(self, time_s: float | None = None, **changes: Any) -> None:
        """Send a picture, of now or of another time."""
        with self._news:
            self.time_s = self.time_s if time_s is None else time_s
            self._shown = self.swarm.picture(self.time_s, **changes)
            self._feed.send(self._shown)

    def heard(self, is_it: Callable[[Message], bool]) -> Message:
        """The first intent that is it, once it is there; it is forgotten then."""

        def found() -> Message | None:
            return next(filter(is_it, self.intents), None)

        with self._news:
            if not self._news.wait_for(found, PATIENCE_S):
                raise TimeoutError(f"not among {self.intents}")
            intent = found()
            assert intent is not None
            self.intents.remove(intent)
            return intent

    def _run(self) -> None:
        with contextlib.suppress(OSError, ValueError):  # the feed is closed
            while True:
                select.select([self._feed.socket], [], [])
                self._take(json.loads(self._feed.socket.recv(1 << 20)))

    def _take(self, intent: Message) -> None:
        with self._news:
            if intent["type"] == "seek":
                self.time_s = intent["time_s"]
                self.swarm.told = -1
            self._feed.send(*self.swarm.answer(intent, self.time_s))
            if intent["type"] not in ("catch_up", "page", "beat"):
                self._shown = self.swarm.picture(self.time_s)
            if intent["type"] not in ("catch_up", "page"):
                self._feed.send(self._shown)
            if intent["type"] not in ("catch_up", "beat"):
                self.intents.append(intent)
            self._news.notify_all()


def main() -> None:
    """Play until the station ends."""
    swarm = Swarm(sys.argv[1] if len(sys.argv) > 1 else "live")
    with Feed() as feed:
        print(feed.url)
        player = Player(feed, swarm, 0.0)
        while feed.process.poll() is None:
            time.sleep(0.1)
            step_s = 0.0 if swarm.paused else 0.1 * (swarm.speed or 50)
            player.show(player.time_s + step_s)


if __name__ == "__main__":
    main()
