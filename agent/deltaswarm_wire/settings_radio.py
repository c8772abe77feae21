"""The air between the agents: range, path loss, loss, bursts, delay, bandwidth, contention, jamming, walls.

Each piece is off by default, and costs nothing then; together they are `[radio]` of a scenario. What
becomes of a frame that meets several of them is told in the world's `air/radio.py`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from deltaswarm_wire.checked import Problem, key, plain_value

DISC, LOG_DISTANCE = "disc", "log-distance"
RECEPTIONS = (DISC, LOG_DISTANCE)

OURS = "our reading"

LEAST_FRAME_BYTES = 5
"""No radio frame is shorter: the frame of an agent that relocates, with the smallest numbers."""

MAX_TIME_S = 1e9

Place = tuple[float, ...]


@dataclass(frozen=True)
class PathLossSettings:
    """Log-distance path loss with log-normal shadowing.

    Received power [dBm] = tx_power_dbm - reference_loss_db - 10 exponent log10(d / 1 m) + shadowing.
    """

    tx_power_dbm: float = key(0.0, "transmit power [dBm]", low=-100, high=100)
    exponent: float = key(3.0, "path-loss exponent: 2 in free space, 3 to 4 on the ground", low=1, high=10)
    reference_loss_db: float = key(40.0, "loss at 1 m [dB]; 40 is that of free space at 2.4 GHz", low=0, high=200)
    sensitivity_dbm: float = key(
        -69.0, "a frame received at less is not heard [dBm]; -69 is 9.3 m without shadowing", low=-200, high=100
    )
    shadowing_db: float = key(
        4.0, "standard deviation of the shadowing of a link [dB], cut at 4 of them", low=0, high=40
    )
    shadowing_symmetric: bool = key(True, "whether a link is shadowed alike in both directions")
    decorrelation_m: float = key(
        0.0, "a link's shadowing is drawn anew for each square of this side that its ends are in [m]; 0: never", low=0
    )

    def problems(self) -> list[Problem]:
        """Somebody must be heard somewhere."""
        at_1_m = self.tx_power_dbm - self.reference_loss_db
        if self.sensitivity_dbm > at_1_m:
            allowed = f"at most the power received at 1 m ({at_1_m:g} dBm) is allowed"
            return [Problem("sensitivity_dbm", f"{self.sensitivity_dbm:g}", allowed)]
        return []


@dataclass(frozen=True)
class BurstSettings:
    """Gilbert and Elliott's two-state loss, per directed link, with a change of state at most once a step."""

    p_good_to_bad: float = key(0.0, "chance per step that a good link turns bad", low=0, high=1)
    p_bad_to_good: float = key(0.1, "chance per step that a bad link turns good", low=0, high=1)
    loss_good: float = key(0.0, "share of frames lost while the link is good", low=0, high=1)
    loss_bad: float = key(1.0, "share of frames lost while the link is bad", low=0, high=1)

    @property
    def is_on(self) -> bool:
        """Whether it can lose anything."""
        return self.loss_good > 0 or (self.p_good_to_bad > 0 and self.loss_bad > 0)

    def problems(self) -> list[Problem]:
        """A link that stays bad for ever is a dead one, which asymmetry has."""
        if self.p_good_to_bad > 0 and self.p_bad_to_good == 0:
            return [Problem("p_bad_to_good", "0", "above 0 is allowed where p_good_to_bad is above 0")]
        return []


@dataclass(frozen=True)
class BandwidthSettings:
    """What a radio can send and take in. What does not pass in a step waits, first come, first served."""

    sender_bytes_per_s: float = key(0.0, "what an agent's radio can send; 0: unlimited", low=0, high=1e9)
    receiver_bytes_per_s: float = key(0.0, "what an agent's radio can take in; 0: unlimited", low=0, high=1e9)
    queue_bytes: int = key(
        2000, "so much may wait from one step to the next at each end; the rest is dropped", low=0, high=10**9
    )


@dataclass(frozen=True)
class AsymmetrySettings:
    """Directed links that are worse than the others, the same ones for a whole run."""

    dead_share: float = key(0.0, "share of directed links that carry nothing", low=0, high=1)
    range_factor_low: float = key(
        1.0, "each directed link has its range times a factor, uniform from this to 1", low=0, high=1
    )


@dataclass(frozen=True)
class RangeSettings:
    """Some agents' own range."""

    agents: tuple[int, ...] = key((), "numbers of the agents", low=0, high=65_535)
    range_m: float = key(9.0, "their frames are heard up to here [m]", above=0, high=1e6)


@dataclass(frozen=True)
class BlackoutSettings:
    """A time in which nobody hears anybody."""

    from_s: float = key(0.0, "start time [s]", low=0, high=MAX_TIME_S)
    until_s: float | None = key(None, "end time [s]; default: never", low=0, high=MAX_TIME_S)

    def problems(self) -> list[Problem]:
        """Times must be in order."""
        return reversed_times(self.from_s, self.until_s)


@dataclass(frozen=True)
class WallSettings:
    """A partition: no frame crosses the line between two points."""

    a_m: Place = key((0.0, 0.0), "one end [m]", length=2)
    b_m: Place = key((0.0, 0.0), "the other end [m]", length=2)
    from_s: float = key(0.0, "start time [s]", low=0, high=MAX_TIME_S)
    until_s: float | None = key(None, "end time [s]; default: never", low=0, high=MAX_TIME_S)

    def problems(self) -> list[Problem]:
        """It must have a length, and times in order."""
        found = reversed_times(self.from_s, self.until_s)
        if self.a_m == self.b_m:
            found.append(Problem("b_m", _shown(self.b_m), "another point than a_m is allowed: a wall has a length"))
        return found


@dataclass(frozen=True)
class JammerSettings:
    """A circle in which nothing is heard. It stands, or goes from its centre along waypoints."""

    center_m: Place = key((0.0, 0.0), "centre at the start [m]", length=2)
    radius_m: float = key(10.0, "agents within it hear nothing [m]", above=0, high=1e6)
    from_s: float = key(0.0, "start time [s]", low=0, high=MAX_TIME_S)
    until_s: float | None = key(None, "end time [s]; default: never", low=0, high=MAX_TIME_S)
    waypoints_m: tuple[Place, ...] = key((), "places that its centre goes to in straight lines [m]", length=None)
    times_s: tuple[float, ...] = key((), "when it is at each waypoint [s]", low=0, high=MAX_TIME_S)

    def problems(self) -> list[Problem]:
        """Times must be in order, one for each waypoint."""
        found = reversed_times(self.from_s, self.until_s)
        found += [
            Problem(f"waypoints_m[{index}]", _shown(place), "two coordinates are allowed")
            for index, place in enumerate(self.waypoints_m)
            if len(place) != 2
        ]
        if len(self.times_s) != len(self.waypoints_m):
            counts = f"{len(self.times_s)} for {len(self.waypoints_m)} waypoints"
            found.append(Problem("times_s", counts, "one time for each waypoint is allowed"))
        if any(later <= earlier for earlier, later in pairwise((self.from_s, *self.times_s))):
            found.append(Problem("times_s", _shown(self.times_s), "ascending times after from_s are allowed"))
        return found


@dataclass(frozen=True)
class RadioSettings:
    """The air between the agents, emulated by the world."""

    range_m: float = key(9.0, "a frame is heard up to here [m]", source=OURS, above=0)
    loss: float = key(0.0, "share of frames in range that are lost", low=0, high=1)
    reception: str = key(DISC, "what range means: a disc, or what path_loss says", choices=RECEPTIONS)
    path_loss: PathLossSettings = key(PathLossSettings, "reception by power, where reception asks for it")
    ranges: tuple[RangeSettings, ...] = key((), "ranges of single agents, as tables of agents and range_m")
    asymmetry: AsymmetrySettings = key(AsymmetrySettings, "links that are worse in one direction")
    burst: BurstSettings = key(BurstSettings, "loss in bursts")
    latency_s: float = key(
        0.0,
        "least delay on top of the one step that each hop takes; part of a step is rounded up or down by chance, "
        "which keeps the mean [s]",
        low=0,
        high=3600,
    )
    jitter_s: float = key(
        0.0, "more delay, uniform from 0 to this, rounded together with latency_s [s]", low=0, high=3600
    )
    duplication: float = key(0.0, "share of received frames that arrive twice", low=0, high=1)
    bandwidth: BandwidthSettings = key(BandwidthSettings, "what radios can send and take in")
    contention_bytes_per_s: float = key(
        0.0, "a receiver in reach of more loses frames at random, down to this; 0: unlimited", low=0, high=1e9
    )
    walls: tuple[WallSettings, ...] = key((), "partitions, as tables of a_m, b_m, from_s, until_s")
    jammers: tuple[JammerSettings, ...] = key(
        (), "jamming, as tables of center_m, radius_m, from_s, until_s, waypoints_m, times_s"
    )
    blackouts: tuple[BlackoutSettings, ...] = key(
        (), "times in which nobody hears anything, as tables of from_s, until_s"
    )

    @property
    def is_late(self) -> bool:
        """Whether a frame can be under way for more than the one step of each hop."""
        rates = (self.bandwidth.sender_bytes_per_s, self.bandwidth.receiver_bytes_per_s)
        return max(self.latency_s, self.jitter_s, *rates) > 0


def radio_problems(radio: RadioSettings, size_m: tuple[float, float], agents: int, step_s: float) -> list[Problem]:
    """What `[radio]` alone cannot show: agents that are not there, places outside, no byte to spare."""
    found = _range_problems(radio.ranges, agents)
    allowed = f"a place in reach of the arena, {size_m[0]:g} m x {size_m[1]:g} m, is allowed"
    for index, wall in enumerate(radio.walls):
        if _gap_m(wall.a_m, wall.b_m, size_m) > 0:
            found.append(Problem(f"radio.walls[{index}]", f"{_shown(wall.a_m)} to {_shown(wall.b_m)}", allowed))
    for index, jammer in enumerate(radio.jammers):
        way = (jammer.center_m, *jammer.waypoints_m)
        legs = list(pairwise(way)) or [(way[0], way[0])]
        if min(_gap_m(a, b, size_m) for a, b in legs) > jammer.radius_m:
            circle = f"{_shown(jammer.center_m)}, {jammer.radius_m:g} m"
            found.append(Problem(f"radio.jammers[{index}]", f"{circle} is wholly outside", allowed))
    for name in ("sender_bytes_per_s", "receiver_bytes_per_s"):
        rate = getattr(radio.bandwidth, name)
        if 0 < rate * step_s < LEAST_FRAME_BYTES and radio.bandwidth.queue_bytes < LEAST_FRAME_BYTES:
            needed = f"0, or at least {LEAST_FRAME_BYTES} bytes in a step or in the queue"
            found.append(Problem(f"radio.bandwidth.{name}", f"{rate:g}", f"{needed}, is allowed: no frame is smaller"))
    return found


def _range_problems(ranges: Sequence[RangeSettings], agents: int) -> list[Problem]:
    found = []
    known: set[int] = set()
    for index, own in enumerate(ranges):
        path = f"radio.ranges[{index}].agents"
        if not own.agents:
            found.append(Problem(path, "none", "at least one agent is expected"))
        for agent in own.agents:
            if agent >= agents:
                found.append(Problem(path, f"there is no agent {agent}", f"0 to {agents - 1} is allowed"))
            elif agent in known:
                found.append(Problem(path, f"agent {agent} again", "one range for each agent is allowed"))
            known.add(agent)
    return found


def reversed_times(from_s: float, until_s: float | None) -> list[Problem]:
    """What is over before it begins is a mistake."""
    if until_s is None or until_s > from_s:
        return []
    return [Problem("until_s", f"{until_s:g}", f"above from_s ({from_s:g}) is allowed")]


def _gap_m(a_m: Place, b_m: Place, size_m: tuple[float, float]) -> float:
    """Least distance of a segment from the rectangle between (0, 0) and `size_m` [m]."""

    def gap_m(share: float) -> float:
        place = [a + share * (b - a) for a, b in zip(a_m, b_m, strict=True)]
        return math.hypot(*(max(0.0, -x, x - limit) for x, limit in zip(place, size_m, strict=True)))

    low, high = 0.0, 1.0  # the distance from a convex shape has one valley along a line
    for _ in range(100):
        third = (high - low) / 3
        if gap_m(low + third) <= gap_m(high - third):
            high -= third
        else:
            low += third
    least = min(gap_m(0.0), gap_m(1.0), gap_m((low + high) / 2))
    return 0.0 if least < 1e-9 * max(size_m) else least


def _shown(value: object) -> str:
    text = str(plain_value(value))
    return text if len(text) <= 60 else f"{text[:57]}..."
