"""An agent's present and recent positions, and distances to others."""

from collections import deque

from deltaswarm_agent.controllers.paper.frames import PaperFrame
from deltaswarm_agent.core.obstacles import ObstacleMap
from deltaswarm_wire.messages import Pose
from deltaswarm_wire.settings import AgentSettings

RANGE_MARGIN_M = 0.02
"""Members of a tree keep this margin to the range: positions in frames are rounded to centimetres."""

AT_PLACE_M = 0.01
"""Tolerance of a target position."""

AT_EVENT_RADII = 3.0
"""A body has arrived at an event within this many radii: there is room beside a body that stands on the event."""


class Whereabouts:
    """The agent's place and its last ones [m; world frame]; places of others are as their frames say."""

    def __init__(self, shared: AgentSettings, d_min_m: float, trail_steps: int) -> None:
        self.x_m = 0.0
        self.y_m = 0.0
        self._trail: deque[Pose] = deque(maxlen=trail_steps)
        self._range_m2 = shared.range_m**2
        self._reach_m2 = (shared.range_m - RANGE_MARGIN_M) ** 2
        self._radius_m = shared.radius_m
        self._at_event_m2 = max(AT_PLACE_M, AT_EVENT_RADII * shared.radius_m) ** 2
        self._size_m = (shared.width_m, shared.height_m)
        self._obstacles = ObstacleMap(shared)
        self._d_min_m2 = d_min_m**2

    def move_to(self, pose: Pose, since: tuple[Pose, ...]) -> None:
        """The place in this step, and those since the last one."""
        if since:
            self._trail.extend(since)
        self.x_m, self.y_m = pose

    def keep(self) -> None:
        """This step's place becomes a past one."""
        self._trail.append((self.x_m, self.y_m))

    def distance_m2(self, x_m: float, y_m: float) -> float:
        return (x_m - self.x_m) ** 2 + (y_m - self.y_m) ** 2

    def is_at(self, x_m: float, y_m: float) -> bool:
        return self.distance_m2(x_m, y_m) <= AT_PLACE_M**2

    def is_at_event(self, x_m: float, y_m: float) -> bool:
        return self.distance_m2(x_m, y_m) <= self._at_event_m2

    def sender_m2(self, frame: PaperFrame) -> float:
        return (frame.x_cm * 0.01 - self.x_m) ** 2 + (frame.y_cm * 0.01 - self.y_m) ** 2

    def is_newly_met(self, frame: PaperFrame) -> bool:
        """Whether the sender is in range now and was not a moment ago ("moves within communication range")."""
        x_m, y_m = frame.x_cm * 0.01, frame.y_cm * 0.01
        range_m2 = self._range_m2
        return self.sender_m2(frame) <= range_m2 and any(
            (x_m - px) ** 2 + (y_m - py) ** 2 > range_m2 for px, py in self._trail
        )

    def is_apart(self, frame: PaperFrame) -> bool:
        """At least d_min away (Tree Growth)."""
        return self.sender_m2(frame) >= self._d_min_m2

    def is_within_reach(self, frame: PaperFrame) -> bool:
        """Within range, less the margin that members keep."""
        return self.sender_m2(frame) <= self._reach_m2

    def is_legal(self, frame: PaperFrame) -> bool:
        """Whether the sender is at a legal distance for a parent."""
        return self._d_min_m2 <= self.sender_m2(frame) <= self._reach_m2

    def is_reachable(self, x_m: float, y_m: float) -> bool:
        """Whether a place that another agent named can be gone to: straight on, with no obstacle in the way."""
        least_m = self._radius_m
        is_inside = least_m <= x_m <= self._size_m[0] - least_m and least_m <= y_m <= self._size_m[1] - least_m
        return is_inside and not self._obstacles.first_crossing(self.x_m, self.y_m, x_m - self.x_m, y_m - self.y_m)
