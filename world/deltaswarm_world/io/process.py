"""The world's process: its run, lock-step and clock. Only `transport.py`, `wakeup.py` and `slow_links.py` use Zenoh."""

import logging
import signal
import time
from collections.abc import Callable
from contextlib import suppress

from deltaswarm_scenario.truth import NOBODY_LEFT, encode_truth, encode_wire
from deltaswarm_wire.checkpoint import is_due
from deltaswarm_wire.child import GAVE_UP, ended_by
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER, Keys
from deltaswarm_wire.operator_messages import Clock, encode_clock, encode_forwarded
from deltaswarm_wire.orders import KILL, NOTE, START, ProcessOrder, encode_order
from deltaswarm_wire.session import closing
from deltaswarm_world.core.pace import RealTimePace, TimeoutBackoff
from deltaswarm_world.core.retransmit_buffer import AHEAD_STEPS, StepMessages
from deltaswarm_world.core.world import untimed
from deltaswarm_world.io import saving
from deltaswarm_world.io.event_loop import EventLoop
from deltaswarm_world.io.files import WorldOutput
from deltaswarm_world.io.phases import Phases
from deltaswarm_world.io.saving import SavedWorld, WorldConfig
from deltaswarm_world.io.slow_links import SlowLinks, trusted_sessions
from deltaswarm_world.io.transport import Transport, open_router
from deltaswarm_world.io.wakeup import Wakeup

log = logging.getLogger("deltaswarm.world")

SAVING_STEPS = 2.0
"""An agent may take this many step timeouts to save itself, and half as long after each miss."""

STOP_SIGNALS = {signal.SIGTERM, signal.SIGINT}

GOODBYE_S = 3.0
"""Time at the end for the other parts to leave [s]."""


class WorldProcess:
    """One run of the world over its transport, or the rest of a run from a checkpoint."""

    def __init__(self, config: WorldConfig, transport: Transport, wakeup: Wakeup, saved: SavedWorld) -> None:
        self._config = config
        self._settings = config.scenario.run
        self.core = saved.core
        self._transport = transport
        self._wakeup = wakeup
        self.loop = EventLoop(config, transport, wakeup, saved)
        self._backoff = saved.backoff
        self._saving_backoff = TimeoutBackoff(SAVING_STEPS * self._settings.step_timeout_s)
        self._restarts = saved.restarts
        self._lap: Callable[[str], None] = untimed
        self._unbooked = False
        """Whether the last closed step is not yet on file, and not yet announced."""
        self._overruns_before = saved.overruns
        self._probe_due = 0.0
        self._unanswered_s = 0.0
        """Time that steps have waited since all agents hung."""

    def wait_for_all(self) -> None:
        expected = {(AGENT, agent) for agent in self.core.participants.present}
        expected |= {(role, 0) for role in self._config.expect}
        if not self.loop.wait_until(lambda: self._are_there(expected), self._settings.start_timeout_s):
            missing = ", ".join(f"{role} {number}" for role, number in sorted(expected - self.loop.tokens))
            raise TimeoutError(f"all must be ready within {self._settings.start_timeout_s:g} s (missing: {missing})")

    def _are_there(self, expected: set[tuple[str, int]]) -> bool:
        if time.monotonic() >= self.loop.status_due:
            self.loop.send_status(-1, "waiting")
        return expected <= self.loop.tokens

    def run(self, output: WorldOutput) -> bool:
        """Run all steps; return True if none was cut off."""
        settings = self._settings
        first = self.core.participants.step + 1
        self.loop.has_begun = True
        output.started()
        self.loop.send_status(first, "running")
        if settings.clock == "realtime":
            self.loop.pace = RealTimePace(settings.step_s / settings.real_time_factor, time.monotonic, log.error)
        phases = Phases() if self._config.time_phases else None
        if phases:
            self._lap = self._transport.lap = phases
        try:
            step = self._steps(range(first, settings.steps), output)
        except BaseException:
            with suppress(TimeoutError, InterruptedError):
                self._book(output)
            raise
        complete = step == settings.steps - 1
        # A complete run may have to resume, too, if the disk has no room for its results.
        may_resume = self._config.checkpoint_steps > 0
        timed = {"step_times": phases.totals()} if phases else {}
        output.finish(self.core, complete, self._overruns, may_resume=may_resume, timed=timed)
        self.loop.send_status(step, "ended")
        return complete

    def _steps(self, steps: range, output: WorldOutput) -> int:
        """Run these steps, or fewer; return the last one. Book a step while the agents think about the next one."""
        core, lap = self.core, self._lap
        for step in steps:
            self._await_operator(step, output)
            for order in core.inject(step):
                self._book(output)
                self._give(order)
            last = step == steps[-1] or self._wakeup.stop_requested
            lap("held")
            self._transport.frames(core.begin(step, last, self._is_probe_due(last), lap))
            lap("frames")
            self._book(output)
            lap("bookkeeping")
            self._collect()
            if core.is_deserted:
                self._await_anybody()
            core.close(with_events=self._config.publish_truth)
            self._unbooked = True
            lap("close")
            if core.is_last:
                self._book(output)
                break
            if is_due(step, self._config.checkpoint_steps):
                self._book(output)
                self.save(step, output)
        return step

    def _await_operator(self, step: int, output: WorldOutput) -> None:
        """Hold a step back until the operator's turn has come and the pace allows the step."""
        gate, wakeup = self.loop.gate, self._wakeup
        self.loop.take_control()
        while not gate.may_begin(step) and not wakeup.stop_requested:
            self._book(output)
            if self.loop.operator_left:
                self._welcome_operator()
            wait_s = gate.wait_s(step)
            patience_s = self._settings.start_timeout_s if wait_s is None else wait_s

            def is_over() -> bool:
                return gate.may_begin(step) or wakeup.stop_requested or self.loop.operator_left

            if not self.loop.wait_until(is_over, patience_s) and wait_s is None:
                raise TimeoutError(f"the operator has not answered step {step - 2} within {patience_s:g} s")
        gate.begin_step()

    @property
    def _overruns(self) -> int:
        return self._overruns_before + (self.loop.pace.overruns if self.loop.pace else 0)

    def save(self, step: int, output: WorldOutput) -> None:
        """Write a checkpoint if all processes can take part; otherwise keep the previous checkpoint."""
        participants, intake = self.core.participants, self.core.intake
        agents = set(participants.taking_part())
        others = set(self._config.expect) - (set() if self._config.publish_truth else {RECORDER})

        def can_be_saved() -> bool:
            return not self.loop.operator_left and agents == participants.present

        def others_have() -> bool:
            return all(self.loop.persisted.get(role, -1) >= step for role in others)

        backoff, began = self._saving_backoff, time.monotonic()

        def is_enough() -> bool:
            _, longest_s = backoff.with_any(intake.unsaved, step)
            return not intake.unsaved or time.monotonic() >= began + longest_s

        if can_be_saved():
            intake.await_saved(agents)
            self._transport.save(agents, step)
            self.loop.wait_until(lambda: not can_be_saved() or is_enough(), backoff.most_s)
            self.loop.wait_until(lambda: not can_be_saved() or others_have(), self._settings.start_timeout_s)
        intake.unsaved |= saving.missing(self._config.out, step, agents)
        is_whole = others_have() and saving.has_operator(self._config.out, step)
        if not can_be_saved() or intake.unsaved or not is_whole:
            log.warning("no checkpoint after step %d: a process hangs, is frozen, is gone or cannot be saved", step)
            for agent in sorted(intake.unsaved):
                backoff.missed(agent, step)
                log.warning("agent %d did not save itself", agent)
            return
        saving.save(
            self._config.out,
            SavedWorld(
                core=self.core,
                backoff=self._backoff,
                restarts=self._restarts,
                table_bytes=output.sync(),
                wall_s=output.wall_s,
                overruns=self._overruns,
            ),
        )

    def _is_probe_due(self, last: bool) -> bool:
        """Whether boards that have hung for long get a frame; at the end all hung boards do, so that they see it."""
        now = time.monotonic()
        is_due = now >= self._probe_due
        if is_due or not self.core.participants.hung:
            self._probe_due = now + self._settings.step_timeout_s
        return is_due or last

    def _give(self, order: ProcessOrder) -> None:
        """Order the orchestrator to act on processes, and wait until it has, before the next step begins."""
        log.warning("%s", order.text)
        self._transport.order(encode_order(order))
        if order.action == NOTE:
            return
        self.loop.order_under_way = order
        if not self.loop.wait_until(lambda: self._is_done(order), self._settings.start_timeout_s):
            raise TimeoutError(f"orders must be done within {self._settings.start_timeout_s:g} s (got {order.text})")
        self.loop.order_under_way = None
        if order.action == START:
            self._restarts.update(order.agents)

    def _is_done(self, order: ProcessOrder) -> bool:
        tokens = [(AGENT, agent) in self.loop.tokens for agent in order.agents]
        as_told = {KILL: not any(tokens), START: all(tokens)}.get(order.action, True)
        return as_told and order.number in self._wakeup.done

    def _collect(self) -> None:
        """Wait until every agent has closed the step or its time is up; if all hang, wait for the first to return.

        Sleeping agents take part, so a step in which no agent is asked does not wait.
        """
        participants, wakeup, pace = self.core.participants, self._wakeup, self.loop.pace
        began = time.monotonic()
        everyone_hangs = 0 if participants.taking_part() else len(participants.hung)
        soonest_s, _ = self._backoff.with_any(participants.asked, participants.step)
        wakeup.wake_at(pace.next_tick() if pace else began + soonest_s)
        while not participants.is_closed or (everyone_hangs and len(participants.hung) == everyone_hangs):
            if self.loop.take_next() or time.monotonic() < wakeup.deadline:
                continue
            _, latest_s = self._backoff.with_any(participants.asked, participants.step)
            if pace or wakeup.stop_requested or time.monotonic() >= began + latest_s:
                self._give_up()
                break
            wakeup.wake_at(began + latest_s)
        if pace:
            wakeup.wake_at(pace.tick_ends_s)
            while time.monotonic() < pace.tick_ends_s and not wakeup.stop_requested:
                self.loop.take_next()
        self._transport.receive_waiting(self.loop.take_sample)  # late agents take part again in the next step
        self._check_answers(time.monotonic() - began)

    def _check_answers(self, waited_s: float) -> None:
        """Give up once all agents have hung for long, none of them a board, whose link may come back.

        A time in which this process was stopped, too, counts as one time-out.
        """
        participants, settings = self.core.participants, self._settings
        all_hang = participants.hung and participants.hung == participants.present and not participants.boards
        waited_s = min(waited_s, settings.step_timeout_s)
        self._unanswered_s = self._unanswered_s + waited_s if all_hang and not self.loop.pace else 0.0
        if self._unanswered_s > settings.start_timeout_s:
            raise TimeoutError(f"all agents hang: none has answered for {settings.start_timeout_s:g} s")

    def _await_anybody(self) -> None:
        """Wait for an agent to come back, whose link may have been cut; without one, this step is the last."""
        participants, settings = self.core.participants, self._settings
        patience_s = settings.start_timeout_s if participants.boards else settings.step_timeout_s
        self.loop.wait_until(lambda: bool(participants.present or self._wakeup.stop_requested), patience_s)
        if not participants.present and not self._wakeup.stop_requested:
            log.critical(NOBODY_LEFT)

    def _give_up(self) -> None:
        """Continue the step without the agents that have not closed it."""
        participants = self.core.participants
        for agent in sorted(participants.asked):
            self._backoff.missed(agent, participants.step)
            log.warning("step %d continues without agent %d, which hangs", participants.step, agent)

    def _book(self, output: WorldOutput) -> None:
        """Write down the last closed step and send it to recorder and operator, unless that has been done.

        Wait for a part that is far behind or being replaced.
        """
        if not self._unbooked:
            return
        self._unbooked = False
        core, transport, last = self.core, self._transport, self.core.closed.is_last
        record = core.book()
        output.write(record, core.closed.changed)  # a step is on file before it is announced
        if self._config.publish_truth:
            transport.truth(encode_truth(core.truth(record)))
        if self._config.publish_wire:
            transport.wire(encode_wire(record.step, core.samples))
        self.loop.take_control()
        reports = [encode_forwarded(forwarded) for forwarded in core.forwarded]
        clock = encode_clock(Clock(record.step, record.time_s, last))
        self.loop.buffer.add(StepMessages(record.step, reports, clock, last), now=not self.loop.operator_left)
        if self.loop.operator_left:
            self._welcome_operator()
        self.loop.is_over = last
        if not last and any(record.step - taken > AHEAD_STEPS for taken in self.loop.persisted.values()):
            self._let_catch_up(record.step)
        if time.monotonic() >= self.loop.status_due:
            self.loop.send_status(record.step, "running")

    def _welcome_operator(self) -> None:
        """Wait for the operator that replaces the lost one, and send it what it missed."""
        step, patience_s = self.core.participants.step, self._settings.start_timeout_s
        log.warning("the operator is gone in step %d; waiting for it", step)
        if not self.loop.wait_until(lambda: OPERATOR in self.loop.persisted, patience_s):
            raise TimeoutError(f"the operator, gone in step {step}, must come back within {patience_s:g} s")
        self.loop.operator_left = False
        self.loop.buffer.resend_after(self.loop.persisted[OPERATOR])
        log.warning("the operator is back; it had the steps up to %d", self.loop.buffer.confirmed)

    def _let_catch_up(self, step: int) -> None:
        """Wait for parts that are far behind, unless a signal came: then the last step comes at once."""

        def behind() -> list[str]:
            return [role for role, taken in self.loop.persisted.items() if step - taken > AHEAD_STEPS // 2]

        def is_over() -> bool:
            return self._wakeup.stop_requested or self.loop.operator_left or not behind()

        if not self.loop.wait_until(is_over, self._settings.start_timeout_s):
            raise TimeoutError(f"{', '.join(behind())} must take a step within {self._settings.start_timeout_s:g} s")

    def goodbye(self) -> None:
        """Let operator and recorder take what was sent and leave; then undeclare the world's token."""
        last = self.core.participants.step

        def has_all() -> bool:
            return self.loop.buffer.confirmed >= last

        while OPERATOR in self._config.expect and not has_all():
            if self.loop.operator_left:
                self._welcome_operator()
            elif not self.loop.wait_until(lambda: self.loop.operator_left or has_all(), self._settings.start_timeout_s):
                raise TimeoutError(f"the operator must take step {last} within {self._settings.start_timeout_s:g} s")
        if not self.loop.wait_until(lambda: not self.loop.tokens & {(OPERATOR, 0), (RECORDER, 0)}, GOODBYE_S):
            log.warning("some parts did not leave within %g s", GOODBYE_S)
        self._transport.leave()


def run_world(config: WorldConfig, announce: Callable[[str], None], saved: SavedWorld | None = None) -> int:
    """Run the router and the world of one run; return the exit code: 0 if complete, or one of `deltaswarm_wire.child`.

    `announce` gets the endpoints, separated by spaces, once the router listens on them. With `saved` the world resumes.

    Raises:
        ConnectionError: the router cannot listen.
        PluginError: a plug-in failed, or cannot be saved although checkpoints are on.
    """
    early: list[int] = []
    for number in STOP_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, _: early.append(number))
    saved = saved or SavedWorld.new(config)
    keys, agents = Keys(config.run), range(config.scenario.agents.count)
    trusted = trusted_sessions(config.credentials.read_text(encoding="utf-8"))
    asked = config.listen or (config.link.endpoint,)
    session, endpoints = open_router(config.link, str(config.credentials), keys, agents, asked)
    # The tables come second, so that a world that cannot listen touches none.
    with (
        closing(session, log.warning),
        WorldOutput(config.out, saved.core.columns, saved.table_bytes, saved.wall_s) as output,
    ):
        wakeup, transport = Wakeup(session, keys), Transport(session, keys, len(agents))
        slow_links = SlowLinks(session, trusted, transport.waits_for)
        announce(" ".join(endpoints))  # from here on they come
        if early:  # the signal came before the wakeup was ready
            signal.raise_signal(early[0])
        try:
            world = WorldProcess(config, transport, wakeup, saved)
            world.wait_for_all()
            complete = world.run(output)
            world.goodbye()
        except TimeoutError as error:
            log.critical("%s", error)
            return GAVE_UP
        except InterruptedError:
            complete = False
        finally:
            transport.close()
            wakeup.close()
            slow_links.close()
    if not complete and saved.core.is_deserted and not wakeup.stop_requested:
        return GAVE_UP
    return 0 if complete else ended_by(wakeup.stopped_by)
