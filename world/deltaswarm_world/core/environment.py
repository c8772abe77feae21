"""Bodies and events: positions, sensing, work on events, and the area that members of trees sense."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import EventState
from deltaswarm_wire.messages import Event
from deltaswarm_wire.plugin_errors import PluginError
from deltaswarm_world.core.arrays import Floats, generator, near
from deltaswarm_world.core.arrivals import Arrivals, EventClasses
from deltaswarm_world.core.density import Places
from deltaswarm_world.core.dynamics import dynamics_of
from deltaswarm_world.core.faults.kind import ActiveFault
from deltaswarm_world.core.obstacles import Obstacles

START_STREAM = 2
COVERAGE_EVERY_S = 10.0
"""Interval of the coverage measure."""
MAX_TRIES = 10_000
"""After this many draws in a row at misplaced positions, there is no room for the agents."""


@dataclass
class EventRecord:
    """One event's life. Position in m, world frame; times in s."""

    event: int
    x_m: float
    y_m: float
    arrived_s: float
    sensed_s: float | None = None
    worked_s: float | None = None
    completed_s: float | None = None
    work_agent_s: float = 0.0
    as_sensed: Event = field(init=False)

    def __post_init__(self) -> None:
        self.as_sensed = Event(self.event, self.x_m, self.y_m)

    def state(self) -> EventState:
        times = (self.arrived_s, self.sensed_s, self.worked_s, self.completed_s)
        return EventState(self.event, self.x_m, self.y_m, *times, self.work_agent_s)


class Environment:
    """Positions (n, 2) [m; world frame] and velocities (one pair each) [m/s] of the agents, and all events."""

    def __init__(self, scenario: Scenario) -> None:
        count = scenario.agents.count
        size = np.array([scenario.arena.width_m, scenario.arena.height_m])
        self._obstacles = Obstacles(scenario.arena.obstacles)
        self.dynamics = dynamics_of(scenario, self._obstacles)
        self.hindered: frozenset[int] = frozenset()
        """Agents whose body touched something or was kept from moving in one of the last two steps."""
        self.positions_m = self._start(generator(scenario.seed, START_STREAM), count, size)
        self.velocities_mps: list[tuple[float, float]] = [(0.0, 0.0)] * count
        self.arrived: list[EventRecord] = []
        self.active: list[EventRecord] = []
        self.changed: list[EventRecord] = []
        """The events that arrived, were first sensed, were first worked on or were completed in this step."""
        self.completed = 0
        self._step_s = scenario.run.step_s
        self._speed_mps = scenario.agents.speed_mps
        self._sensing_range_m = scenario.agents.sensing_range_m
        self._work_agent_s = scenario.events.work_agent_s
        self.density = Places(scenario.events.density, scenario.arena, self._obstacles)
        self._arrivals = Arrivals(scenario, self.density)
        self._places_m: Floats = np.zeros((0, 2))
        task = scenario.operator.task
        self._classes = EventClasses(task, scenario.seed, size) if task.is_on else None
        self._interval = -1
        """The interval of the places at which events are sensed."""

    def command(self, agent: int, vx_mps: float, vy_mps: float) -> None:
        """Set an agent's velocity, cut to the speed limit with its direction kept."""
        speed = (vx_mps * vx_mps + vy_mps * vy_mps) ** 0.5
        if speed > self._speed_mps:
            vx_mps, vy_mps = vx_mps * self._speed_mps / speed, vy_mps * self._speed_mps / speed
        self.velocities_mps[agent] = vx_mps, vy_mps

    def move(self, drive: Callable[[Floats], None] | None = None, faults: Sequence[ActiveFault] = ()) -> None:
        """Move bodies by one step; the arena's edge and obstacles stop them.

        `drive`, if given, changes what bodies make of their commands, and `faults` are all active faults.
        """
        velocities_mps = np.array(self.velocities_mps)
        if drive is not None:
            drive(velocities_mps)
        felt_before = self.dynamics.bumped | self.dynamics.blocked
        self.positions_m = self.dynamics.move(self.positions_m, velocities_mps, faults)
        self.hindered = felt_before | self.dynamics.bumped | self.dynamics.blocked

    def _start(self, rng: np.random.Generator, count: int, size_m: Floats) -> Floats:
        """Return the positions at which the dynamics starts, or draw uniform ones in the arena, outside obstacles.

        Raises:
            PluginError: the dynamics find no room, or fail.
        """
        if (starts_m := self.dynamics.starts_m) is not None:
            return starts_m
        places_m: Floats = rng.random((count, 2)) * size_m
        for _ in range(MAX_TRIES):
            again = self.dynamics.misplaced(places_m).nonzero()[0]
            if not len(again):
                return places_m
            places_m[again] = rng.random((len(again), 2)) * size_m
        raise PluginError(f"the arena must leave room for {count} agents (got {MAX_TRIES} draws in a row without room)")

    def arrive(self, time_s: float) -> None:
        new = [EventRecord(*arrival) for arrival in self._arrivals.until(time_s)]
        if new:
            self.add(new)

    def add(self, events: Sequence[EventRecord]) -> None:
        self.arrived += events
        self.active += events
        self.changed += events
        self._place_active()

    def sense(
        self, time_s: float, present: list[bool], misses: Callable[[int], bool] | None = None
    ) -> list[list[Event]]:
        """Return each agent's events within sensing range and line of sight; note when an event is first sensed.

        `misses`, if given, says whether an agent misses an event that it would sense.
        """
        sensed: list[list[Event]] = [[] for _ in present]
        if self._classes is not None:
            self._jump(self._classes, time_s)
        if self.active:
            agents, indices = near(self.positions_m, self._places_m, self._sensing_range_m)
            if self._obstacles:
                seen = ~self._obstacles.hide(self.positions_m[agents], self._places_m[indices])
                agents, indices = agents[seen], indices[seen]
            for agent, index in zip(agents.tolist(), indices.tolist(), strict=True):
                if present[agent] and (misses is None or not misses(agent)):
                    record = self.active[index]
                    sensed[agent].append(record.as_sensed)
                    if record.sensed_s is None:
                        record.sensed_s = time_s
                        self.changed.append(record)
        return sensed

    def work(self, observers: dict[int, int], time_s: float) -> None:
        """Let each event's distinct observers work on it for one step; complete finished events."""
        done = False
        for record in [record for record in self.active if record.event in observers]:
            if record.worked_s is None:
                record.worked_s = time_s
                self.changed.append(record)
            record.work_agent_s += observers[record.event] * self._step_s
            if record.work_agent_s >= self._work_agent_s - 1e-9:
                record.completed_s = time_s
                self.changed.append(record)
                self.completed += 1
                done = True
        if done:
            self.active = [record for record in self.active if record.completed_s is None]
            self._place_active()

    def redraw(self, seed: int, time_s: float) -> None:
        """Redraw with another seed which events arrive after a time [s], and where they are sensed."""
        self._arrivals.redraw(seed, time_s)
        if self._classes is not None:
            self._classes.redraw(seed, [record.event for record in self.arrived])

    def states(self) -> list[EventState]:
        """Return all events so far in order of arrival, by id within a step."""
        return [event.state() for event in sorted(self.arrived, key=_by_arrival)]

    def states_to_show(self) -> list[EventState]:
        shown = {event.event: event for event in (*self.active, *self.changed)}
        return [event.state() for event in sorted(shown.values(), key=_by_arrival)]

    def targets(self) -> list[int] | None:
        """Return the ids of those events so far that are targets; None if events have no classes."""
        if (classes := self._classes) is None:
            return None
        return [record.event for record in self.arrived if classes.is_target(record.event)]

    def mean_waiting_s(self) -> float:
        """Return the mean waiting time of sensed events so far [s]; 0 before the first."""
        waits = [event.sensed_s - event.arrived_s for event in self.arrived if event.sensed_s is not None]
        return sum(waits, 0.0) / len(waits) if waits else 0.0

    def _jump(self, classes: EventClasses, time_s: float) -> None:
        """Move the places at which events are sensed, if an interval is over or an event has arrived."""
        interval = classes.interval(time_s)
        if interval != self._interval or self.changed:
            self._interval = interval
            for record in self.active:
                record.as_sensed = classes.as_sensed(record.event, record.x_m, record.y_m, interval)

    def _place_active(self) -> None:
        places = [(record.x_m, record.y_m) for record in self.active]
        self._places_m = np.array(places, dtype=np.float64).reshape(-1, 2)


def _by_arrival(record: EventRecord) -> tuple[float, int]:
    return record.arrived_s, record.event


class Coverage:
    """The area within sensing range of a tree's members, on a 1 m grid over the arena."""

    def __init__(self, scenario: Scenario) -> None:
        self._range_m = scenario.agents.sensing_range_m
        self._every = max(1, round(COVERAGE_EVERY_S / scenario.run.step_s))
        self._cells = max(1, round(scenario.arena.width_m)), max(1, round(scenario.arena.height_m))
        self._centres_m = tuple(np.arange(count) + 0.5 for count in self._cells)

    def is_due(self, step: int) -> bool:
        return step % self._every == 0

    def area_m2(self, places_m: Floats) -> float:
        """Return the area of the union of sensing discs around positions (n, 2), within the arena [m2]."""
        is_sensed, range_m = np.zeros(self._cells, dtype=np.bool_), self._range_m
        (x_centres_m, y_centres_m), range_m2 = self._centres_m, range_m**2
        for x_m, y_m in places_m.tolist():
            columns = slice(int(max(0.0, x_m - range_m)), int(x_m + range_m) + 1)
            rows = slice(int(max(0.0, y_m - range_m)), int(y_m + range_m) + 1)
            dx, dy = x_centres_m[columns] - x_m, y_centres_m[rows] - y_m
            is_sensed[columns, rows] |= (dx * dx)[:, None] + dy * dy <= range_m2
        return float(np.count_nonzero(is_sensed))
