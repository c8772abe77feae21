"""Conversion between local NED, the autopilot's frame, and the arena's frame, both in m.

With heading 0 the arena's x points east and its y north. The heading is the compass direction of +y, so it turns the
arena clockwise, seen from above. The origin is the arena's corner (0, 0) in local NED.
"""

import math
from typing import NamedTuple


class LocalFrame(NamedTuple):
    """The arena's corner (0, 0) [m; local NED] and the compass direction of its +y [degrees]."""

    origin_north_m: float = 0.0
    origin_east_m: float = 0.0
    heading_deg: float = 0.0

    def to_arena(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Convert a position in local NED to (x, y) in the arena."""
        return self.turned_to_arena(north_m - self.origin_north_m, east_m - self.origin_east_m)

    def turned_to_arena(self, north: float, east: float) -> tuple[float, float]:
        """Convert a vector (m or m/s) in local NED to (x, y)."""
        sine, cosine = self._turn()
        return cosine * east - sine * north, sine * east + cosine * north

    def turned_to_ned(self, x: float, y: float) -> tuple[float, float]:
        """Convert a vector (m or m/s) in the arena to (north, east)."""
        sine, cosine = self._turn()
        return cosine * y - sine * x, sine * y + cosine * x

    def _turn(self) -> tuple[float, float]:
        heading_rad = math.radians(self.heading_deg)
        return math.sin(heading_rad), math.cos(heading_rad)
