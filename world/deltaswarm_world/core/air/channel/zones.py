"""Effects limited to places or times: walls, obstacles, jammers, blackouts."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Self

import numpy as np

from deltaswarm_scenario.radio import BlackoutSettings, JammerSettings, WallSettings
from deltaswarm_world.core.air.channel.links import Diagnosis, Links
from deltaswarm_world.core.air.channel.model import Context
from deltaswarm_world.core.air.channel.reach import Reach
from deltaswarm_world.core.arrays import Floats, Mask
from deltaswarm_world.core.obstacles import Obstacles


def is_on(zone: BlackoutSettings | JammerSettings | WallSettings, time_s: float) -> bool:
    """Whether a time is in [from_s, until_s)."""
    return zone.from_s <= time_s and (zone.until_s is None or time_s < zone.until_s)


def _when(zone: BlackoutSettings | JammerSettings | WallSettings) -> str:
    return f"from {zone.from_s:g} s" + ("" if zone.until_s is None else f" to {zone.until_s:g} s")


class Blackouts:
    """Periods without reception; outages of the operator's uplink."""

    reason = "blackout"
    meaning = "no frame gets through at this time"
    holds_for_step = True

    def __init__(self, zones: Sequence[BlackoutSettings], reason: str = "blackout") -> None:
        self.reason = reason
        self._zones = zones

    @classmethod
    def of(cls, context: Context) -> Self | None:
        zones = context.scenario.radio.blackouts
        return cls(zones) if zones else None

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        return np.ones(len(links), dtype=np.bool_) if any(is_on(zone, time_s) for zone in self._zones) else None

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        for index, zone in enumerate(self._zones):
            if is_on(zone, time_s):
                return Diagnosis(self.reason, True, f"{self.reason} {index}, {_when(zone)}", {self.reason: index})
        return Diagnosis(self.reason, False, f"no {self.reason} now", {})


class Walls:
    """Walls cut frames whose line of sight crosses them between a wall's two ends."""

    reason = "partition"
    meaning = "a wall is in between"
    holds_for_step = True

    def __init__(self, walls: Sequence[WallSettings]) -> None:
        self._walls = walls

    @classmethod
    def of(cls, context: Context) -> Self | None:
        walls = context.scenario.radio.walls
        return cls(walls) if walls else None

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        cut: Mask | None = None
        for wall in self._walls:
            if is_on(wall, time_s):
                crossed = crosses(links, wall)
                cut = crossed if cut is None else cut | crossed
        return cut

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        for index, wall in enumerate(self._walls):
            if is_on(wall, time_s) and crosses(links, wall)[0]:
                says = f"crosses wall {index} from {_at(wall.a_m)} to {_at(wall.b_m)}, {_when(wall)}"
                return Diagnosis(self.reason, True, says, {"wall": index, "a_m": list(wall.a_m), "b_m": list(wall.b_m)})
        return Diagnosis(self.reason, False, "no wall between them now", {})


def crosses(links: Links, wall: WallSettings) -> Mask:
    """Return which links cross a wall, equal in both directions."""
    from_side, to_side = np.sign(_side(wall, links.speakers_m)), np.sign(_side(wall, links.listeners_m))
    cut: Mask = from_side[links.columns] * to_side[links.rows] < 0
    opposite = cut.nonzero()[0]
    if len(opposite):
        swapped = (links.senders[opposite] > links.receivers[opposite])[:, None]
        from_m, to_m = links.from_m[opposite], links.to_m[opposite]
        p, q = np.where(swapped, to_m, from_m), np.where(swapped, from_m, to_m)
        a_side, b_side = _cross(q - p, wall.a_m - p), _cross(q - p, wall.b_m - p)
        cut[opposite] = np.sign(a_side) * np.sign(b_side) <= 0
    return cut


def _side(wall: WallSettings, places_m: Floats) -> Floats:
    """Return the side of a wall's line for each position, by sign."""
    (ax, ay), (bx, by) = wall.a_m, wall.b_m
    side: Floats = (bx - ax) * (places_m[:, 1] - ay) - (by - ay) * (places_m[:, 0] - ax)
    return side


def _cross(u: Floats, v: Floats) -> Floats:
    crossed: Floats = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return crossed


class Jammers:
    """Circles without reception, edge included. Agents inside can be heard outside."""

    reason = "jam"
    meaning = "the receiver is within a jammer's circle"
    holds_for_step = True

    def __init__(self, zones: Sequence[JammerSettings]) -> None:
        self._zones = zones
        self._ways = [
            ((zone.from_s, *zone.times_s), [(x, y) for x, y in (zone.center_m, *zone.waypoints_m)]) for zone in zones
        ]

    @classmethod
    def of(cls, context: Context) -> Self | None:
        zones = context.scenario.radio.jammers
        return cls(zones) if zones else None

    def center_m(self, index: int, time_s: float) -> tuple[float, float]:
        """Return a jammer's position [m]: its start before the first time, its end after the last."""
        times_s, places_m = self._ways[index]
        after = bisect_right(times_s, time_s)
        if after in (0, len(times_s)):
            return places_m[max(0, after - 1)]
        (x, y), (to_x, to_y) = places_m[after - 1], places_m[after]
        share = (time_s - times_s[after - 1]) / (times_s[after] - times_s[after - 1])
        return x + share * (to_x - x), y + share * (to_y - y)

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        deaf: Mask | None = None
        for index, zone in enumerate(self._zones):
            if is_on(zone, time_s):
                x_m, y_m = self.center_m(index, time_s)
                dx, dy = links.listeners_m[:, 0] - x_m, links.listeners_m[:, 1] - y_m
                within: Mask = dx * dx + dy * dy <= zone.radius_m**2
                deaf = within if deaf is None else deaf | within
        return None if deaf is None else deaf[links.rows]

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        nearest_m = np.inf
        for index, zone in enumerate(self._zones):
            if not is_on(zone, time_s):
                continue
            center_m = self.center_m(index, time_s)
            dx, dy = (links.to_m[0] - center_m).tolist()
            distance_m = math.hypot(dx, dy)
            if dx * dx + dy * dy <= zone.radius_m**2:
                says = (
                    f"the receiver is {distance_m:.2f} m from the centre {_at(center_m)} of jammer {index}, radius "
                    f"{zone.radius_m:g} m, {_when(zone)}"
                )
                numbers = {"jammer": index, "center_m": list(center_m), "radius_m": zone.radius_m}
                return Diagnosis(self.reason, True, says, {**numbers, "from_center_m": distance_m})
            nearest_m = min(nearest_m, distance_m - zone.radius_m)
        if nearest_m == np.inf:
            return Diagnosis(self.reason, False, "no jammer is on now", {})
        return Diagnosis(self.reason, False, f"{nearest_m:.2f} m outside the nearest jammer", {"outside_m": nearest_m})


def _at(place_m: Sequence[float] | Floats) -> str:
    return f"({place_m[0]:g}, {place_m[1]:g})"


class RadioObstacles:
    """A frame whose line of sight crosses obstacles loses the sum of their attenuations.

    An obstacle without an attenuation blocks. By power (log-distance), a frame is lost if less arrives than is
    needed. By a disc, a loss of L dB shortens the range by the factor 10^(-L / (10 exponent)): what the same
    loss does to the range under log-distance path loss with `path_loss.exponent`.
    """

    reason = "obstacle"
    meaning = "an obstacle blocks it or takes too much power"
    holds_for_step = True

    def __init__(self, obstacles: Obstacles, reach: Reach, exponent: float) -> None:
        self._obstacles = obstacles
        self._reach = reach
        self._exponent = exponent

    @classmethod
    def of(cls, context: Context) -> Self | None:
        obstacles = Obstacles(context.scenario.arena.obstacles)
        return cls(obstacles, context.reach, context.scenario.radio.path_loss.exponent) if obstacles else None

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        losses_db = self._losses_db(links)
        lossy = losses_db > 0
        if not lossy.any():
            return None
        factors: Floats = 10.0 ** (-losses_db / (10.0 * self._exponent))
        cut: Mask = lossy & (np.isinf(losses_db) | (self._reach.shares(links) > factors))
        return cut

    def _losses_db(self, links: Links) -> Floats:
        """Return losses, computed from the end with the lower number so that both directions round equally."""
        swapped = (links.senders > links.receivers)[:, None]
        from_m, to_m = np.where(swapped, links.to_m, links.from_m), np.where(swapped, links.from_m, links.to_m)
        return self._obstacles.attenuations_db(from_m, to_m)

    def explain(self, links: Links, time_s: float) -> Diagnosis:
        crossed = self._obstacles.crossed(links.from_m, links.to_m)
        if not crossed:
            return Diagnosis(self.reason, False, "no obstacle between them", {})
        loss_db = float(self._losses_db(links)[0])
        cuts = self.cuts(links, time_s)
        which = f"obstacle{'s' if len(crossed) > 1 else ''} {', '.join(map(str, crossed))}"
        if np.isinf(loss_db):
            return Diagnosis(self.reason, True, f"{which} in between, blocking", {"obstacles": crossed})
        says = f"{which} in between, {loss_db:g} dB"
        is_cut = cuts is not None and bool(cuts[0])
        return Diagnosis(self.reason, is_cut, says, {"obstacles": crossed, "attenuation_db": loss_db})
