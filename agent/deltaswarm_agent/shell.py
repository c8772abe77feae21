"""The shell around a controller: decodes, numbers and encodes messages, and checks what the controller returns."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from deltaswarm_agent.controller import Controller, ControllerError, Decision, Percept, checked_act
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.envelope import Sample, decode_sample, encode_sample
from deltaswarm_wire.messages import Act, Frame, Heard, Pose, encode_act
from deltaswarm_wire.operator_messages import MAX_REPORTED, Report, decode_report, encode_report
from deltaswarm_wire.plugins import described

FORGET_SENDER_S = 20.0
"""After this silence a sender may restart its counter."""


_opened = lru_cache(maxsize=256)(decode_sample)
"""Caches a frame with many receivers in one process."""


class Outbound(NamedTuple):
    """An agent's output in one step; the act closes it."""

    act: Act
    act_bytes: bytes
    counter: int
    """The radio frame's counter, if there is a frame."""
    radio: bytes | None
    report: Report | None
    report_bytes: bytes | None


class Receiver:
    """Decodes the envelopes of radio frames and keeps the newest frame of each sender."""

    def __init__(self, agent: int, step_s: float) -> None:
        self.rejected = 0
        """Frames that broke the protocol."""
        self._agent = agent
        self._forget_steps = round(FORGET_SENDER_S / step_s)
        self._newest: dict[int, tuple[int, int]] = {}

    def newest_of(self, heard: Sequence[Heard], now: int) -> list[tuple[int, bytes]]:
        """Return the newest payload of each sender, in sender order, without late and duplicate frames."""
        newest: dict[int, bytes] = {}
        known = self._newest
        for sender, data in heard:
            try:
                counter, payload, _ = _opened(data)
            except WireError:
                self.rejected += 1
                continue
            before = known.get(sender)
            is_new = before is None or counter > before[0] or now - before[1] > self._forget_steps
            if is_new and sender != self._agent:
                known[sender] = (counter, now)
                newest[sender] = payload
        return [(sender, newest[sender]) for sender in sorted(newest)]


class Shell:
    """One agent without input and output. `step` is its only mutating method."""

    def __init__(self, agent: int, step_s: float, controller: Controller) -> None:
        self.agent = agent
        self.controller = controller
        self._receiver = Receiver(agent, step_s)
        self._counter = 0
        self._sequence = 0

    @property
    def rejected_frames(self) -> int:
        """Received frames with an invalid envelope."""
        return self._receiver.rejected

    @property
    def counts(self) -> str:
        """Counts for the log: frames with an invalid envelope, and the controller's own counts."""
        own = getattr(self.controller, "counts", {})
        return ", ".join(
            f"{name} {count}" for name, count in {"rejected_envelopes": self.rejected_frames, **own}.items()
        )

    def step(self, frame: Frame) -> Outbound:
        """Decide. Frames come in order of their steps; steps may be missing between them.

        Raises:
            ControllerError: the controller raised, or returned an invalid decision.
        """
        step, time_s, _, x_m, y_m, poses, events, heard = frame
        frames = self._receiver.newest_of(heard, step) if heard else []
        percept = Percept(step, time_s, (x_m, y_m), poses, events, frames)
        try:
            decision = self.controller.step(percept)
            return self._outbound(checked_act(decision, step), decision, (x_m, y_m))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit too: it would end a run in one process
            name = f"{type(self.controller).__module__}:{type(self.controller).__qualname__}"
            raise ControllerError(f"controller {name} failed in step {step}: {described(error)}") from error

    def _outbound(self, act: Act, decision: Decision, pose: Pose) -> Outbound:
        """Number and encode. Raises ValueError for values that the wire cannot carry."""
        radio = report = report_bytes = None
        counter = self._counter
        if decision.payload is not None:
            radio = encode_sample(Sample(counter, decision.payload))
            self._counter += 1
        told = decision.report
        if told is not None:
            if not isinstance(told.events, tuple | list):
                raise TypeError(f"report.events must be a tuple of events (got {type(told.events).__name__})")
            events = tuple(told.events[:MAX_REPORTED])
            report = Report(self.agent, self._sequence, act.step, act.standing.role, *pose, told.followers, events)
            report_bytes = encode_report(report)
            report = decode_report(report_bytes)  # a controller may be third-party code
            self._sequence += 1
        return Outbound(act, encode_act(act), counter, radio, report, report_bytes)
