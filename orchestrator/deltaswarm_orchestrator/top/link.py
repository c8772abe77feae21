"""The connection to a run in progress: find the run, and receive its newest picture."""

import select
import socket
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import orjson

from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.paths import part_of
from deltaswarm_orchestrator.live.views import LIVE_SOCKET, connected
from deltaswarm_orchestrator.results.folder_lock import is_held

DATAGRAM_BYTES = 4 << 20
DEPTHS = ("", "*/", "*/*/", "*/*/*/")
"""Folder depths at which runs are looked for: `runs/x.part` and the runs of a sweep."""

CONNECT_WITHIN_S = 5.0
PICTURE_WITHIN_S = 60.0
"""Maximum wait for a picture [s]; a run shows none until its processes are up, which takes long on a busy machine."""

Message = dict[str, Any]


class NoRunError(CommandError):
    """There is no run to watch; the text says why, and what to do."""

    code = FAILED


@dataclass
class Link:
    """A connection to a run, which holds the newest picture received."""

    end: socket.socket
    folder: Path
    hello: Message = field(default_factory=dict)
    picture: Message = field(default_factory=dict)
    is_over: bool = False
    """Whether the run has closed the connection, so that no more pictures come."""

    def __post_init__(self) -> None:
        self.end.setblocking(False)

    def receive(self) -> bool:
        """Receive all that has arrived, without waiting; return whether there was a picture."""
        newest: bytes | None = None
        while not self.is_over:
            try:
                data = self.end.recv(DATAGRAM_BYTES)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self.is_over = True
            elif self.hello:
                newest = data
            else:
                self.hello = orjson.loads(data)
        if newest is not None:
            self.picture = orjson.loads(newest)
        return newest is not None

    def wait(self) -> bool:
        """Wait for a picture; return False if there is still none when the time is over or the run has ended."""
        while not self.receive() and not self.is_over:
            if not select.select([self.end], [], [], PICTURE_WITHIN_S)[0]:
                break
        return bool(self.picture)

    def as_json(self) -> str:
        return orjson.dumps({"hello": self.hello, "picture": self.picture}).decode()


def linked(run: Path | None, base: Path) -> Link:
    """Connect to the run in a folder, or if None, to the newest run in progress below `base`.

    Raises:
        NoRunError: there is no such run, or this user may not watch it.
    """
    if run is not None:
        return _linked_to(run)
    files = [file for depth in DEPTHS for file in base.glob(f"{depth}{LIVE_SOCKET}")]
    for file in sorted(files, key=_made_at_s, reverse=True):
        with suppress(OSError):  # left by a run that was killed, or another user's
            return Link(connected(file.parent, CONNECT_WITHIN_S), file.parent)
    raise NoRunError(
        f"no run in progress that can be watched below {base.resolve()}; "
        "start one with `deltaswarm run`, or name the folder of a run"
    )


def _linked_to(run: Path) -> Link:
    part = part_of(run.resolve())
    folder = part if part.is_dir() and not (run / LIVE_SOCKET).exists() else run
    if not folder.is_dir():
        raise NoRunError(f"{run} must be the folder of a run in progress")
    try:
        return Link(connected(folder, CONNECT_WITHIN_S), folder)
    except PermissionError:
        raise NoRunError(f"{folder} is another user's run; only its owner can watch it") from None
    except OSError:
        pass
    if is_held(folder):
        raise NoRunError(
            f"{folder} is in progress but cannot be watched: it is just beginning or ending, it is neither recorded "
            "nor has processes, or its file system has no sockets"
        )
    raise NoRunError(f"{folder} is not in progress; for its results: {command_line('info', folder)}")


def _made_at_s(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0
