"""Bounds: what a planner with perfect communication achieves if it knows the density of events, or all events.

The planner is that of central control. Its agents move, sense and work in the world like any others; they know what no
agent can know, so that they are made here and not by a controller's name. A bound is not proven to be the optimum.
"""

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from deltaswarm_agent.controller import Controller, Decision, OperatorReport, Percept, agent_rng
from deltaswarm_agent.controllers.central.controller import CentralSettings
from deltaswarm_agent.controllers.central.maps import Cells, KnownMap
from deltaswarm_agent.controllers.central.overview import ATTENDING, way
from deltaswarm_agent.controllers.central.planner import HELP_WITHIN_M, Planner
from deltaswarm_agent.recurring import Recurring
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.messages import FREE, Event, Pose
from deltaswarm_wire.settings import AgentSettings
from deltaswarm_world.core.arrays import generator
from deltaswarm_world.core.world import WorldCore

SAMPLES = 1000
"""Places drawn from the density, for its posts and patrols."""

ANEW_S = 60.0
"""A density that moves is sampled this often."""

SAMPLE_STREAM = 90


class KnowingPlanner:
    """Plans for all agents of a world with the truth about it."""

    def __init__(self, scenario: Scenario, world: WorldCore) -> None:
        task = scenario.for_agent(0)
        self.task, self._world, self._knows_events = task, world, scenario.run.bound == "everything"
        rng, places = generator(scenario.seed, SAMPLE_STREAM), world.environment.density
        cells = Cells(task)
        expected = KnownMap(
            cells,
            scenario.events.rate_hz,
            lambda time_s: np.array([places.draw(rng, time_s) for _ in range(SAMPLES)]),
            ANEW_S if scenario.events.density.moves else np.inf,
        )
        help_within_m = np.inf if self._knows_events else HELP_WITHIN_M  # known events need no search
        rng_of_plans, per_event = agent_rng(scenario.seed, 0), CentralSettings().agents_per_event
        self._planner = Planner(task, expected, cells, rng_of_plans, per_event, help_within_m)
        self._planned_s: float | None = None
        self.goals: dict[int, Pose] = {}

    @property
    def sensed(self) -> tuple[Event, ...]:
        """All open events that some agent has sensed."""
        return tuple([record.as_sensed for record in self._world.environment.active if record.sensed_s is not None])

    def goal_m(self, agent: int, time_s: float) -> Pose:
        """Return where an agent goes in this step."""
        if time_s != self._planned_s:
            self._planned_s = time_s
            environment = self._world.environment
            agents = dict(enumerate(map(tuple, environment.positions_m.tolist())))
            events = {
                record.event: (record.x_m, record.y_m)
                for record in environment.active
                if self._knows_events or record.sensed_s is not None
            }
            self.goals = self._planner.plan(time_s, agents, events)
        return self.goals[agent]


class KnowingController:
    """One agent that goes where the planner sends it; agent 0 reports all events that some agent has sensed."""

    Settings: ClassVar[type[CentralSettings]] = CentralSettings

    def __init__(self, agent: int, planner: KnowingPlanner) -> None:
        self._agent, self._planner = agent, planner
        self._reporting = Recurring(CentralSettings().report_every_s)

    def step(self, percept: Percept) -> Decision:
        """Go to the goal, and observe what is sensed there."""
        velocity, stands = way(percept.pose, self._planner.goal_m(self._agent, percept.time_s), self._planner.task)
        observed = tuple([event.event for event in percept.events]) if stands else ()
        report = None
        if self._agent == 0 and (events := self._planner.sensed) and self._reporting.is_due(percept.time_s):
            report = OperatorReport(events, len(self._planner.goals) - 1)
        return Decision(velocity, observed, report=report, role=ATTENDING if observed else FREE)


def knowing_controllers(scenario: Scenario, world: WorldCore) -> Callable[[int, AgentSettings, int], Controller]:
    """Return what makes an agent's controller, as `make_controller` does, for agents that share a planner."""
    planner = KnowingPlanner(scenario, world)
    return lambda agent, _settings, _restart: KnowingController(agent, planner)
