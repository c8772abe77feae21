"""An agent around its controller: decodes, numbers and encodes messages, and checks what the controller returns."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from deltaswarm_agent.controller import Controller, ControllerError, Decision, Percept, checked_act, is_ours
from deltaswarm_agent.core.commands import CommandRelay, Verify
from deltaswarm_wire.codec import MAX_RADIO_BYTES, WireError, tuple_of
from deltaswarm_wire.commands import BASE_ID, Command, forms_of
from deltaswarm_wire.controller_metrics import ControllerMetric, values_of
from deltaswarm_wire.envelope import Sample, encode_sample, keep_sample, opened
from deltaswarm_wire.foreign import is_foreign
from deltaswarm_wire.messages import MAX_POSES, NOBODY, Act, Frame, Heard, Pose, TreeStatus, encode_act
from deltaswarm_wire.operator_messages import (
    MAX_MEMBERS,
    MAX_REPORTED,
    Report,
    decode_report,
    encode_report,
    keep_report,
)
from deltaswarm_wire.plugin_errors import defined_at, described, is_interrupt

ENVELOPE_BYTES = 16
"""What a radio frame takes besides its payload and the commands that it relays."""

FORGET_SENDER_S = 20.0
"""After this silence a sender may restart its counter."""


def act_of(decision: Decision, step: int) -> Act:
    """Convert a valid decision to an act: what `checked_act` returns, without its checks."""
    (vx_mps, vy_mps), observed, _, _, role, level, parent, root, until = decision[:9]
    held = step + 1 if until is None else min(until, step + MAX_POSES)
    status = tuple_of(TreeStatus, (role, level, parent, root, decision.delta))
    act: Act = tuple_of(Act, (step, vx_mps, vy_mps, observed, status, held, ()))
    return act


class StepOutput(NamedTuple):
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

    def newest_of(self, heard: Sequence[Heard], now: int) -> tuple[list[tuple[int, bytes]], list[bytes]]:
        """Return the newest payload of each sender, in sender order, and the commands that the frames relay.

        Late and duplicate frames are dropped.
        """
        newest: dict[int, bytes] = {}
        relayed: list[bytes] = []
        known = self._newest
        for sender, data in heard:
            try:
                counter, payload, commands = opened(data)
            except WireError:
                self.rejected += 1
                continue
            before = known.get(sender)
            is_new = before is None or counter > before[0] or now - before[1] > self._forget_steps
            if is_new and sender != self._agent:
                known[sender] = (counter, now)
                if payload is not None and sender != BASE_ID:
                    newest[sender] = payload
                if commands:
                    relayed += commands
        return sorted(newest.items()), relayed


class AgentCore:
    """One agent without input and output. `step`, or its two halves in turn, are its only mutating methods.

    `verify` says whether a command's signature is the operator's; without it every command is believed.
    """

    def __init__(self, agent: int, step_s: float, controller: Controller, verify: Verify | None = None) -> None:
        self.agent = agent
        self.controller = controller
        self.commands = CommandRelay(step_s, forms_of(controller), verify)
        self.rows_cut = 0
        """Events and members that did not fit into a report."""
        self._receiver = Receiver(agent, step_s)
        self._counter = 0
        self._sequence = 0
        self._root = NOBODY
        self._is_checked = not is_ours(controller)
        self._metrics: tuple[ControllerMetric, ...] = tuple(getattr(controller, "Metrics", ()))

    @property
    def rejected_frames(self) -> int:
        """Received frames with an invalid envelope."""
        return self._receiver.rejected

    @property
    def counts(self) -> str:
        """Counts for the log: its own, and the controller's own."""
        counts = {"rejected_envelopes": self.rejected_frames, "report_rows_cut": self.rows_cut}
        try:
            counts |= getattr(self.controller, "counts", {})
            return ", ".join(f"{name} {count}" for name, count in counts.items())
        except BaseException as error:  # of a plug-in, after all its decisions
            if is_interrupt(error):
                raise
            return f"counts of the controller failed: {described(error)}"

    def step(self, frame: Frame) -> StepOutput:
        """Decide. Frames come in order of their steps; steps may be missing between them."""
        return self.decide(self.perceive(frame))

    def perceive(self, frame: Frame) -> Percept:
        """Take a frame; return what its controller gets of it."""
        step, time_s, _, x_m, y_m, poses, events, heard, *felt = frame
        frames: list[tuple[int, bytes]] = []
        commands: tuple[Command, ...] = ()
        if heard:
            frames, relayed = self._receiver.newest_of(heard, step)
            if relayed:
                new = self.commands.hear(relayed, step)
                commands = tuple(
                    [command for command in new if command.target.covers(self.agent, (x_m, y_m), self._root)]
                )
        percept: Percept = tuple_of(Percept, (step, time_s, (x_m, y_m), poses, events, frames, commands, *felt))
        return percept

    def decide(self, percept: Percept) -> StepOutput:
        """Let the controller decide, and encode its decision. Raises ControllerError as `step` does."""
        step = percept.step
        try:
            controller: Any = self.controller  # whatever it returns is checked, or is ours
            decision = controller.step(percept)
        except BaseException as error:  # SystemExit too: it would end a run in one process
            if is_interrupt(error):
                raise
            raise ControllerError(self._failed_in(step), error, self._place) from error
        try:
            act = checked_act(decision, step) if self._is_checked else act_of(decision, step)
            if self._metrics:
                act = act._replace(metrics=values_of(self._metrics, controller.metrics))
            return self._outbound(act, decision, percept.pose)
        except Exception as error:  # the decision is invalid: no frame is the controller's
            text = f"{self._failed_in(step)}: {described(error)} ({defined_at(self._place)})"
            raise ControllerError(text) from error

    @property
    def _place(self) -> object:
        """Where an error is said to be that no line of the controller raised: in its own code."""
        kind: Any = type(self.controller)
        return kind.step if is_foreign(kind.step) else kind

    def _failed_in(self, step: int) -> str:
        return (
            f"controller {type(self.controller).__module__}:{type(self.controller).__qualname__} failed in step {step}"
        )

    def _outbound(self, act: Act, decision: Any, pose: Pose) -> StepOutput:
        """Number and encode. Raises ValueError for values that the wire cannot carry."""
        radio = report = report_bytes = None
        counter, payload, relay = self._counter, decision.payload, self.commands
        if decision.done or decision.refused or decision.superseded:
            relay.note(decision.done, decision.refused, decision.superseded)
        self._root = act.tree_status.root
        items: tuple[bytes, ...] = ()
        if relay.known:
            items = relay.due(act.step, MAX_RADIO_BYTES - ENVELOPE_BYTES - len(payload or b""))
            wake = relay.next_step(act.step)
            if wake is not None and wake < act.until:
                act = act._replace(until=wake)
        if payload is not None or items:
            sample = Sample(counter, payload, items)
            radio = encode_sample(sample)
            keep_sample(radio, sample)
            self._counter += 1
        reported = decision.report
        if reported is not None:
            report = Report(
                self.agent,
                self._sequence,
                act.step,
                act.tree_status.role,
                *pose,
                reported.followers,
                self._rows(reported.events, MAX_REPORTED, "events"),
                self._rows(reported.members, MAX_MEMBERS, "members"),
                relay.answers() if relay.known else (),
                act.tree_status.delta,
            )
            report_bytes = encode_report(report)
            if self._is_checked:
                report = decode_report(report_bytes)
            else:
                keep_report(report_bytes, report)
            self._sequence += 1
        output: StepOutput = tuple_of(StepOutput, (act, encode_act(act), counter, radio, report, report_bytes))
        return output

    def _rows(self, rows: Any, most: int, name: str) -> tuple[Any, ...]:
        if not isinstance(rows, tuple | list):
            raise TypeError(f"report.{name} must be a tuple of {name} (got {type(rows).__name__})")
        if len(rows) > most:
            self.rows_cut += len(rows) - most
            rows = rows[:most]
        return tuple(rows)
