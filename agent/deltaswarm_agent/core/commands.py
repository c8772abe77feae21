"""How the operator's commands spread: an agent relays each command that it hears, hop by hop, until its life is over.

An agent relays a command as soon as it knows it, and then at doubling intervals, so that loss and distance delay a
command and do not stop it. Each agent accepts a command once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from deltaswarm_wire.codec import WireError
from deltaswarm_wire.commands import (
    AHEAD_S,
    Command,
    CommandForm,
    Relayed,
    Signed,
    decode_command,
    decode_relayed,
    encode_relayed,
    named,
)
from deltaswarm_wire.envelope import fitting
from deltaswarm_wire.operator_messages import DONE, HEARD, MAX_ANSWERS, REFUSED, SUPERSEDED, Answer

FIRST_INTERVAL_S, LONGEST_INTERVAL_S = 2.0, 16.0
"""Interval between the first two frames with a command; further intervals double, up to the longest."""

ANSWERED_S = 600.0
"""Time after a command's life for which an agent's reports still acknowledge it [s]."""

MAX_KNOWN = 4096
"""Numbers of commands that an agent remembers; when it has more, those below its newest ones count as known."""

CLOCK_DRIFT = 1e-3
"""Bound on the relative drift of an agent's clock from the operator's [s/s]."""

Verify = Callable[[Signed], bool]


@dataclass
class _Known:
    """A command that is relayed or acknowledged."""

    signed: Signed
    command: Command
    ends: int
    """The step with which its life ends."""
    latest_end: int
    """The step with which it ends at the latest, by the life that is signed."""
    send_at: int
    interval: int
    state: int = HEARD


class CommandRelay:
    """The commands that one agent knows. Steps are the agent's own.

    Args:
        step_s: length of a step [s].
        forms: the commands that the agent's controller accepts.
        verify: whether a command's signature is the operator's; without it every command is believed. With it numbers
            are seconds by the operator's clock. The newest one, and the time since it was heard, tell how late it is
            there at least, and so whether the life of a command is over that a relay has held back.
    """

    def __init__(self, step_s: float, forms: Sequence[CommandForm], verify: Verify | None = None) -> None:
        self.rejected = 0
        """Items that broke the protocol, whose signature is not the operator's, or whose life ended long ago."""
        self._step_s = step_s
        self._forms = forms
        self._verify = verify
        self.known: dict[int, _Known] = {}
        """The commands that are relayed or acknowledged, by number; empty in most steps."""
        self._of_body: dict[bytes, _Known] = {}
        """The same by their encoded commands: most of what is heard is a relay of one that is known."""
        self._numbers: set[int] = set()
        self._forgotten_below = 0
        self._newest = 0
        self._newest_heard = 0
        """The newest number, and the step in which it was heard."""

    def hear(self, items: Sequence[bytes], now: int) -> list[Command]:
        """Take the commands that a frame relays; return the new ones that the controller accepts.

        Their `life_s` is what remains of it. A command that is not yet carried out and turns out to live longer than
        the first relay of it said is returned again.
        """
        heard = [known for item in items if (known := self._accept(item, now)) and known.state == HEARD]
        return [known.command._replace(life_s=(known.ends - now) * self._step_s) for known in heard]

    def _accept(self, item: bytes, now: int) -> _Known | None:
        try:
            left_steps, signed = decode_relayed(item)
            if known := self._of_body.get(signed.body):
                return self._prolonged(known, signed, now + left_steps, now) if left_steps else None
            command = decode_command(signed.body)
        except WireError:
            self.rejected += 1
            return None
        number = command.number
        if left_steps == 0 or number < self._forgotten_below or number in self._numbers:
            return None
        if self._verify is not None:
            is_over = number + command.life_s + AHEAD_S < self._operators_clock_s(now)
            if is_over or not self._verify(signed):
                self.rejected += 1
                return None
        if number > self._operators_clock_s(now):
            self._newest, self._newest_heard = number, now
        self._remember(number)
        form = named(self._forms, command.name)
        accepted = form is not None and form.problem(command.target, command.arguments) is None
        latest_end = now + self._steps(command.life_s)
        known = _Known(
            signed, command, min(now + left_steps, latest_end), latest_end, now, self._steps(FIRST_INTERVAL_S)
        )
        known.state = HEARD if accepted else REFUSED
        self.known[number] = self._of_body[signed.body] = known
        return known

    def _operators_clock_s(self, now: int) -> float:
        """Return the operator's clock now, at the least [s]; 0 before anything is heard."""
        if not self._numbers:
            return 0.0
        return self._newest + (now - self._newest_heard) * self._step_s * (1.0 - CLOCK_DRIFT)

    def _prolonged(self, known: _Known, signed: Signed, ends: int, now: int) -> _Known | None:
        """Return a known command if it now lives longer: a relay that shortens lives must not silence it."""
        if known.signed != signed or min(ends, known.latest_end) <= known.ends:
            return None
        known.ends, known.send_at, known.interval = min(ends, known.latest_end), now, self._steps(FIRST_INTERVAL_S)
        return known

    def _remember(self, number: int) -> None:
        self._numbers.add(number)
        if len(self._numbers) > MAX_KNOWN:
            newest = sorted(self._numbers)[MAX_KNOWN // 2 :]
            self._forgotten_below = newest[0]
            self._numbers = set(newest)
            self._keep({number: known for number, known in self.known.items() if number >= newest[0]})

    def _keep(self, known: dict[int, _Known]) -> None:
        self.known, self._of_body = known, {one.signed.body: one for one in known.values()}

    def _steps(self, seconds: float) -> int:
        return max(1, round(seconds / self._step_s))

    def knows(self, number: int) -> bool:
        return number in self._numbers

    def due(self, now: int, room_bytes: int) -> tuple[bytes, ...]:
        """Return the commands that this step's radio frame relays, newest first, as many as fit."""
        if not self.known:
            return ()
        answered_until = now - self._steps(ANSWERED_S)
        if any(known.ends <= answered_until for known in self.known.values()):
            self._keep({number: known for number, known in self.known.items() if known.ends > answered_until})
        newest_first = sorted(self.known.items(), reverse=True)
        wanted = [known for _, known in newest_first if known.send_at <= now and known.ends > now + 1]
        items = fitting((encode_relayed(Relayed(known.ends - now - 1, known.signed)) for known in wanted), room_bytes)
        for known in wanted[: len(items)]:
            known.send_at = now + known.interval
            known.interval = min(2 * known.interval, self._steps(LONGEST_INTERVAL_S))
        return items

    def next_step(self, now: int) -> int | None:
        """Return the next step in which there is something to relay, if any."""
        times = [known.send_at for known in self.known.values() if known.ends > now + 1]
        return max(now + 1, min(times)) if times else None

    def note(self, done: Sequence[int], refused: Sequence[int], superseded: Sequence[int] = ()) -> None:
        """Note the commands that the controller has carried out, cannot carry out, or has replaced by later ones."""
        for numbers, state in ((done, DONE), (refused, REFUSED), (superseded, SUPERSEDED)):
            for number in numbers:
                if number in self.known:
                    self.known[number].state = state

    def answers(self) -> tuple[Answer, ...]:
        return tuple([Answer(number, self.known[number].state) for number in sorted(self.known)[-MAX_ANSWERS:]])
