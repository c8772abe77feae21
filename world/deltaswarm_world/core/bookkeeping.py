"""A closed step's record, digest and truth: what the next step's frames do not need, so that it can wait for them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import (
    DEAD,
    UPLINK_REASONS,
    AgentState,
    EventState,
    Sample,
    StepRecord,
    Truth,
)
from deltaswarm_wire.controller_metrics import PREFIX, mean_of
from deltaswarm_wire.digest import ACT, COMMAND, RADIO, REPORT, Digest
from deltaswarm_wire.messages import NOBODY, Act, TreeStatus, encode_act
from deltaswarm_world.core.air.reception import Reception
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.density import Places
from deltaswarm_world.core.dynamics import BodyState
from deltaswarm_world.core.environment import Coverage
from deltaswarm_world.core.uplink.uplink import Uplink

SILENT, GONE = TreeStatus(), TreeStatus(DEAD)


class ClosedStep(NamedTuple):
    """What a step left that the beginning of the next one changes. Maps are by agent."""

    step: int
    time_s: float
    is_last: bool
    late: int
    """Number of agents without an act."""
    present: frozenset[int]
    acts: Mapping[int, tuple[bytes, Act]]
    transmitted: Mapping[int, bytes]
    delivered: Sequence[tuple[int, bytes]]
    """(agent, sample) of received base frames."""
    sent: Sequence[tuple[int, bytes]]
    """(agent, report) in agent order."""
    arrived: int
    tree_statuses: Mapping[int, TreeStatus]
    positions_m: Floats
    bodies: Sequence[BodyState] | None
    """Each body's state besides its position; None for points."""
    links: Sequence[tuple[int, int]]
    reception: Reception
    under_way: int
    rejected: int
    lost: int
    changed: Sequence[EventState]
    shown: Sequence[EventState] | None
    """Events that are incomplete or changed; None if nobody asked for them."""
    events_open: int
    events_completed: int


class Bookkeeping:
    """Keeps the digest of a run, and makes the record of each closed step, in order."""

    def __init__(self, scenario: Scenario, density: Places, reasons: Sequence[str], metrics: Sequence[str]) -> None:
        self.digest = Digest()
        self.agents_in_trees = 0
        """In the newest record."""
        self._agents = scenario.agents.count
        self._density = density
        self._coverage = Coverage(scenario)
        self._metrics = tuple(metrics)
        self._no_drops = dict.fromkeys(reasons, 0), dict.fromkeys(UPLINK_REASONS, 0)

    @property
    def own_columns(self) -> list[str]:
        return [PREFIX + name for name in self._metrics]

    def enter(self, closed: ClosedStep, uplink: Uplink | None) -> StepRecord:
        """Add a step to the digest; return its record. The uplink's state must still be that of the step."""
        self._hash(closed, with_reports=uplink is not None)
        sent, transmitted, reception = len(closed.sent), closed.transmitted, closed.reception
        statuses = closed.tree_statuses
        in_trees = sorted([agent for agent, status in statuses.items() if status.root != NOBODY])
        roots = [agent for agent in in_trees if statuses[agent].root == agent]
        self.agents_in_trees = len(in_trees)
        due = self._coverage.is_due(closed.step)
        no_frames, no_reports = self._no_drops
        return StepRecord(
            step=closed.step,
            time_s=closed.time_s,
            agents_alive=len(closed.present),
            agents_late=closed.late,
            agents_asked=len(closed.acts) + closed.late,
            agents_in_trees=len(in_trees),
            trees=len(roots),
            covered_area_m2=self._coverage.area_m2(closed.positions_m[in_trees]) if due else None,
            roots_from_densest_m=self._from_densest_m(closed, roots),
            delta=_mean_delta(statuses),
            events_open=closed.events_open,
            events_completed=closed.events_completed,
            frames_sent=len(transmitted),
            bytes_sent=sum(map(len, transmitted.values())),
            frames_received=len(closed.links),
            frames_duplicated=reception.duplicated,
            frames_in_flight=len(transmitted) * (self._agents - 1) + closed.under_way,
            rejected=closed.rejected,
            transport_lost=closed.lost,
            frames_dropped=no_frames | reception.dropped,
            reports_sent=sent,
            reports_arrived=closed.arrived if uplink else sent,
            reports_in_flight=uplink.under_way + sent - len(dict(closed.sent)) if uplink else 0,
            reports_dropped=no_reports | uplink.dropped if uplink else no_reports,
            metrics=mean_of(self._metrics, [act.metrics for _, act in closed.acts.values()]),
        )

    def _hash(self, closed: ClosedStep, with_reports: bool) -> None:
        step, add, transmitted = closed.step, self.digest.add, closed.transmitted
        for agent, data in closed.delivered:
            add(step, agent, COMMAND, data)
        for agent in sorted(closed.acts):
            if agent in transmitted:
                add(step, agent, RADIO, transmitted[agent])
            data, act = closed.acts[agent]
            add(step, agent, ACT, encode_act(act._replace(metrics=())) if act.metrics else data)
        for agent, data in closed.sent if with_reports else ():
            add(step, agent, REPORT, data)
        self.digest.end_step()

    def _from_densest_m(self, closed: ClosedStep, roots: Sequence[int]) -> float | None:
        """Return the mean distance of roots from the position at which events are densest [m].

        None if there are no roots, or events are equally dense everywhere.
        """
        densest_m = self._density.densest_m(closed.time_s) if roots else None
        if densest_m is None:
            return None
        offsets_m = closed.positions_m[roots] - densest_m
        return float(np.hypot(offsets_m[:, 0], offsets_m[:, 1]).mean())


def _mean_delta(statuses: Mapping[int, TreeStatus]) -> float | None:
    deltas = [status.delta for status in statuses.values() if status.delta]
    return sum(deltas) / len(deltas) if deltas else None


def samples_of(closed: ClosedStep) -> list[Sample]:
    frames = [(agent, RADIO, data) for agent, data in closed.transmitted.items()]
    return sorted(frames + [(agent, REPORT, data) for agent, data in closed.sent])


def truth_of(closed: ClosedStep, record: StepRecord, events: Sequence[EventState]) -> Truth:
    """Return the full state of a closed step for the recorder, with these events."""
    bodies, present, statuses = [], closed.present, closed.tree_statuses
    for agent, (x_m, y_m) in enumerate(closed.positions_m.tolist()):
        status = statuses.get(agent, SILENT) if agent in present else GONE
        body = closed.bodies[agent] if closed.bodies else ()
        bodies.append(AgentState(agent, x_m, y_m, *status, *body))
    return Truth(closed.step, closed.time_s, tuple(bodies), tuple(events), tuple(closed.links), record)
