"""The shell around a controller: hears, numbers and encodes, and holds the controller to what it may return."""

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
"""A sender unheard for this long may begin its counter anew."""


_opened = lru_cache(maxsize=256)(decode_sample)
"""In one process with others, a frame that many hear is opened once."""


class Outbound(NamedTuple):
    """What an agent sends in one step; the act closes it."""

    act: Act
    act_bytes: bytes
    counter: int
    """The radio frame's, if there is one."""
    radio: bytes | None
    report: Report | None
    report_bytes: bytes | None


class Receiver:
    """Takes radio frames out of their envelopes; of each sender it keeps the newest."""

    def __init__(self, agent: int, step_s: float) -> None:
        self.rejected = 0
        """Frames that broke the protocol."""
        self._agent = agent
        self._forget_steps = round(FORGET_SENDER_S / step_s)
        self._newest: dict[int, tuple[int, int]] = {}

    def newest_of(self, heard: Sequence[Heard], now: int) -> list[tuple[int, bytes]]:
        """Of each sender its newest payload, in sender order; late and duplicate frames are dropped."""
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
    """One agent without its edges. `step` is its one mutating method."""

    def __init__(self, agent: int, step_s: float, controller: Controller) -> None:
        self.agent = agent
        self.controller = controller
        self._receiver = Receiver(agent, step_s)
        self._counter = 0
        self._sequence = 0

    @property
    def rejected_frames(self) -> int:
        """Frames heard whose envelope broke the protocol."""
        return self._receiver.rejected

    @property
    def counts(self) -> str:
        """What was dropped, for a log: frames whose envelope broke the protocol, and the controller's own counts."""
        own = getattr(self.controller, "counts", {})
        return ", ".join(
            f"{name} {count}" for name, count in {"rejected_envelopes": self.rejected_frames, **own}.items()
        )

    def step(self, frame: Frame) -> Outbound:
        """Decide. Frames come in order of their steps; steps may be missing between them.

        Raises:
            ControllerError: the controller raised, or returned what it may not.
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
        """Number and encode. Raises ValueError for what the wire does not carry."""
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
            report = decode_report(report_bytes)  # a controller may be anybody's
            self._sequence += 1
        return Outbound(act, encode_act(act), counter, radio, report, report_bytes)
