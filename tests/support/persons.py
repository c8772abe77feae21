"""A person at the station of a run by the command line, as the page speaks for one."""

import json
import os
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any, Self
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from tests.support.swarms import PATIENCE_S, RunningSwarm, wait_until

Message = dict[str, Any]

HANDS = 4
"""Browsers: of each the station takes only so many messages in a second."""

CONSENT = "operator.probes.consent=Yes"
"""With this a run does not begin before the person says so."""


class Person:
    """Sees the pictures of a run's station, and gives it intents."""

    def __init__(self, swarm: RunningSwarm, page: str = "url") -> None:
        file = swarm.part / "station.json"
        process = swarm.process
        wait_until(
            lambda: process.poll() is not None or (file.exists() and file.read_text().endswith("\n")), "the page"
        )
        assert process.poll() is None, process.communicate()
        self.url = urlsplit(json.loads(file.read_text())[page])
        self._stack = ExitStack()
        self._browsers = [self._stack.enter_context(self._browser()) for _ in range(HANDS)]
        self._told = 0
        self._ordered = 0
        self._is_participant, self._beat_due = page == "url", 0.0
        self.picture: Message = self.hear("picture")

    def _browser(self) -> ClientConnection:
        live = f"ws://{self.url.netloc}{self.url.path}live"
        origin = Origin(f"http://{self.url.netloc}")
        return connect(live, origin=origin, max_size=1 << 22, close_timeout=1, ping_interval=None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def say(self, kind: str, **intent: Any) -> None:
        """Give an intent, each time by another browser."""
        self._told += 1
        self._browsers[self._told % HANDS].send(json.dumps({"type": kind, **intent}))

    def hear(self, *kinds: str) -> Message:
        """The next message of these types to the browser that spoke last."""
        while True:
            message: Message = json.loads(self._browsers[self._told % HANDS].recv(PATIENCE_S))
            if message["type"] == "picture":
                self.picture = message
                with suppress(ConnectionClosed):
                    self._beat()
            if message["type"] in kinds:
                return message

    def _beat(self) -> None:
        """Be there, as a page says once a second."""
        if self._is_participant and time.monotonic() >= self._beat_due:
            self._beat_due = time.monotonic() + 1.0
            self._browsers[0].send(json.dumps({"type": "beat"}))

    def see(self, is_it: Callable[[Message], bool]) -> Message:
        """The first picture that is it."""
        while not is_it(picture := self.hear("picture")):
            pass
        return picture

    def ask(self, kind: str, **intent: Any) -> Message:
        """Give an intent that is answered; the answer."""
        self.say(kind, **intent)
        return self.hear("accepted", "refused", "read", "catch_up")

    def command(self, name: str, kind: str = "all", arguments: Message | None = None, **target: float) -> Message:
        """Give a command; what the operator's process says to it."""
        self._ordered += 1
        code = f"{id(self)}-{self._ordered}"
        return self.ask("command", id=code, name=name, target={"kind": kind, **target}, arguments=arguments or {})

    def begin(self, speed: float = 0.0) -> None:
        """Consent, and let the run go at a speed."""
        self.see(lambda picture: picture["probe"] == {"kind": "sheet"})
        self.say("pace", speed=speed)
        self.say("sheet", consent=True, participant="P1", condition="a")
        self.see(lambda picture: picture["probe"] is None and picture["pace"] == {"paused": False, "speed": speed})

    def pause(self) -> int:
        """Pause, and wait until nothing moves any more; the newest step."""
        self.say("pace", paused=True)
        held = self.see(lambda picture: bool(picture["pace"]["paused"] and picture["probe"] is None))
        return int(held["step"])


def headless() -> dict[str, str]:
    """An environment without windows."""
    return {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
