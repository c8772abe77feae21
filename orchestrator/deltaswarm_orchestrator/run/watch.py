"""Watch a running swarm: take messages, carry out the world's orders, notice parts that end or hang."""

import time

from deltaswarm_orchestrator.processes.elsewhere import SCHEDULER
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.processes.process import RunPart, wait_for
from deltaswarm_orchestrator.processes.starter import END_WITHIN_S, LaunchError
from deltaswarm_orchestrator.processes.station import STATION
from deltaswarm_orchestrator.run.ending import Reason
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.options import RunContext
from deltaswarm_wire.child import ENDED_BY_CONDUCTOR, GAVE_UP, LIMIT_REACHED, NO_ROOM, PLUGIN_FAILED, WORLD_LOST
from deltaswarm_wire.keys import AGENT, OPERATOR, WORLD

POLL_S = 0.1
CONDUCTOR = "the conductor"
"""What stopped a run that was ended on the conductor's page, for `exit_reason`."""
SILENCE_S = 8.0
"""The world sends its status twice a second; it counts as hung after `step_timeout_s` plus this time without one."""

STOOD_STILL_S = 2.0
"""If two checks are further apart than this [s], the orchestrator itself was stopped; earlier silence is ignored."""

STATION_RESTARTS = 5
ANSWER_WITHIN_S = 920.0
"""Maximum wait for the operator and its person's answers after the last step [s]."""

RESTARTS_WITHOUT_A_STEP = 3
"""After this many restarts in a row without a new step, the operator is not restarted again."""


class Watch:
    """Watches a swarm to its end, and notes in the context's `ending` what happens."""

    def __init__(self, context: RunContext, swarm: Swarm, observer: Observer) -> None:
        self._context, self._stop, self._ending = context, context.stop, context.ending
        self._swarm, self._observer = swarm, observer
        self._patience_s = context.scenario.run.step_timeout_s + SILENCE_S
        self._noted: set[RunPart] = set()
        self._deadline = float("inf")
        """When the orchestrator stops waiting for the world to end (monotonic wall time [s])."""
        self._silent_since = self._looked_at = time.monotonic()
        self._world_lost_at: float | None = None
        """Since when a part is known to have lost its world (monotonic wall time [s])."""
        self._awaits_status, self._status_at_end = False, observer.status
        self._station_restarts = 0
        self._step_at_restart = -1
        self._vain_restarts = 0

    def watch_to_the_end(self) -> None:
        swarm, observer = self._swarm, self._observer
        is_stopping = False
        while True:
            observer.work(POLL_S)
            self._show()
            if swarm.part(OPERATOR).exit_code == ENDED_BY_CONDUCTOR:
                self._stop.by = self._stop.by or CONDUCTOR
            if self._stop.by and not is_stopping:
                is_stopping = True
                self._end_soon()
            while observer.orders:
                order = observer.orders.popleft()
                swarm.carry_out(order)
                observer.confirm(order)
            observer.leave_when_done()
            if swarm.part(WORLD).exit_code is not None or time.monotonic() > self._deadline:
                break
            if silent_s := self._silent_too_long_s():
                state = "is stopped by a signal" if WORLD in self._stopped() else "hangs"
                self._ending.fail(f"the world said nothing for {silent_s:g} s {self.when}: it {state}")
                break
            if not self._context.folder.is_there():
                self._ending.fail(f"the run's folder was removed or moved {self.when}")
                break
            self._look_after_parts(is_stopping)
        while observer.work(POLL_S) and swarm.part(WORLD).exit_code is not None:
            pass  # take what is left; a world that still runs could go on sending forever
        if swarm.station is not None and swarm.part(WORLD).exit_code == 0:
            self._let_person_answer()
        if not is_stopping:
            self._note_ends(self._failed())

    def _silent_too_long_s(self) -> float:
        """Return how long the world may be silent, once it has been silent for longer; else 0.

        Silence while the orchestrator itself was stopped does not count. The limit is lower once a part lost the world.
        """
        now = time.monotonic()
        if now - self._looked_at > STOOD_STILL_S:
            self._silent_since = now
        self._looked_at, self._silent_since = now, max(self._silent_since, self._observer.heard_at)
        is_lost = any(part.exit_code == WORLD_LOST for part in self._swarm.ended())
        patience_s = min(self._patience_s, SILENCE_S) if is_lost else self._patience_s
        return patience_s if now - self._silent_since > patience_s else 0.0

    def _let_person_answer(self) -> None:
        """Wait for the operator, which may still ask its person questions after the last step, to end by itself."""
        operator, deadline = self._swarm.part(OPERATOR), time.monotonic() + ANSWER_WITHIN_S
        station = self._swarm.station
        while wait_for([operator], POLL_S) and not self._stop.by and time.monotonic() < deadline:
            self._look_after_parts(is_stopping=False)
            if station and not station.is_elsewhere and self._swarm.part(STATION).exit_code is not None:
                break  # it ended as asked, or cannot be started again

    def _show(self) -> None:
        observer = self._observer
        if observer.status is not None:
            workload = observer.newest_workload
            self._context.reporter.update(observer.status, workload.rate_60s_hz if workload else None)
        for live in self._context.observers:
            live.look(observer)

    def _end_soon(self) -> None:
        self._deadline = min(self._deadline, time.monotonic() + END_WITHIN_S)
        self._swarm.stop_world()

    def _look_after_parts(self, is_stopping: bool) -> None:
        if self._must_await_status() or self._must_await_world() or not (failed := self._failed()):
            return
        lacking = [] if self._has_begun else [part for part in failed if part.role != STATION]
        if lacking:
            self._swarm.stop_world()  # it would wait for them in vain
        if is_stopping:
            return
        self._note_ends(failed)
        if lacking:
            self._blame(lacking[0])
        for part in failed:
            if part.role == OPERATOR:
                if self._restart_operator(part):
                    self._ending.forget_log(part)
                else:
                    self._blame(part)
                    self._end_soon()
            elif part.role == STATION and part.number == 0:
                self._restart_station(part)
            elif part.role == SCHEDULER:
                self._blame(part)
                self._end_soon()  # its workers end, too

    def _must_await_status(self) -> bool:
        """Whether a part has ended and the newest status may be too old to tell if the first step had begun by then."""
        if self._has_begun or not self._newly_ended():
            return False
        status = self._observer.status
        if not self._awaits_status:
            self._status_at_end = status
        self._awaits_status = status is self._status_at_end
        return self._awaits_status

    def _must_await_world(self) -> bool:
        """Whether a part has lost the world, whose end or silence must be reported first, and no status came since."""
        if not any(part.exit_code == WORLD_LOST for part in self._newly_ended()):
            self._world_lost_at = None
            return False
        self._world_lost_at = self._world_lost_at or time.monotonic()
        return self._observer.heard_at <= self._world_lost_at

    def _restart_station(self, station: RunPart) -> None:
        """Restart the operator's station after it died; if that fails, the run continues without a station."""
        self._station_restarts += 1
        try:
            if self._station_restarts > STATION_RESTARTS:
                raise LaunchError(f"the station is not started again after {STATION_RESTARTS} times")
            self._swarm.start_station()
        except LaunchError as error:
            self._ending.why.append(str(error))
            self._swarm.give_up_station()
        else:
            self._ending.forget_log(station)
            self._swarm.write_pids()

    def _restart_operator(self, operator: RunPart) -> bool:
        """Restart the operator after it died; return False if a restart is impossible or would not help."""
        step = self._observer.newest_step
        self._vain_restarts = self._vain_restarts + 1 if step <= self._step_at_restart else 0
        self._step_at_restart = step
        if not self._has_begun or self._vain_restarts >= RESTARTS_WITHOUT_A_STEP:
            return False
        if operator.exit_code in (NO_ROOM, PLUGIN_FAILED):
            return False
        if self._swarm.part(WORLD).exit_code is not None:
            return False
        try:
            self._swarm.start_operator(publish_all=self._observer.records, is_restart=True)
        except LaunchError as error:
            self._ending.why.append(str(error))
            return False
        self._swarm.write_pids()
        self._ending.operator_restarts += 1
        return True

    @property
    def _has_begun(self) -> bool:
        status = self._observer.status
        return status is not None and status.phase != "waiting"

    def _failed(self) -> list[RunPart]:
        """Return the parts that have newly failed, in the order in which they ended.

        Last come those that lost the world, unless that was asked to end.
        """
        ended = self._newly_ended()
        self._noted.update(ended)
        failed = [part for part in ended if part.has_failed and part.exit_code != WORLD_LOST]
        lost = [part for part in ended if part.has_failed and part.exit_code == WORLD_LOST]
        return failed if lost and self._swarm.part(WORLD).was_asked_to_end else failed + lost

    def _newly_ended(self) -> list[RunPart]:
        return [part for part in self._swarm.ended() if part not in self._noted]

    def _note_ends(self, failed: list[RunPart]) -> None:
        ending = self._ending
        for part in failed:
            if part.exit_code == NO_ROOM and ending.disk_is_full:
                continue
            ending.disk_is_full |= part.exit_code == NO_ROOM
            if part.exit_code not in (NO_ROOM, LIMIT_REACHED, WORLD_LOST):  # whose cause the line tells
                ending.keep_log(part)
            part.seen = self.when
            ending.why.append(self._line(part))
            if part.role == WORLD:
                self._blame(part)

    def _blame(self, part: RunPart) -> None:
        self._ending.cause = self._ending.cause or self._line(part)

    def _line(self, part: RunPart) -> Reason:
        if part.role == AGENT and self._has_begun:
            return part
        stopped = self._stopped() if part.exit_code == GAVE_UP else []
        return "; ".join([*(f"{name} was stopped by a signal" for name in stopped), part.how_it_ended(self.when)])

    def _stopped(self) -> list[str]:
        """Return the parts of this machine that somebody has stopped."""
        return [part.name for part in self._swarm.parts if part.was_stopped]

    @property
    def when(self) -> str:
        """Where the run is, to follow what happened in a sentence."""
        return f"after step {self._step}" if self._has_begun else "before the first step"

    @property
    def _step(self) -> int:
        return max(self._observer.newest_step, self._observer.status.step if self._observer.status else -1)
