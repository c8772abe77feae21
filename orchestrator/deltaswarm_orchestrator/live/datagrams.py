"""Feeds for onlookers of a run: datagrams into a socket that never makes the run wait.

A datagram that does not fit into the socket's buffer is dropped; the next one is newer anyway.
"""

import errno
import socket
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import orjson

from deltaswarm_orchestrator.live.observer import Paced, Seen
from deltaswarm_orchestrator.live.view import hello, picture
from deltaswarm_scenario.scenario import Scenario

MAX_INTENT_BYTES = 16_384
HISTORY_ROWS = 600
"""Length of the message rate history sent to a page that connects late; at most one row per simulated second."""

INTENTS_AT_A_TIME = 20
"""Further intents wait until the next look."""

ROOM_BYTES = 1 << 20
"""Requested send buffer of each socket; a picture of 5000 agents takes a fifth of it. The system may grant less."""

HistoryRow = tuple[float, float, float]
"""Simulated time [s], and the rates over 1 s and 60 s [Hz]."""

ONLY_LOOKS = "the researcher's view only looks on"
FORMS = ("command", "pace", "isa", "tlx", "sheet", "note", "read", "seek")
"""Intents that ask for an action."""


def make_non_blocking(end: socket.socket) -> None:
    """Make one end of a connection non-blocking, with a large send buffer."""
    end.setblocking(False)
    with suppress(OSError):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM_BYTES)


class Pictures:
    """The feed of one reader: `hello` first, then a picture whenever there is room."""

    def __init__(self, end: socket.socket, greeting: bytes) -> None:
        make_non_blocking(end)
        self.is_closed = False
        self._end = end
        self._greeting: bytes | None = greeting

    def show(self, shown: bytes) -> None:
        """Send a picture, or drop it."""
        if self._greeting is not None:
            if not self.send(self._greeting):
                return
            self._greeting = None
        self.send(shown)

    def send(self, data: bytes) -> bool:
        """Send a datagram; False if it was dropped."""
        try:
            self._end.send(data)
        except BlockingIOError:
            return False
        except OSError as error:
            self.is_closed |= not _is_too_long(error)
            return False
        return True

    def received(self) -> bytes | None:
        """Return the next datagram from the other end; None if there is none."""
        try:
            data = self._end.recv(MAX_INTENT_BYTES)
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        self.is_closed |= not data
        return data or None

    def close(self) -> None:
        """Close the connection; the other end notices."""
        self.is_closed = True
        self._end.close()


class ResearcherFeed:
    """An `Onlooker` that feeds a station's process with the truth, for the researcher's page.

    Args:
        end: one end of a pair of SOCK_SEQPACKET sockets; the station holds the other. `close` closes it.
        run: the run's name.
        scenario: the run's scenario.
        paced: says when it is time to look.
    """

    def __init__(self, end: socket.socket, run: str, scenario: Scenario, paced: Paced | None = None) -> None:
        self._reader = Pictures(end, hello(run, scenario))
        self._paced = paced or Paced()
        self._history: deque[HistoryRow] = deque(maxlen=HISTORY_ROWS)

    def look(self, seen: Seen) -> None:
        """Send the newest picture, and answer the page's intents."""
        if self._reader.is_closed or not self._paced.is_due():
            return
        if (counted := seen.newest_workload) and (not self._history or counted.time_s - self._history[-1][0] >= 1.0):
            self._history.append((counted.time_s, counted.rate_1s_hz, counted.rate_60s_hz))
        for _ in range(INTENTS_AT_A_TIME):
            if (asked := self._reader.received()) is None:
                break
            if (reply := answer(asked, self._history)) is not None:
                self._reader.send(reply)
        if seen.newest_truth is not None and (shown := picture(seen)) is not None:
            self._reader.show(shown)

    def close(self) -> None:
        """Close the connection."""
        self._reader.close()


def answer(asked: bytes, history: Iterable[HistoryRow]) -> bytes | None:
    """Return the answer to an intent from the researcher's page; None for an intent that is not understood."""
    try:
        intent: Any = orjson.loads(asked)
        kind, to = intent["type"], intent["from"]
    except (ValueError, TypeError, KeyError):
        return None
    if kind == "catch_up":
        return orjson.dumps({"type": "catch_up", "to": to, "inbox": [], "read": [], "history": [*history]})
    if kind in FORMS:
        return orjson.dumps({"type": "refused", "to": to, "id": intent.get("id"), "why": ONLY_LOOKS})
    return None


def _is_too_long(error: OSError) -> bool:
    return error.errno in (errno.EMSGSIZE, errno.ENOBUFS)
