"""For the tests of those who look on: what there is to see of a run, and sockets that nobody reads."""

import socket
from dataclasses import dataclass, field
from typing import Any

import orjson

from deltaswarm_orchestrator.live.observers import Paced
from deltaswarm_orchestrator.live.views import picture
from deltaswarm_scenario.truth import AgentState, EventState, Truth
from deltaswarm_wire.messages import NOBODY
from deltaswarm_wire.operator_messages import Status, Workload
from tests.support.truths import truth

WORKLOAD = Workload(7, 7.0, 3, 2, 3.0, 0.5, 12.0, 0, 0, 0)
STATUS = Status(7, 300, 7.0, 25, 11, 24.5, 3, 1, "running")
BODIES = (
    AgentState(0, 10.00049, 20.0, "root", 0, NOBODY, 0),
    AgentState(1, 11.0, 20.0, "member", 1, 0, 0),
    AgentState(2, 90.0, 79.0, "attending", 0, NOBODY, NOBODY),
    AgentState(3, 50.0, 50.0, "free", 0, NOBODY, NOBODY),
    AgentState(4, 50.0, 95.0, "dead", 0, NOBODY, NOBODY),
)
EVENTS = (EventState(5, 92.0, 70.0, 3.0, None, None, None, 0.0), EventState(6, 1.0, 1.0, 0.0, 1.0, 1.0, 7.0, 200.0))


def a_truth(step: int = 7) -> Truth:
    return truth(*BODIES, events=EVENTS)._replace(step=step, time_s=float(step))


@dataclass
class Seen:
    """A run as it is seen."""

    status: Status | None = STATUS
    newest_truth: Truth | None = field(default_factory=a_truth)
    newest_workload: Workload | None = WORKLOAD
    messages: int | None = 41


def shown(seen: Seen) -> dict[str, Any]:
    """The picture of a run, as whoever looks on decodes it."""
    data = picture(seen)
    assert data is not None
    return dict(orjson.loads(data))


def always() -> Paced:
    """Every moment is one to look."""
    ticks = iter(range(1_000_000))
    return Paced(lambda: float(next(ticks)))


def pair() -> tuple[socket.socket, socket.socket]:
    """Two ends of a connection, of which the second does not wait."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setblocking(False)
    return ours, theirs


def received(end: socket.socket) -> list[dict[str, Any]]:
    """All datagrams that have come."""
    found = []
    while True:
        try:
            data = end.recv(1 << 20)
        except BlockingIOError:
            return found
        if not data:
            return found
        found.append(dict(orjson.loads(data)))
