"""Orders from the world to the orchestrator about agents' processes, and their confirmations.

The world decides the time and the targets of a fault; the orchestrator owns the processes. Between two steps the world
sends its orders and waits for each one except notes.
"""

from typing import NamedTuple

from deltaswarm_wire.codec import (
    MAX_AGENT_ID,
    MAX_ID,
    MAX_ORDINARY_BYTES,
    MAX_STEP,
    PROTOCOL_VERSION,
    arrays,
    fields,
    integer,
    number,
    pack,
    text,
    unpack,
)
from deltaswarm_wire.messages import MAX_TIME_S

NOTE, KILL, START, STOP, GO_ON = "note", "kill", "start", "stop", "go on"
ACTIONS = (NOTE, KILL, START, STOP, GO_ON)
"""Nothing to do; SIGKILL; a new process with the same id; SIGSTOP; SIGCONT."""


class ProcessOrder(NamedTuple):
    """One action on the processes of some agents before step `step` begins; `why` is for display."""

    number: int
    step: int
    time_s: float
    action: str
    agents: tuple[int, ...]
    why: str

    @property
    def text(self) -> str:
        """The order as one line for display."""
        whom = f"agent {', '.join(map(str, self.agents))}" if self.agents else "nobody"
        return f"step {self.step}: {self.why}: {whom}" + ("" if self.action == NOTE else f" ({self.action})")


def encode_order(order: ProcessOrder) -> bytes:
    """A map with the fields of `ProcessOrder` and the version `v`. Raises WireError."""
    return pack({"v": PROTOCOL_VERSION, **order._asdict()}, MAX_ORDINARY_BYTES)


def decode_order(data: bytes) -> ProcessOrder:
    """Check and decode. Raises WireError."""
    raw = fields(unpack(data, MAX_ORDINARY_BYTES), ProcessOrder._fields, "order")
    agents = arrays(raw["agents"], MAX_AGENT_ID + 1, "order.agents")
    return ProcessOrder(
        integer(raw["number"], 0, MAX_ID, "order.number"),
        integer(raw["step"], 0, MAX_STEP, "order.step"),
        number(raw["time_s"], 0.0, MAX_TIME_S, "order.time_s"),
        text(raw["action"], "order.action", allowed=ACTIONS),
        tuple([integer(agent, 0, MAX_AGENT_ID, "order.agents") for agent in agents]),
        text(raw["why"], "order.why"),
    )


def encode_done(order: int) -> bytes:
    """Encode the confirmation of an order: a map of `v` and `order`."""
    return pack({"v": PROTOCOL_VERSION, "order": order})


def decode_done(data: bytes) -> int:
    """Check and decode. Raises WireError."""
    return integer(fields(unpack(data), ("order",), "done")["order"], 0, MAX_ID, "done.order")


def encode_save(step: int) -> bytes:
    """Encode the request that an agent save its state after this step: a map of `v` and `save`."""
    return pack({"v": PROTOCOL_VERSION, "save": step})


def decode_save(data: bytes) -> int:
    """Check and decode. Raises WireError."""
    return integer(fields(unpack(data), ("save",), "save")["save"], 0, MAX_STEP, "save.save")


def encode_taken(step: int) -> bytes:
    """Encode the newest step on disk (-1: none yet): a map of `v` and `step`."""
    return pack({"v": PROTOCOL_VERSION, "step": step})


def decode_taken(data: bytes) -> int:
    """Check and decode. Raises WireError."""
    return integer(fields(unpack(data), ("step",), "taken")["step"], -1, MAX_STEP, "taken.step")
