"""A run under way: take what is heard, do what the world asks for, notice who ends, hangs or says nothing."""

import time
from collections.abc import Sequence

from deltaswarm_orchestrator.run.launch import END_WITHIN_S, LaunchError, Swarm
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.onlookers import Onlooker
from deltaswarm_orchestrator.run.part import Part, wait_for
from deltaswarm_orchestrator.run.reporter import Reporter
from deltaswarm_orchestrator.run.station import STATION
from deltaswarm_orchestrator.stopping import Stop
from deltaswarm_wire.exits import NO_ROOM, WORLD_LOST
from deltaswarm_wire.keys import OPERATOR, WORLD

POLL_S = 0.1
SILENCE_S = 8.0
"""The world says twice a second that it is there; after so long without a word, and `step_timeout_s`, it hangs."""

STOOD_STILL_S = 2.0
"""If this long passes between two looks, the orchestrator itself stood still, and the silence counts against nobody."""

STATION_RESTARTS = 5
ANSWER_WITHIN_S = 920.0
"""An operator that still asks its person something after the last step ends before this."""

WORLD_ENDS_WITHIN_S = 5.0
"""If an operator has lost its world, the world's own end may take so long to be known."""

RESTARTS_WITHOUT_A_STEP = 3
"""So often an operator may die before it has taken a single step more; then it cannot be helped."""


class Watch:
    """Watches a swarm to its end."""

    def __init__(
        self,
        swarm: Swarm,
        observer: Observer,
        reporter: Reporter,
        stop: Stop,
        patience_s: float,
        onlookers: Sequence[Onlooker] = (),
    ) -> None:
        self.why: list[str] = []
        """Who ended too early, and how; each a line."""
        self.logs: dict[str, str] = {}
        """The last lines of the logs of those who were not started again."""
        self.operator_restarts = 0
        self.disk_is_full = False
        """Whether `why` has the line of a part that found the disk full. More lines would say the same."""
        self._swarm = swarm
        self._observer = observer
        self._reporter = reporter
        self._stop = stop
        self._onlookers = onlookers
        self._patience_s = patience_s + SILENCE_S
        self._noted: set[Part] = set()
        self._deadline = float("inf")
        """When the orchestrator waits no longer for the world to end."""
        self._silent_since = self._looked_at = time.monotonic()
        self._station_restarts = 0
        self._taken_before = -1
        self._vain_restarts = 0

    def to_the_end(self) -> None:
        """Until the world has ended, or is given up."""
        swarm, observer = self._swarm, self._observer
        is_stopping = False
        while True:
            observer.work(POLL_S)
            self._show()
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
            self._look_after_parts(is_stopping)
            if self._is_silent():
                self.why.append(f"the world said nothing for {self._patience_s:g} s after step {self._step}: it hangs")
                break
        while observer.work(POLL_S) and swarm.part(WORLD).exit_code is not None:
            pass  # of a world that does not end there may be no end
        if swarm.has_station and swarm.part(WORLD).exit_code == 0:
            self._let_person_answer()
        if not is_stopping:
            self._mourn(self._failed())

    def _is_silent(self) -> bool:
        """Whether the world has said nothing for too long, during which the orchestrator itself looked all the time."""
        now = time.monotonic()
        if now - self._looked_at > STOOD_STILL_S:
            self._silent_since = now
        self._looked_at, self._silent_since = now, max(self._silent_since, self._observer.heard_at)
        return now - self._silent_since > self._patience_s

    def _let_person_answer(self) -> None:
        """At a station the operator may have something to ask after the last step; it ends by itself."""
        station = self._swarm.part(STATION)
        deadline = time.monotonic() + ANSWER_WITHIN_S
        while station.exit_code is None and not self._stop.by and time.monotonic() < deadline:
            if not wait_for([self._swarm.part(OPERATOR)], POLL_S):
                break

    def _show(self) -> None:
        observer = self._observer
        if observer.status is not None:
            workload = observer.newest_workload
            self._reporter.update(observer.status, workload.rate_60s_hz if workload else None)
        for onlooker in self._onlookers:
            onlooker.look(observer)

    def _end_soon(self) -> None:
        self._deadline = min(self._deadline, time.monotonic() + END_WITHIN_S)
        self._swarm.stop_world()

    def _look_after_parts(self, is_stopping: bool) -> None:
        failed = self._failed()
        if not failed:
            return
        if not self._has_begun:  # the world would wait for them in vain
            self._swarm.stop_world()
        if is_stopping:
            return
        self._mourn(failed)
        for part in failed:
            if part.role == OPERATOR:
                if self._start_again(part):
                    del self.logs[part.name]
                else:
                    self._end_soon()
            elif part.role == STATION:
                self._start_station_again(part)

    def _start_station_again(self, station: Part) -> None:
        """Start a station in place of one that died; without one the run goes on."""
        if station.number:
            return
        self._station_restarts += 1
        try:
            if self._station_restarts > STATION_RESTARTS:
                raise LaunchError(f"the station is not started again after {STATION_RESTARTS} times")
            self._swarm.start_station()
        except LaunchError as error:
            self.why.append(str(error))
            self._swarm.give_up_station()
        else:
            del self.logs[station.name]
            self._swarm.write_pids()

    def _start_again(self, operator: Part) -> bool:
        """Start an operator in place of one that died; False if that does not help."""
        taken = self._observer.newest_step
        self._vain_restarts = self._vain_restarts + 1 if taken <= self._taken_before else 0
        self._taken_before = taken
        if not self._has_begun or operator.exit_code == NO_ROOM or self._vain_restarts >= RESTARTS_WITHOUT_A_STEP:
            return False
        if self._swarm.part(WORLD).exit_code is not None:
            return False
        try:
            self._swarm.start_operator(publish_all=self._observer.records, go_on=True)
        except LaunchError as error:
            self.why.append(str(error))
            return False
        self._swarm.write_pids()
        self.operator_restarts += 1
        return True

    @property
    def _has_begun(self) -> bool:
        """Whether the first step is under way."""
        status = self._observer.status
        return status is not None and status.phase != "waiting"

    def _failed(self) -> list[Part]:
        """Who has ended since, and not as planned; the world before those that lost it."""
        ended = self._newly_ended()
        if any(part.exit_code == WORLD_LOST for part in ended):
            wait_for([self._swarm.part(WORLD)], WORLD_ENDS_WITHIN_S)
            ended = self._newly_ended()
        self._noted.update(ended)
        return [part for part in ended if part.exit_code != 0 and not part.ends_as_planned]

    def _newly_ended(self) -> list[Part]:
        return [part for part in self._swarm.ended() if part not in self._noted]

    def _mourn(self, failed: list[Part]) -> None:
        for part in failed:
            if part.exit_code != NO_ROOM:
                self.logs[part.name] = part.log_tail()
            elif self.disk_is_full:
                continue
            else:
                self.disk_is_full = True
            self.why.append(part.obituary(self._step if self._has_begun else None))

    @property
    def _step(self) -> int:
        """The newest step that has been heard of."""
        return max(self._observer.newest_step, self._observer.status.step if self._observer.status else -1)
