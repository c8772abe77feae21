"""The board's process: runs body, core and air in steps of the wall clock."""

import contextlib
import faulthandler
import logging
import math
import os
import queue
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

from deltaswarm_agent.body import BodyContext
from deltaswarm_agent.controller import make_controller
from deltaswarm_agent.core.agent_core import AgentCore, StepOutput
from deltaswarm_agent.core.commands import Verify
from deltaswarm_board.bodies import find_body, make_body, options_of
from deltaswarm_board.driver import Driver
from deltaswarm_board.open_air import OpenAir
from deltaswarm_board.service import Notifier, Stop, log_to, stop_on_signals
from deltaswarm_board.settings import BoardSettings
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.codec import MAX_STEP
from deltaswarm_wire.commands import Signed
from deltaswarm_wire.extras import missing
from deltaswarm_wire.keys import RADIO, REPORT
from deltaswarm_wire.messages import Heard
from deltaswarm_wire.signing import SigningError, age_limit, verifier


class StepTimer:
    """Step k is due at `start_s + k * step_s`, independent of earlier delays."""

    def __init__(self, step_s: float, start_s: float) -> None:
        self.skipped = 0
        """Number of missed steps."""
        self._step_s = step_s
        self._start_s = start_s
        self._next = 0

    def wait_s(self, now_s: float) -> float:
        """Return the time until the next step is due [s]; 0 if it is due."""
        return max(0.0, self._start_s + self._next * self._step_s - now_s)

    def due(self, now_s: float) -> int | None:
        """Return the step that is due, each once; None if none is due. Late steps are skipped, not made up for."""
        if self.wait_s(now_s) > 0.0:
            return None
        # The next step is due, even if rounding puts it slightly later; skip to the newest step that is due.
        step = max(self._next, math.floor((now_s - self._start_s) / self._step_s))
        step += self._start_s + (step + 1) * self._step_s <= now_s
        self.skipped += step - self._next
        self._next = step + 1
        return step


if TYPE_CHECKING:
    from deltaswarm_board.recording import FrameRecorder

log = logging.getLogger("deltaswarm.board")

ENDS_WITHIN_S = 3.0
"""Time after a signal at which a hanging body is abandoned [s]; systemd kills after 5 s."""


@dataclass(frozen=True)
class BoardRun:
    """A run of one agent on this board.

    `accelerate` is simulated seconds per wall second. The agent exits after `steps` steps or a signal.
    """

    settings: BoardSettings
    accelerate: float = 1.0
    steps: int = MAX_STEP

    def check(self) -> OpenAir:
        """Check the body, its options and the recorder; return the air, ready to open."""
        body = find_body(self.settings.body.kind)
        options_of(body, self.settings.body.options)
        if body.REAL_TIME and self.accelerate != 1.0:
            raise SettingsError(
                [Problem("--accelerate", f"{self.accelerate:.15g}", f"must be 1 for {body.__name__}, a real body")]
            )
        if self.settings.log.record != "off":
            _recorder_class()
        command_check(self.settings)
        return OpenAir(self.settings)


def run_board(run: BoardRun, air: OpenAir) -> int:
    """Run an agent on a board until SIGTERM, SIGINT or SIGHUP; return the exit code.

    Call it in the main thread, with the air from `BoardRun.check`.
    """
    settings = run.settings
    log_to(settings.log, settings.id)
    stop = stop_on_signals(_end_in_time)
    notifier = Notifier.from_environment()
    body_class = find_body(settings.body.kind)
    options = options_of(body_class, settings.body.options)
    seed, agent = settings.agent.seed, settings.id
    step_s = settings.agent.step_s
    core = AgentCore(agent, step_s, make_controller(agent, settings.agent), command_check(settings))
    body_rng = Random(f"deltaswarm/{seed}/agent/{agent}/body")
    body = make_body(body_class, options, BodyContext(agent, settings.agent, body_rng))
    body_settings = settings.body
    driver = Driver(core, body, step_s=step_s, arrive_m=body_settings.arrive_m, max_std_m=body_settings.max_std_m)
    recorder = _recorder(settings)
    try:
        air.open(run.accelerate)
        _Loop(run, driver, air, notifier, recorder).go(stop)
    finally:
        _end_in_time()
        notifier.stopping()
        try:
            body.close()  # the robot first: it must stop, whatever else fails
        finally:
            is_closed = air.close()
            if recorder:
                with contextlib.suppress(OSError):  # the disk is full, which was already logged
                    recorder.close()
            notifier.close()
    if not is_closed:
        logging.shutdown()
        os._exit(0)  # with a thread inside Zenoh, a normal interpreter exit would abort
    return 0


class _Loop:
    def __init__(
        self, run: BoardRun, driver: Driver, air: OpenAir, notifier: Notifier, recorder: "FrameRecorder | None"
    ) -> None:
        self._run = run
        self._driver = driver
        self._air = air
        self._notifier = notifier
        self._recorder = recorder
        self._step_s = run.settings.agent.step_s
        self._fault = ""

    def go(self, stop: Stop) -> None:
        settings = self._run.settings
        pace = StepTimer(self._step_s, self._air.now_s())
        line = StepTimer(settings.log.every_s, self._air.now_s() + settings.log.every_s)
        longest_s = self._notifier.alive_every_s or 60.0
        step = 0
        while step < self._run.steps:
            wait_s = min(pace.wait_s(self._air.now_s()) / self._run.accelerate, longest_s)
            if _signal_came(stop, wait_s):
                break
            self._notifier.alive()
            due = pace.due(self._air.now_s())
            if due is None:
                continue
            self._do_step(due)
            if step == 0:
                self._notifier.ready()
                log.info("agent %d has done its first step", settings.id)
            step = due + 1
            if line.due(self._air.now_s()) is not None:
                self._log_status(step, pace.skipped)
        self._log_status(step, pace.skipped)

    def _do_step(self, step: int) -> None:
        output = self._driver.step(step, step * self._step_s, self._receive)
        if output is not None:
            self._send(output)
        fault, before = self._driver.fault, self._fault
        if fault or before:
            self._air.health(fault)  # in each step: link or operator may appear after the fault
        if fault != before:
            self._fault = fault
            log.warning("the body is %s", f"not well: {fault}" if fault else "well")

    def _receive(self, place_m: tuple[float, float]) -> tuple[Heard, ...]:
        heard = self._air.receive(place_m)
        if self._recorder:
            for sender, data in heard:
                self._record(sender, RADIO, data)
        return heard

    def _record(self, agent: int, leaf: str, data: bytes) -> None:
        """Record a sample. A full disk ends the recording, not the agent."""
        if self._recorder:
            try:
                self._recorder.write(f"/agent/{agent}/{leaf}", data)
            except OSError as error:
                log.error("recording stopped: %s", error)
                self._recorder = None

    def _send(self, output: StepOutput) -> None:
        agent = self._run.settings.id
        if output.radio is not None:
            self._air.send(output.radio, self._driver.place_m)
            self._record(agent, RADIO, output.radio)
        if output.report_bytes is not None:
            self._air.report(output.report_bytes)
            self._record(agent, REPORT, output.report_bytes)

    def _log_status(self, step: int, skipped: int) -> None:
        driver = self._driver
        text = f"{driver.role} at ({driver.place_m[0]:.2f}, {driver.place_m[1]:.2f}) m"
        text += f", step {step}, skipped {skipped}, body faulty in {driver.faulty_steps}; {self._air.counts}"
        text += f"; commands refused {driver.refused_commands}" if driver.refused_commands else ""
        text += f"; not well: {self._fault}" if self._fault else ""
        log.info("%s", text)
        self._air.health(self._fault)
        self._notifier.status(text)


def _signal_came(stop: Stop, wait_s: float) -> bool:
    try:
        number = stop.get(timeout=wait_s) if wait_s > 0 else stop.get_nowait()
    except queue.Empty:
        return False
    log.info("stopped by %s", signal.Signals(number).name)
    return True


def _end_in_time() -> None:
    """Make sure that the process exits soon; if it hangs, it exits with tracebacks and code 1."""
    faulthandler.dump_traceback_later(ENDS_WITHIN_S, exit=True)


def command_check(settings: BoardSettings) -> Verify:
    """Return the check of commands: only the operator's pass, if its key is known, else none."""
    public = settings.air.operator_key
    if not public:
        return lambda _: False
    try:
        is_signed = verifier(public, settings.run)
    except SigningError as error:
        raise SettingsError([Problem("air.operator_key", repr(public), str(error))]) from None
    if not settings.air.has_clock:
        return is_signed
    is_current = age_limit(time.time)
    told: set[Signed] = set()
    """The first command that was not of now."""

    def verify(signed: Signed) -> bool:
        if not is_signed(signed):
            return False
        if not (passes := is_current(signed)) and not told:
            told.add(signed)
            log.warning("refused a command that is not of now by this board's clock: is it set? More are only counted")
        return passes

    return verify


def _recorder_class() -> "type[FrameRecorder]":
    try:
        from deltaswarm_board.recording import FrameRecorder
    except ImportError as error:
        raise SettingsError([Problem("log.record", "'mcap'", missing("mcap") or str(error))]) from None
    return FrameRecorder


def _recorder(settings: BoardSettings) -> "FrameRecorder | None":
    log_settings = settings.log
    if log_settings.record == "off":
        return None
    try:
        return _recorder_class()(
            Path(log_settings.folder), f"agent-{settings.id}", log_settings.max_bytes, log_settings.backups
        )
    except OSError as error:
        log.error("recording is off: %s", error)
        return None
