"""Central control by radio: agent 0 plans for all, and every agent does what the plan says.

All agents must hear agent 0 and be heard by it, so the radio must reach across the arena. An agent that hears nothing
keeps its last goal; without agent 0 the swarm comes to a halt.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from deltaswarm_agent.controller import STAND, ControllerContext, Decision, OperatorReport, Percept
from deltaswarm_agent.controllers.central.frames import (
    SensedFrame,
    decode_plan,
    decode_sensed,
    encode_plan,
    encode_sensed,
)
from deltaswarm_agent.controllers.central.overview import ATTENDING, Overview, way
from deltaswarm_agent.recurring import Recurring
from deltaswarm_wire.checked import Problem, key
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.messages import FREE, Event, Pose
from deltaswarm_wire.settings import AgentSettings

PLANNER = 0
"""The agent that plans."""

FORGET_BEACONS = 3
"""After missing this many beacons of an agent, the planner plans without it."""


@dataclass(frozen=True)
class CentralSettings:
    """How the planner plans, and how agents and planner communicate."""

    agents_per_event: int = key(3, "agents that work at an event if enough are near", low=1, high=100)
    report_every_s: float = key(1.0, "interval of the planner's reports, at least one step [s]", above=0)
    beacon_s: float = key(5.0, "interval of frames without news [s]", above=0)

    def problems_with(self, shared: AgentSettings) -> list[Problem]:
        """The radio must reach across an arena without obstacles."""
        across_m = math.hypot(shared.width_m, shared.height_m)
        if shared.range_m < across_m:
            allowed = f"needs radio.range_m of at least {across_m:.1f} m: every agent must hear agent {PLANNER}"
            return [Problem("mode", f"'central' with {shared.range_m:.15g} m", allowed)]
        if shared.obstacles:
            return [
                Problem("mode", "'central' with obstacles", "needs an arena without obstacles: it plans straight paths")
            ]
        return []


class CentralController:
    """One agent of a centrally controlled swarm; agent 0 is also the planner."""

    Settings: ClassVar[type[CentralSettings]] = CentralSettings
    NEEDS: ClassVar[tuple[str, ...]] = ("scipy",)
    """Modules that the planner imports."""

    def __init__(self, context: ControllerContext) -> None:
        settings: CentralSettings = context.settings
        self.counts = {"rejected_payloads": 0}
        self._agent, self._task = context.agent, context.shared
        self._beaconing = Recurring(settings.beacon_s, context.rng.uniform(0.0, settings.beacon_s))
        self._reporting = Recurring(settings.report_every_s)
        self._goal: Pose | None = None
        self._told: tuple[int, ...] | None = None
        """Ids of the events in the last frame that was sent."""
        self._goals: dict[int, Pose] = {}
        if self._agent == PLANNER:
            # These import numpy and scipy, which the other agents do not need.
            from deltaswarm_agent.controllers.central.maps import Cells, LearntMap
            from deltaswarm_agent.controllers.central.planner import Planner

            cells = Cells(self._task)
            self._overview = Overview(self._task, FORGET_BEACONS * settings.beacon_s)
            self._planner = Planner(self._task, LearntMap(cells), cells, context.rng, settings.agents_per_event)

    def step(self, percept: Percept) -> Decision:
        """Plan, or hear the plan; go to the own goal, and observe what is sensed there."""
        is_planner = self._agent == PLANNER
        payload = self._plan(percept) if is_planner else self._report_sensed(percept)
        velocity, stands = (STAND, True) if self._goal is None else way(percept.pose, self._goal, self._task)
        observed = tuple([event.event for event in percept.events]) if stands else ()
        report = self._report(percept.time_s) if is_planner else None
        return Decision(velocity, observed, payload, report, ATTENDING if observed else FREE)

    def _plan(self, percept: Percept) -> bytes | None:
        """Plan from what was heard; return the plan if it is new or due again."""
        overview, now_s = self._overview, percept.time_s
        overview.advance(self._goals, now_s)
        for sender, payload in percept.heard:
            try:
                overview.update(sender, decode_sensed(payload), now_s)
            except WireError:
                self.counts["rejected_payloads"] += 1
        overview.update(self._agent, SensedFrame(percept.pose, percept.events), now_s)
        goals = self._planner.plan(now_s, overview.agents, overview.events)
        self._goal = goals[self._agent]
        is_new, self._goals = goals != self._goals, goals
        return encode_plan(goals) if self._beaconing.is_due(now_s) or is_new else None

    def _report_sensed(self, percept: Percept) -> bytes | None:
        """Take the own goal from the plan; return what is sensed if that is new, or due again."""
        for sender, payload in percept.heard:
            if sender == PLANNER:
                try:
                    self._goal = decode_plan(payload).get(self._agent, self._goal)
                except WireError:
                    self.counts["rejected_payloads"] += 1
        sensed = tuple(sorted(event.event for event in percept.events))
        is_due = self._beaconing.is_due(percept.time_s)
        if not is_due and sensed == self._told:
            return None
        self._told = sensed
        return encode_sensed(SensedFrame(percept.pose, percept.events))

    def _report(self, now_s: float) -> OperatorReport | None:
        """Report all known events, for all agents at once."""
        known = self._overview.events
        if not known or not self._reporting.is_due(now_s):
            return None
        events = tuple([Event(event, *known[event]) for event in sorted(known)])
        return OperatorReport(events, len(self._overview.agents) - 1)
