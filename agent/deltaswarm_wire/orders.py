"""Orders from the world to the orchestrator about agents' processes, and their confirmations.

The world decides the time and the targets of a fault; the orchestrator owns the processes. Between two steps the world
sends its orders and waits for each one except notes.
"""

from collections.abc import Callable
from typing import Annotated, NamedTuple

from deltaswarm_wire.codec import (
    MAX_AGENT_ID,
    MAX_ID,
    MAX_ORDINARY_BYTES,
    MAX_STEP,
    PROTOCOL_VERSION,
    fields,
    integer,
    pack,
    unpack,
)
from deltaswarm_wire.messages import MAX_TIME_S
from deltaswarm_wire.records import Limits, Record

NOTE, KILL, START, STOP, GO_ON = "note", "kill", "start", "stop", "go on"
ACTIONS = (NOTE, KILL, START, STOP, GO_ON)
"""Nothing to do; SIGKILL; a new process with the same id; SIGSTOP; SIGCONT."""


class ProcessOrder(NamedTuple):
    """One action on the processes of some agents before step `step` begins."""

    number: Annotated[int, Limits("its number", 0, MAX_ID)]
    step: Annotated[int, Limits("step", 0, MAX_STEP)]
    time_s: Annotated[float, Limits("simulated time [s]", 0.0, MAX_TIME_S)]
    action: Annotated[str, Limits("what to do", choices=ACTIONS)]
    agents: Annotated[tuple[int, ...], Limits("the agents", 0, MAX_AGENT_ID, most=MAX_AGENT_ID + 1)]
    why: Annotated[str, Limits("the reason, for display")]

    @property
    def text(self) -> str:
        """The order as one line for display."""
        whom = f"agent {', '.join(map(str, self.agents))}" if self.agents else "nobody"
        return f"step {self.step}: {self.why}: {whom}" + ("" if self.action == NOTE else f" ({self.action})")


MAX_WHY = 200
"""Characters of the reason that are sent: a plug-in may give a longer one."""

_ORDER = Record(ProcessOrder, "order", MAX_ORDINARY_BYTES)
decode_order = _ORDER.decode


def encode_order(order: ProcessOrder) -> bytes:
    """Encode an order with at most `MAX_WHY` characters of its reason. Raises WireError."""
    return _ORDER.encode(order._replace(why=str(order.why)[:MAX_WHY]))


def _one_number(message: str, field: str, low: int, high: int) -> tuple[Callable[[int], bytes], Callable[[bytes], int]]:
    """Return the codec of a number that is sent as a map of `v` and one field."""

    def encode(number: int) -> bytes:
        return pack({"v": PROTOCOL_VERSION, field: number})

    def decode(data: bytes) -> int:
        return integer(fields(unpack(data), (field,), message)[field], low, high, f"{message}.{field}")

    return encode, decode


encode_done, decode_done = _one_number("done", "order", 0, MAX_ID)
"""The confirmation of an order."""

encode_save, decode_save = _one_number("save", "save", 0, MAX_STEP)
"""The request that an agent save its state after this step."""

encode_taken, decode_taken = _one_number("taken", "step", -1, MAX_STEP)
"""The newest step on disk; -1: none yet."""
