"""The operator's base in open air: the radio frames in which commands leave it.

Pure: commands and times in, frames out. A frame is repeated during the commands' lives, since boards may come into
range later; boards relay what they hear by themselves.
"""

from collections.abc import Sequence
from typing import NamedTuple

from deltaswarm_wire.codec import MAX_ID, MAX_STEP
from deltaswarm_wire.commands import Relayed, Signed, decode_command, encode_relayed
from deltaswarm_wire.envelope import Sample, encode_sample, fitting

REPEAT_S = 5.0
MAX_FRAME_BYTES = 1400
"""A frame fits into one packet of most networks."""


class _Alive(NamedTuple):
    signed: Signed
    ends_s: float


class Base:
    """The base of one operator. Times are of any monotonic clock [s].

    Args:
        step_s: length of the boards' steps [s], in which they count a command's life.
        counter: frames are numbered from the next number on. Boards drop frames whose number does not grow, so a
            restarted operator must begin higher, for example with its start time.
    """

    def __init__(self, step_s: float, counter: int = 0) -> None:
        self.frames = 0
        self._step_s = step_s
        self._counter = counter
        self._alive: list[_Alive] = []
        self._first = 0
        self._due_s: float | None = None

    def send(self, commands: Sequence[Signed], now_s: float) -> None:
        for signed in commands:
            life_s = decode_command(signed.body).life_s
            self._alive.insert(0, _Alive(signed, now_s + max(life_s, self._step_s)))
        if commands:
            self._first = 0
            self._due_s = now_s

    def wait_s(self, now_s: float) -> float | None:
        """Return the time until the next frame is due [s]; None if there is none."""
        return None if self._due_s is None else max(0.0, self._due_s - now_s)

    def frame(self, now_s: float) -> bytes | None:
        """Return the frame that is due, if any: newest commands first; those that do not fit go into the next frame."""
        if self._due_s is None or now_s < self._due_s:
            return None
        self._alive = [alive for alive in self._alive if alive.ends_s - now_s >= self._step_s]
        if not self._alive:
            self._due_s = None
            return None
        if self._first >= len(self._alive):
            self._first = 0
        left = (
            Relayed(min(int((ends_s - now_s) / self._step_s), MAX_STEP), signed)
            for signed, ends_s in self._alive[self._first :]
        )
        items = fitting(map(encode_relayed, left), MAX_FRAME_BYTES)
        self._first += len(items)
        is_round_over = self._first >= len(self._alive)
        self._first = 0 if is_round_over else self._first
        # A board takes one frame from each sender per step.
        self._due_s = now_s + (REPEAT_S if is_round_over else min(2 * self._step_s, REPEAT_S))
        self._counter = min(self._counter + 1, MAX_ID)
        self.frames += 1
        return encode_sample(Sample(self._counter, None, items))
