"""Wait for conditions, while samples, tokens and the operator's messages arrive and the status is published."""

import logging
import time
from collections import Counter
from collections.abc import Callable

from deltaswarm_wire.commands import Pace
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER
from deltaswarm_wire.operator_messages import Status, encode_status
from deltaswarm_wire.orders import ProcessOrder
from deltaswarm_world.core.pace import RealTimePace, StepGate
from deltaswarm_world.core.retransmit_buffer import RetransmitBuffer
from deltaswarm_world.core.turns import LIVE, OFF
from deltaswarm_world.io.saving import SavedWorld, WorldConfig
from deltaswarm_world.io.transport import Transport
from deltaswarm_world.io.wakeup import Ack, OperatorMessage, Persisted, Wakeup

log = logging.getLogger("deltaswarm.world")

STATUS_EVERY_S = 0.5
MAX_LOGGED = 100
"""Maximum number of logged arrivals and departures of one agent."""


class EventLoop:
    """Waits for conditions, and knows which processes are there and what they have on disk."""

    def __init__(self, config: WorldConfig, transport: Transport, wakeup: Wakeup, saved: SavedWorld) -> None:
        self._config = config
        self._settings = config.scenario.run
        self._core = saved.core
        self._transport = transport
        self._wakeup = wakeup
        self.buffer = RetransmitBuffer(transport.forwarded, transport.clock)
        self.buffer.confirm(self._core.participants.step)
        self.has_begun = False
        self.pace: RealTimePace | None = None
        turns = self._core.turns
        if config.has_station and turns.mode == OFF:
            turns.mode = LIVE
        self.gate = StepGate(turns, self._settings.step_s, time.monotonic)
        self.order_under_way: ProcessOrder | None = None
        """The order that is being carried out: the tokens of its agents come and go as planned."""
        self.status_due = 0.0
        self.tokens: set[tuple[str, int]] = set()
        self.persisted: dict[str, int] = {}
        """By role, the newest step that operator and recorder have, since they came."""
        self.is_over = False
        """Whether the last clock was sent."""
        self._phase = "waiting"
        self.operator_left = False
        """Whether the operator left and has not yet got what it missed."""
        self._warned: set[int] = set()
        self._changes: Counter[int] = Counter()

    def wait_until(self, condition: Callable[[], bool], within_s: float) -> bool:
        """Process arrivals until a condition holds; return False on a time-out. The pace excludes this wait."""
        began = time.monotonic()
        self._wakeup.wake_at(began + within_s)
        while not condition():
            if self.take_next():
                continue
            if not condition() and time.monotonic() >= self._wakeup.deadline:
                if self._wakeup.stop_requested:
                    raise InterruptedError("stopped by a signal")
                return False
        if self.pace:
            self.pace.pause(time.monotonic() - began)
        return True

    def take_next(self) -> bool:
        """Block until samples or a wake-up come, and take them; return whether there was no wake-up."""
        if self._transport.receive(self.take_sample):
            return True
        self.take_control()
        if time.monotonic() >= self.status_due:  # also where a step, or the end, takes long
            self.send_status(self._core.participants.step, self._phase)
        return False

    def take_sample(self, agent: int, leaf: str, data: bytes, act: bytes | None) -> None:
        hung = self._core.participants.hung
        was_hung = agent in hung
        reason = self._core.intake.receive(agent, leaf, data, act)
        if was_hung and agent not in hung:
            log.info("agent %d, which hung, answers again in step %d", agent, self._core.participants.step)
        if reason is not None and agent not in self._warned:
            self._warned.add(agent)
            log.warning("dropped a sample on a key of agent %d: %s (more are only counted)", agent, reason)

    def take_control(self) -> None:
        """Process tokens, confirmations and the operator's messages in order; pass workloads on to the recorder."""
        for message in self._wakeup.control.drain():
            if isinstance(message, Persisted):
                self.persisted[message.role] = message.step
                if message.role == OPERATOR and not self.operator_left:
                    self.buffer.confirm(message.step)
                continue
            if isinstance(message, Ack):
                self._transport.workload(message.data)
                continue
            if isinstance(message, OperatorMessage):
                if isinstance(message.message, Pace):
                    self.gate.set_pace(message.message)
                elif reason := self._core.turns.accept(message.message):
                    log.warning("dropped: %s", reason)
                continue
            role, number, is_there = message
            (self.tokens.add if is_there else self.tokens.discard)((role, number))
            if role == RECORDER and is_there and self._config.publish_truth:  # what it has, it says only later
                self.persisted.setdefault(role, self._core.participants.step)
            if role == AGENT and number < self._config.scenario.agents.count:
                self._take_token(number, is_there)
            elif not is_there:
                self.persisted.pop(role, None)
                self.operator_left |= role == OPERATOR and self.has_begun

    def _take_token(self, agent: int, there: bool) -> None:
        participants = self._core.participants
        if self.order_under_way is not None and agent in self.order_under_way.agents:
            return
        was_there = agent in participants.present
        (participants.token_back if there else participants.token_gone)(agent)
        if agent in participants.boards:  # samples may overtake the token that tells of a return
            self._core.intake.accept_any_next(agent)
        has_changed = was_there != (agent in participants.present)
        self._changes[agent] += has_changed
        if has_changed and self.has_begun and not self.is_over and self._changes[agent] <= MAX_LOGGED:
            log.warning("agent %d %s in step %d", agent, "is back" if there else "is gone", participants.step)

    def send_status(self, step: int, phase: str) -> None:
        self._phase = phase
        self.status_due = time.monotonic() + STATUS_EVERY_S
        core, step = self._core, max(step, 0)
        ready = sum(role == AGENT for role, _ in self.tokens)
        status = Status(
            step=step,
            steps=self._settings.steps,
            time_s=step * self._settings.step_s,
            agents_alive=ready if phase == "waiting" else len(core.participants.present),
            agents_in_trees=core.agents_in_trees,
            mean_waiting_s=core.environment.mean_waiting_s(),
            events_open=len(core.environment.active),
            events_completed=core.environment.completed,
            phase=phase,
        )
        self._transport.status(encode_status(status))
