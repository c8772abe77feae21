"""Pictures of a run's truth as datagrams, for the researcher's page and for `deltaswarm top`.

They have the format of the operator's station, with the operator's knowledge left empty and `truth` added. A datagram
that does not fit into the socket's buffer is dropped, so no reader makes the run wait; the next one is newer anyway.
"""

import errno
import os
import socket
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

import orjson

from deltaswarm_orchestrator.live.observers import Paced, Seen
from deltaswarm_scenario.page_messages import MAX_DATAGRAM_BYTES, RESEARCHER, Message, answers, made
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import Truth

LIVE_SOCKET = "live.sock"
"""The socket in a run's folder to which `deltaswarm top` connects. Only the folder's owner may connect."""

MAX_READERS = 16
"""Further readers of the socket wait until another one leaves."""

INTENTS_AT_A_TIME = 20
"""Further intents of the researcher's page wait until the next look."""

HISTORY_ROWS = 600
"""Length of the message rate history sent to a page that connects late; at most one row per simulated second."""

ROOM_BYTES = 1 << 20
"""Requested send buffer of each socket; a picture of 5000 agents takes a fifth of it. The system may grant less."""

PLACE_DIGITS = 3
"""Positions are rounded to a millimetre."""

HistoryRow = tuple[float, float, float]
"""Simulated time [s], and the rates over 1 s and 60 s [Hz]."""


def hello(run: str, scenario: Scenario) -> bytes:
    """Encode what does not change during a run: its name, arena and length."""
    arena, uplink = scenario.arena, scenario.uplink
    return orjson.dumps(
        made(
            "hello",
            kind=RESEARCHER,
            run=run,
            title=f"{scenario.name}, {scenario.control.mode}",
            step_s=scenario.run.step_s,
            duration_s=scenario.run.steps * scenario.run.step_s,
            arena_m=[arena.width_m, arena.height_m],
            obstacles=[obstacle.corners_m for obstacle in arena.obstacles],
            base_m=uplink.base_m,
            range_m=uplink.range_m,
            radius_m=scenario.world.radius_m,
            agents=scenario.agents.count,
            thresholds_hz=[scenario.operator.threshold_hz],
        )
    )


def picture(seen: Seen) -> bytes | None:
    """Encode what there is to see of a run now; None before there is anything."""
    truth, status, workload = seen.newest_truth, seen.status, seen.newest_workload
    newest = truth or workload or status
    if newest is None:
        return None
    more: dict[str, Any] = {} if status is None else {"status": status._asdict()}
    return orjson.dumps(
        made(
            "picture",
            step=newest.step,
            time_s=newest.time_s,
            over=status is not None and status.phase == "ended",
            workload={
                "messages": seen.messages,
                "rate_1s_hz": workload.rate_1s_hz if workload else 0.0,
                "rate_60s_hz": workload.rate_60s_hz if workload else 0.0,
                "senders": workload.senders if workload else 0,
                "residue": 0.0,
                "above_s": [workload.time_above_s if workload else 0.0],
            },
            truth=_truth(truth) if truth else None,
            **more,
        )
    )


def _truth(truth: Truth) -> dict[str, Any]:
    def place_m(thing: Any) -> tuple[float, float]:
        return round(thing.x_m, PLACE_DIGITS), round(thing.y_m, PLACE_DIGITS)

    return {
        "agents": [
            (body.agent, *place_m(body), body.role, body.parent, body.root, body.delta) for body in truth.bodies
        ],
        "events": [
            (event.event, *place_m(event), event.arrived_s) for event in truth.events if event.completed_s is None
        ],
    }


class ViewStream:
    """The feed of one reader: `hello` first, then a picture whenever there is room."""

    def __init__(self, end: socket.socket, greeting: bytes | None) -> None:
        with suppress(OSError):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM_BYTES)
        self.is_closed = False
        self._end = end
        self._greeting = greeting

    def show(self, shown: bytes) -> None:
        if self._greeting is not None:
            if not self.send(self._greeting):
                return
            self._greeting = None
        self.send(shown)

    def send(self, data: bytes) -> bool:
        """Send a datagram; False if it was dropped."""
        try:
            self._end.send(data, socket.MSG_DONTWAIT)  # another process may use this end, and block at it
        except BlockingIOError:
            return False
        except OSError as error:
            self.is_closed |= error.errno not in (errno.EMSGSIZE, errno.ENOBUFS)
            return False
        return True

    def received(self) -> bytes | None:
        """Return the next datagram from the other end; None if there is none."""
        try:
            data = self._end.recv(MAX_DATAGRAM_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        self.is_closed |= not data
        return data or None

    def hang_up(self) -> None:
        self.is_closed = True
        self._end.close()


class ResearcherFeed:
    """A `LiveObserver` that feeds a station's process with the truth, for the researcher's page.

    The station holds the other end of the pair of SOCK_SEQPACKET sockets. With `is_beside_operator`, the operator uses
    this end too, greets the page, answers it and mirrors the participant's: then only the truth comes from here.
    """

    def __init__(
        self,
        end: socket.socket,
        run: str,
        scenario: Scenario,
        paced: Paced | None = None,
        *,
        is_beside_operator: bool = False,
    ) -> None:
        self._is_beside_operator = is_beside_operator
        self._reader = ViewStream(end, None if is_beside_operator else hello(run, scenario))
        self._paced = paced or Paced()
        self._history: deque[HistoryRow] = deque(maxlen=HISTORY_ROWS)

    def look(self, seen: Seen) -> None:
        """Send the newest picture, and answer the page's intents."""
        if self._reader.is_closed or not self._paced.is_due():
            return
        if self._is_beside_operator:
            if (truth := seen.newest_truth) is not None:
                self._reader.show(orjson.dumps(made("truth", time_s=truth.time_s, **_truth(truth))))
            return
        if (counted := seen.newest_workload) and (not self._history or counted.time_s - self._history[-1][0] >= 1.0):
            self._history.append((counted.time_s, counted.rate_1s_hz, counted.rate_60s_hz))
        for _ in range(INTENTS_AT_A_TIME):
            if (asked := self._reader.received()) is None:
                break
            for answer in answers(asked, RESEARCHER, self._catch_up):
                self._reader.send(orjson.dumps(answer))
        if seen.newest_truth is not None and (shown := picture(seen)) is not None:
            self._reader.show(shown)

    def _catch_up(self, asked: Message) -> list[Message]:
        return [made("catch_up", to=asked["from"], history=[*self._history])]


class LiveSocket:
    """A `LiveObserver` that shows the run to everyone who connects to the socket in its folder, and reads nothing.

    If the folder cannot hold a socket, the run continues without one. The folder may be renamed during the run.
    """

    def __init__(self, folder: Path, run: str, scenario: Scenario, paced: Paced | None = None) -> None:
        self._paced = paced or Paced()
        self._greeting = hello(run, scenario)
        self._readers: list[ViewStream] = []
        self._file = folder / LIVE_SOCKET
        self._socket: socket.socket | None = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._file.unlink(missing_ok=True)  # left by a killed run
            os.fchmod(self._socket.fileno(), 0o600)  # before it has a name, so that nobody else can connect first
            with short_path(self._file) as name:
                self._socket.bind(name)
            self._socket.listen(MAX_READERS)
            self._socket.setblocking(False)
        except OSError:
            self._socket.close()
            self._socket = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for reader in self._readers:
            reader.hang_up()
        if self._socket is not None:
            self._socket.close()
            with suppress(OSError):
                self._file.unlink()

    def look(self, seen: Seen) -> None:
        """Accept a new reader, send the newest picture to all readers, and drop those that left."""
        if self._socket is None or not self._paced.is_due():
            return
        if len(self._readers) < MAX_READERS:
            with suppress(OSError):
                self._readers.append(ViewStream(self._socket.accept()[0], self._greeting))
        if not self._readers or (shown := picture(seen)) is None:
            return
        for reader in self._readers:
            reader.show(shown)
            if reader.is_closed:
                reader.hang_up()
        self._readers = [reader for reader in self._readers if not reader.is_closed]


@contextmanager
def short_path(file: Path) -> Iterator[str]:
    """Yield a short path of a file, whose full path may be too long for a socket's address."""
    folder = os.open(file.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{file.name}"
    finally:
        os.close(folder)


def connected(folder: Path, within_s: float) -> socket.socket:
    """Connect to the run in progress in a folder, within `within_s` [s].

    Raises:
        OSError: no run is under way there, or this user may not watch it.
    """
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    end.settimeout(within_s)
    try:
        with short_path(folder / LIVE_SOCKET) as name:
            end.connect(name)
    except OSError:
        end.close()
        raise
    return end
