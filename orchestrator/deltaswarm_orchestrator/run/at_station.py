"""A person at the station of a run in one process: paces its steps, carries out inputs, and repeats a killed run."""

import queue
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.console_server import ANSWER_WITHIN_S, SHOW_EVERY_S, Channel, ConsoleServer, Outlet
from deltaswarm_operator.io.markers import markers_to
from deltaswarm_operator.io.wall_clock import WallClock
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.journal import BEGIN, INPUT, LOOK, SPEAK, STEP, Journal, Row
from deltaswarm_orchestrator.run.operating import briefing_of, note_totals
from deltaswarm_scenario.page_messages import made
from deltaswarm_scenario.person_tables import PERSON
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_world.core.pace import StepGate
from deltaswarm_world.core.turns import LIVE, OFF, Turns

Arrivals = queue.SimpleQueue[tuple[str, bytes | None]]
"""Inputs that wait, and whose; None: the page's channel has closed."""


@dataclass(eq=False)
class Seat:
    """Where a person takes part in a run in one process: channels to pages, and what is kept of the inputs."""

    run: str
    """Name of the run for its pages, which keep their inputs for it."""
    channel: Channel
    arrivals: Arrivals
    """What the channels take."""
    speed: float
    """Simulated per wall second to begin with; 0: as fast as possible."""
    conductor: Channel | None = None
    journal: Journal | None = None
    """Where inputs are kept; the rows that it has are repeated first."""
    markers: str = ""
    sheet: bytes | None = None
    """The session's sheet as it was filled in before the run; None: the page asks for it."""
    was_ended: bool = False
    """Whether the conductor has ended the run."""


class AtStation:
    """In place of `Operating`, for a console that a person is at.

    Args:
        scenario: of the run.
        folder: where the tables are written.
        seat: see there.
        turns: of the run's world.
        stopped: returns something true once the run should end.
    """

    def __init__(
        self, scenario: Scenario, folder: Path, seat: Seat, turns: Turns, stopped: Callable[[], object]
    ) -> None:
        briefing = briefing_of(scenario, seat.speed)
        self.console = Console(briefing)
        self._seat, self._stopped = seat, stopped
        self._clock = WallClock()
        turns.mode = LIVE if turns.mode == OFF else turns.mode
        self._gate = StepGate(turns, scenario.run.step_s, self._clock.now)
        self._past = deque(seat.journal.rows if seat.journal else ())
        """What is still to be repeated."""
        self._was_idle = False
        self._channels = [channel for channel in (seat.channel, seat.conductor) if channel is not None]
        for channel in self._channels:
            channel.is_muted = True
        self._server = ConsoleServer(
            seat.run,
            self.console,
            folder,
            Outlet(turns.accept, self._gate.set_pace, briefing.is_awaited),
            seat.channel,
            conductor=seat.conductor,
            clock=self._clock,
        )
        if self._past:
            self._repeat()
        else:
            self._note(Row(BEGIN, self._clock.now()))
            self._go_on()

    def wait(self, step: int) -> bool:
        """Serve the page until a step may begin; return whether it does, else the conductor has ended the run."""
        while self._past and self._past[0].kind != STEP:
            self._repeat()
        while not self._past and not self.console.is_ended:
            is_due = self._gate.may_begin(step) or bool(self._stopped())
            if is_due and self._seat.arrivals.empty():
                self._gate.begin_step()
                break
            self._serve(0.0 if is_due else self._gate.wait_s(step) or 0.0)
        self._seat.was_ended = self.console.is_ended
        return not self.console.is_ended

    def close_step(self, clock: Clock, workload: Workload, reports: Sequence[Report]) -> None:
        def close() -> None:
            self._server.close_step(clock, workload, tuple(reports))

        if self._past:
            self._repeat(close)
        else:
            self._note(Row(STEP, self._clock.now()), close)

    def answer_to_the_end(self) -> None:
        """After the last step, wait for the person's open answers."""
        while self._past:
            self._repeat()
        deadline = self._clock.now() + ANSWER_WITHIN_S
        while self._server.is_asking and self._clock.now() < deadline:
            self._serve(SHOW_EVERY_S)
            if self.console.is_ended or self._stopped():
                return

    def finish(self, outcome: Outcome) -> None:
        """Complete the tables and the operator's part of an outcome, and tell the pages that the run has ended."""
        self._server.finish()
        note_totals(outcome, self.console)
        for channel in self._channels:
            channel.send(made("ended"))
        if self._seat.journal is not None:
            self._seat.journal.close()

    def _serve(self, wait_s: float) -> None:
        """Carry out an input, if one comes in time; else look after the page."""
        try:
            by, data = self._seat.arrivals.get(timeout=min(wait_s, SHOW_EVERY_S))
        except queue.Empty:
            is_idle = self.console.beats.is_away and self.console.is_held
            if not (is_idle and self._was_idle):  # else nobody is there, and nothing changes
                self._note(Row(LOOK, self._clock.now()))
            self._was_idle = is_idle
        else:
            self._note(Row(INPUT, self._clock.now(), by, data))

    def _note(self, row: Row, close: Callable[[], None] | None = None) -> None:
        """Write down what happens now, then let it happen."""
        if self._seat.journal is not None:
            self._seat.journal.append(row)
        self._do(row, close)

    def _repeat(self, close: Callable[[], None] | None = None) -> None:
        """Let happen what happened next before the process was killed; after all of it, go on."""
        self._do(self._past.popleft(), close)
        if not self._past:
            self._go_on()

    def _do(self, row: Row, close: Callable[[], None] | None) -> None:
        """Let something happen, all of it in one moment."""
        self._clock.moment_s = row.wall_s
        try:
            if row.kind == BEGIN:
                self._server.start()
            elif row.kind == SPEAK:
                self._server.speak_anew()
            elif row.kind == STEP:
                assert close is not None
                close()
            else:
                if row.kind == INPUT:
                    self._server.on_intent(row.data, row.by)
                self._server.show()
        finally:
            self._clock.moment_s = None

    def _go_on(self) -> None:
        """Begin to speak to the pages; what was put in before the run comes first."""
        seat = self._seat
        self._clock.ahead_s = seat.journal.header.ahead_s if seat.journal else 0.0
        for channel in self._channels:
            channel.is_muted = False
        if seat.markers:
            self._server.mark(markers_to(seat.markers, seat.run))
        self._note(Row(SPEAK, self._clock.now()))
        if seat.sheet is not None and self.console.probes.is_sheet_open:
            self._note(Row(INPUT, self._clock.now(), PERSON, seat.sheet))
