"""The planner of central control: from all positions and all sensed events it gives every agent a goal.

An agent that stands works on all events that it senses. So the planner sends the nearest free agents to events at which
nobody stands (a linear sum assignment), lets some agents wait at posts where many events occur, and lets the rest
patrol where events probably wait unsensed.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from random import Random

import numpy as np
from scipy.optimize import linear_sum_assignment

from deltaswarm_agent.controllers.central.maps import Cells, Expected, Floats
from deltaswarm_agent.controllers.central.overview import STANDS_M
from deltaswarm_wire.messages import Pose
from deltaswarm_wire.settings import AgentSettings

REACH_SHARE = 0.8
"""A post serves an event within this share of the sensing range at once."""

FAR_M = 30.0
"""A place farther than this from every post counts as this far when the first posts are chosen."""

CANDIDATES, ROUNDS = 60, 8
"""Number of places tried for each post, and of rounds in which all posts are moved."""

SERVED_WEIGHT = 0.05
"""Weight of a place that its post serves at once, when the post is moved."""

SOFTENING_M = 0.5
"""Keeps the weights of Weiszfeld's algorithm finite."""


def posts(places_m: Floats, count: int, sensing_range_m: float, rng: Random) -> Floats:
    """Return at most `count` posts (n, 2) for places (m, 2) [m]: the distances from posts to places are short.

    The first posts are chosen greedily from random places (k-median); then each moves towards the median of its places
    (Weiszfeld's algorithm).
    """
    reach_m = REACH_SHARE * sensing_range_m
    chosen: list[Floats] = []
    way_m = np.full(len(places_m), FAR_M)
    for _ in range(count):
        tried = [rng.randrange(len(places_m)) for _ in range(min(CANDIDATES, len(places_m)))]
        ways_m = np.minimum(_ways_m(places_m, places_m[tried], reach_m), way_m[:, None])
        best = int(ways_m.sum(axis=0).argmin())
        way_m = ways_m[:, best]
        chosen.append(places_m[tried[best]])
    found_m: Floats = np.array(chosen).reshape(-1, 2)
    for _ in range(ROUNDS if chosen else 0):
        away_m = np.hypot(*(places_m[:, None] - found_m).transpose(2, 0, 1))
        nearest = away_m.argmin(axis=1)
        nearest_m = away_m[np.arange(len(places_m)), nearest]
        weights = np.where(nearest_m > reach_m, 1.0, SERVED_WEIGHT) / (nearest_m + SOFTENING_M)
        for post in range(len(found_m)):
            mine = nearest == post
            if mine.any():
                found_m[post] = np.average(places_m[mine], axis=0, weights=weights[mine])
    return found_m


def _ways_m(places_m: Floats, from_m: Floats, reach_m: float) -> Floats:
    """Return how far one must go from each of the positions until each place is within reach [m]."""
    away_m: Floats = np.hypot(*(places_m[:, None] - from_m).transpose(2, 0, 1))
    return np.maximum(away_m - reach_m, 0.0)


POST_SHARE = 0.6
"""At most this share of the agents waits at posts."""

PLACES_PER_POST = 2
"""A post needs at least this number of places at which events occurred."""

POSTS_EVERY_S, PATROL_EVERY_S = 120.0, 20.0
"""Posts are found, and patrols sent elsewhere, this often."""

LEAVE_POST_M = 20.0
"""An agent is taken from its post only if every patrol is farther from the event by more than this."""

AT_EVENT_SHARE = 0.9
"""An agent goes to within this share of its sensing range of its event."""

DETOUR_M = 10.0
"""Added to a cell's distance, so that a patrol does not always prefer the next cell."""

HELP_WITHIN_M = 20.0
"""A patrol this near to an event helps there."""

PATROL_FOR_S = 2000.0
"""Time constant of the average rate at which patrols find events."""

FIRST_FINDS, FIRST_PATROL_S = 1.0, 300.0
"""That average starts from these finds in this time."""


@dataclass
class _Patrol:
    """A patrol's goal [m], and when it was chosen [s]."""

    goal_m: Floats
    since_s: float


class Planner:
    """Says where agents go. Call `plan` once a step.

    Patrols within `help_within_m` of an event help there until `agents_per_event` agents work at it. `rng` chooses the
    places that are tried as posts.
    """

    def __init__(
        self,
        task: AgentSettings,
        expected: Expected,
        cells: Cells,
        rng: Random,
        agents_per_event: int,
        help_within_m: float = HELP_WITHIN_M,
    ) -> None:
        self._range_m = task.sensing_range_m
        self._expected, self._cells, self._rng = expected, cells, rng
        self._agents_per_event, self._help_within_m = agents_per_event, help_within_m
        self._jobs: dict[int, int] = {}
        """Event by the agent that is sent to it."""
        self._helps: dict[int, int] = {}
        """Event by the agent that helps there."""
        self._posts: dict[int, Floats] = {}
        """Post by agent [m]."""
        self._patrols: dict[int, _Patrol] = {}
        self._known: set[int] = set()
        self._posted_s = -math.inf
        self._planned_s: float | None = None
        self._finds, self._patrol_s = FIRST_FINDS, FIRST_PATROL_S

    def plan(self, time_s: float, agents: Mapping[int, Pose], events: Mapping[int, Pose]) -> dict[int, Pose]:
        """Return the goal of each agent [m] for places of agents and of known open events [m]. Time must increase."""
        ids = sorted(agents)
        at_m = np.array([agents[agent] for agent in ids])
        for other in (self._jobs, self._posts, self._helps, self._patrols):
            for agent in other.keys() - agents.keys():
                del other[agent]
        self._look(time_s, at_m, events)
        if time_s - self._posted_s >= POSTS_EVERY_S - 1e-9:
            self._posted_s = time_s
            self._post(time_s, ids, at_m)
        self._serve(ids, at_m, events)
        self._help(ids, at_m, events)
        self._patrol(time_s, ids, at_m)
        return {agent: self._goal(agent, agents[agent], events) for agent in ids}

    def _goal(self, agent: int, at_m: Pose, events: Mapping[int, Pose]) -> Pose:
        if agent in self._jobs:
            return self._beside(events[self._jobs[agent]], at_m)
        if agent in self._helps:
            return self._beside(events[self._helps[agent]], at_m)
        goal_m = self._posts[agent] if agent in self._posts else self._patrols[agent].goal_m
        return float(goal_m[0]), float(goal_m[1])

    def _beside(self, event_m: Pose, at_m: Pose) -> Pose:
        """Return the nearest position that is near enough to an event."""
        dx, dy = at_m[0] - event_m[0], at_m[1] - event_m[1]
        near_m = AT_EVENT_SHARE * self._range_m
        away_m = (dx * dx + dy * dy) ** 0.5
        share = near_m / away_m if away_m > near_m else 1.0
        return event_m[0] + share * dx, event_m[1] + share * dy

    def _look(self, time_s: float, at_m: Floats, events: Mapping[int, Pose]) -> None:
        """Keep account of what patrols find, and of where events may wait unsensed."""
        passed_s = time_s - self._planned_s if self._planned_s is not None else 0.0
        self._planned_s = time_s
        self._cells.pass_time(self._expected.weights(time_s), passed_s)
        self._cells.see(at_m)
        patrols = len(at_m) - len(self._jobs.keys() | self._posts.keys() | self._helps.keys())
        kept = max(0.0, 1.0 - passed_s / PATROL_FOR_S)
        self._finds, self._patrol_s = self._finds * kept, self._patrol_s * kept + patrols * passed_s
        for event in sorted(events.keys() - self._known):
            self._expected.learn(time_s, *events[event])
            from_posts_m = [math.dist(post_m, events[event]) for post_m in self._posts.values()]
            self._finds += min(from_posts_m, default=math.inf) > self._range_m
        self._known = set(events)

    def _post(self, time_s: float, ids: list[int], at_m: Floats) -> None:
        """Find new posts; keep those at which more events occur than a patrol finds."""
        self._posts.clear()
        places_m = self._expected.places_m(time_s)
        count = min(int(POST_SHARE * len(ids)), len(places_m) // PLACES_PER_POST)
        if count == 0:
            return
        found_m = posts(places_m, count, self._range_m, self._rng)
        rates_hz = self._expected.rate_near_hz(time_s, found_m, self._range_m)
        found_m = found_m[rates_hz >= self._finds / self._patrol_s]
        free = [index for index, agent in enumerate(ids) if agent not in self._jobs]
        away_m = np.hypot(*(at_m[free][:, None] - found_m).transpose(2, 0, 1))
        for row, post in zip(*linear_sum_assignment(away_m), strict=True):
            self._posts[ids[free[row]]] = found_m[post]
            self._patrols.pop(ids[free[row]], None)
            self._helps.pop(ids[free[row]], None)

    def _serve(self, ids: list[int], at_m: Floats, events: Mapping[int, Pose]) -> None:
        """Send free agents to events without an agent."""
        self._jobs = {agent: event for agent, event in self._jobs.items() if event in events}
        standing = [index for index, agent in enumerate(ids) if self._stands(agent, at_m[index], events)]
        taken = set(self._jobs.values())
        open_events = sorted(event for event in events if event not in taken)
        if not open_events:
            return
        places_m = np.array([events[event] for event in open_events])
        away_m = np.hypot(*(at_m[:, None] - places_m).transpose(2, 0, 1))
        senses = away_m <= self._range_m
        is_alone = ~senses[standing].any(axis=0)
        at_work = {index for index in standing if senses[index].any()}
        free = [index for index, agent in enumerate(ids) if agent not in self._jobs and index not in at_work]
        costs_m = away_m[free][:, is_alone]
        costs_m[[ids[index] in self._posts for index in free]] += LEAVE_POST_M
        for row, column in zip(*linear_sum_assignment(costs_m), strict=True):
            agent = ids[free[row]]
            self._jobs[agent] = open_events[is_alone.nonzero()[0][column]]
            self._patrols.pop(agent, None)
            self._helps.pop(agent, None)

    def _help(self, ids: list[int], at_m: Floats, events: Mapping[int, Pose]) -> None:
        """Let patrols work on events nearby, so that these are completed sooner; new events take them away again."""
        self._helps = {agent: event for agent, event in self._helps.items() if event in events}
        free = [
            index
            for index, agent in enumerate(ids)
            if agent not in self._jobs and agent not in self._posts and agent not in self._helps
        ]
        if not events or not free:
            return
        at_work = Counter([*self._jobs.values(), *self._helps.values()])
        slots = [event for event in sorted(events) for _ in range(self._agents_per_event - at_work[event])]
        places_m = np.array([events[event] for event in slots]).reshape(-1, 2)
        away_m = np.hypot(*(at_m[free][:, None] - places_m).transpose(2, 0, 1))
        for row, column in zip(*linear_sum_assignment(away_m), strict=True):
            if away_m[row, column] <= self._help_within_m:
                agent = ids[free[row]]
                self._helps[agent] = slots[column]
                self._patrols.pop(agent, None)

    def _stands(self, agent: int, at_m: Floats, events: Mapping[int, Pose]) -> bool:
        """Whether an agent has arrived at its event or post."""
        if agent in self._jobs:
            near_m = AT_EVENT_SHARE * self._range_m + STANDS_M
            return math.dist(at_m, events[self._jobs[agent]]) <= near_m
        return agent in self._posts and math.dist(at_m, self._posts[agent]) <= STANDS_M

    def _patrol(self, time_s: float, ids: list[int], at_m: Floats) -> None:
        """Send each other agent where many events probably wait, not too far away, and no other patrol is."""
        for index, agent in enumerate(ids):
            if agent in self._jobs or agent in self._posts or agent in self._helps:
                continue
            patrol = self._patrols.get(agent)
            if patrol is not None:
                arrived = math.dist(patrol.goal_m, at_m[index]) <= STANDS_M
                if not arrived and time_s - patrol.since_s < PATROL_EVERY_S - 1e-9:
                    continue
            away_m = np.hypot(*(self._cells.centres_m - at_m[index]).T)
            worth = self._cells.waiting / (away_m + DETOUR_M)
            for other, elsewhere in self._patrols.items():
                if other != agent:
                    worth[np.hypot(*(self._cells.centres_m - elsewhere.goal_m).T) < 2.0 * self._range_m] = -1.0
            self._patrols[agent] = _Patrol(self._cells.centres_m[int(worth.argmax())], time_s)
