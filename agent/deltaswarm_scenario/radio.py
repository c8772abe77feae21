"""Radio between agents: range, path loss, loss, bursts, delay, bandwidth, contention, jamming, walls.

Each effect is off by default and then costs nothing; together they are `[radio]` of a scenario. The world's
`air/radio.py` says in which order they apply.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from deltaswarm_wire.checked import Problem, SettingsError, key, plain_value
from deltaswarm_wire.obstacles import coordinate_problems
from deltaswarm_wire.plugins import RADIO_MODELS, find, is_recorded, own_settings

DISC, LOG_DISTANCE = "disc", "log-distance"
RECEPTIONS = (DISC, LOG_DISTANCE)

OURS = "our reading"

LEAST_FRAME_BYTES = 5
"""Size of the smallest radio frame: of an agent that relocates, with the smallest numbers."""

MAX_TIME_S = 1e9

REASON = re.compile("[a-z][a-z0-9_]*")
"""What the reason of a radio model must match: it names a column of the tables."""

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
        -69.0, "least received power of a frame [dBm]; -69 means 9.3 m without shadowing", low=-200, high=100
    )
    shadowing_db: float = key(
        4.0, "standard deviation of a link's shadowing [dB], cut at 4 standard deviations", low=0, high=40
    )
    shadowing_symmetric: bool = key(True, "whether both directions of a link have the same shadowing")
    decorrelation_m: float = key(
        0.0, "side of the grid squares in which a link keeps its shadowing [m]; 0: constant", low=0
    )

    def problems(self) -> list[Problem]:
        """A frame must be receivable at 1 m."""
        at_1_m = self.tx_power_dbm - self.reference_loss_db
        if self.sensitivity_dbm > at_1_m:
            allowed = f"must be at most the power received at 1 m, {at_1_m:.15g} dBm"
            return [Problem("sensitivity_dbm", f"{self.sensitivity_dbm:.15g}", allowed)]
        return []


@dataclass(frozen=True)
class BurstSettings:
    """Gilbert-Elliott two-state loss per directed link, with at most one state change a step."""

    p_good_to_bad: float = key(0.0, "probability per step that a good link turns bad", low=0, high=1)
    p_bad_to_good: float = key(0.1, "probability per step that a bad link turns good", low=0, high=1)
    loss_good: float = key(0.0, "share of frames lost while the link is good", low=0, high=1)
    loss_bad: float = key(1.0, "share of frames lost while the link is bad", low=0, high=1)

    @property
    def is_on(self) -> bool:
        """Whether frames can be lost."""
        return self.loss_good > 0 or (self.p_good_to_bad > 0 and self.loss_bad > 0)

    def problems(self) -> list[Problem]:
        """A link must be able to recover; `asymmetry` has dead links."""
        if self.p_good_to_bad > 0 and self.p_bad_to_good == 0:
            return [Problem("p_bad_to_good", "0", "must be above 0 if p_good_to_bad is")]
        return []


@dataclass(frozen=True)
class BandwidthSettings:
    """Data rates of a radio. Excess bytes of a step wait in a first-in, first-out queue."""

    sender_bytes_per_s: float = key(0.0, "rate of an agent's sender; 0: unlimited", low=0, high=1e9)
    receiver_bytes_per_s: float = key(0.0, "rate of an agent's receiver; 0: unlimited", low=0, high=1e9)
    queue_bytes: int = key(2000, "capacity of the queue at each end; the rest is dropped", low=0, high=10**9)


@dataclass(frozen=True)
class AsymmetrySettings:
    """Directed links that are worse than others for the whole run."""

    dead_share: float = key(0.0, "share of directed links that carry nothing", low=0, high=1)
    range_factor_low: float = key(
        1.0, "lower end of the uniform range factor of each directed link; the upper end is 1", low=0, high=1
    )


@dataclass(frozen=True)
class RangeSettings:
    """A range for some agents."""

    agents: tuple[int, ...] = key((), "numbers of the agents", low=0, high=65_535)
    range_m: float = key(9.0, "range of their frames [m]", above=0, high=1e6)


@dataclass(frozen=True)
class BlackoutSettings:
    """A period without any reception."""

    from_s: float = key(0.0, "start time [s]", low=0, high=MAX_TIME_S)
    until_s: float | None = key(None, "end time [s]; default: never", low=0, high=MAX_TIME_S)

    def problems(self) -> list[Problem]:
        """Times must be in order."""
        return reversed_times(self.from_s, self.until_s)


@dataclass(frozen=True)
class WallSettings:
    """A partition: no frame crosses the line between two points."""

    a_m: Place = key((0.0, 0.0), "one end of the wall [m]", length=2)
    b_m: Place = key((0.0, 0.0), "the other end [m]", length=2)
    from_s: float = key(0.0, "start time [s]", low=0, high=MAX_TIME_S)
    until_s: float | None = key(None, "end time [s]; default: never", low=0, high=MAX_TIME_S)

    def problems(self) -> list[Problem]:
        """A wall must have a length, and times in order."""
        problems = reversed_times(self.from_s, self.until_s)
        if self.a_m == self.b_m:
            problems.append(Problem("b_m", _shown(self.b_m), "must differ from a_m"))
        return problems


@dataclass(frozen=True)
class JammerSettings:
    """A circle without reception. It stands, or moves from its centre along waypoints."""

    center_m: Place = key((0.0, 0.0), "centre at the start [m]", length=2)
    radius_m: float = key(10.0, "radius of the circle [m]", above=0, high=1e6)
    from_s: float = key(0.0, "start time [s]", low=0, high=MAX_TIME_S)
    until_s: float | None = key(None, "end time [s]; default: never", low=0, high=MAX_TIME_S)
    waypoints_m: tuple[Place, ...] = key((), "next positions of its centre, joined by straight lines [m]", length=None)
    times_s: tuple[float, ...] = key((), "arrival time at each waypoint [s]", low=0, high=MAX_TIME_S)

    def problems(self) -> list[Problem]:
        """Times must be in order, one for each waypoint."""
        problems = reversed_times(self.from_s, self.until_s)
        problems += coordinate_problems("waypoints_m", self.waypoints_m)
        if len(self.times_s) != len(self.waypoints_m):
            counts = f"{len(self.times_s)} for {len(self.waypoints_m)} waypoints"
            problems.append(Problem("times_s", counts, "must have one time per waypoint"))
        if any(later <= earlier for earlier, later in pairwise((self.from_s, *self.times_s))):
            problems.append(Problem("times_s", _shown(self.times_s), "must ascend from from_s"))
        return problems


@dataclass(frozen=True)
class RadioSettings:
    """Radio between agents, emulated by the world."""

    range_m: float = key(9.0, "range of a frame [m]", source=OURS, above=0)
    loss: float = key(0.0, "share of frames in range that are lost", low=0, high=1)
    reception: str = key(DISC, "model of reach: by distance, or by received power (path_loss)", choices=RECEPTIONS)
    path_loss: PathLossSettings = key(PathLossSettings, "reception by power, with reception log-distance")
    ranges: tuple[RangeSettings, ...] = key((), "ranges of single agents, as tables of agents and range_m")
    asymmetry: AsymmetrySettings = key(AsymmetrySettings, "links that are worse in one direction")
    burst: BurstSettings = key(BurstSettings, "loss in bursts")
    latency_s: float = key(
        0.0,
        "minimum delay beyond one step per hop, rounded at random to whole steps with the same mean [s]",
        low=0,
        high=3600,
    )
    jitter_s: float = key(
        0.0, "maximum of an additional uniform delay, rounded together with latency_s [s]", low=0, high=3600
    )
    duplication: float = key(0.0, "share of received frames that arrive twice", low=0, high=1)
    bandwidth: BandwidthSettings = key(BandwidthSettings, "data rates of radios")
    contention_bytes_per_s: float = key(
        0.0, "rate above which a receiver loses frames at random [bytes/s]; 0: unlimited", low=0, high=1e9
    )
    walls: tuple[WallSettings, ...] = key((), "partitions, as tables of a_m, b_m, from_s, until_s")
    jammers: tuple[JammerSettings, ...] = key(
        (), "circles without reception, as tables of center_m, radius_m, from_s, until_s, waypoints_m, times_s"
    )
    blackouts: tuple[BlackoutSettings, ...] = key((), "periods without any reception, as tables of from_s, until_s")

    models: dict[str, Any] = key(dict, "models from outside: a table of options for each entry point or module:Class")

    def problems(self) -> list[Problem]:
        """Models from outside must be found and must accept their options."""
        problems = []
        for name, options in self.models.items():
            path = f'models."{name}"'
            try:
                own_settings(RADIO_MODELS, name, options, path)
                model = find(RADIO_MODELS, name, path)
            except SettingsError as error:
                problems += error.problems
                continue
            if is_recorded(model):
                continue
            if name in RADIO_MODELS.shipped and not hasattr(model, "Settings"):
                problems.append(Problem(path, repr(name), "must be set by the model's own keys in [radio]"))
            if not REASON.fullmatch(str(model.reason)):
                must = "must have a reason of lower-case letters, digits and underscores"
                problems.append(Problem(path, repr(model.reason), must))
        return problems

    @property
    def is_late(self) -> bool:
        """Whether a frame can take more than one step per hop."""
        rates = (self.bandwidth.sender_bytes_per_s, self.bandwidth.receiver_bytes_per_s)
        return max(self.latency_s, self.jitter_s, *rates) > 0


def radio_problems(radio: RadioSettings, size_m: tuple[float, float], agents: int, step_s: float) -> list[Problem]:
    """Check `[radio]` against the scenario: unknown agents, positions outside the arena, rates too small."""
    problems = _range_problems(radio.ranges, agents)
    allowed = f"must reach into the arena, {size_m[0]:.15g} m x {size_m[1]:.15g} m"
    for index, wall in enumerate(radio.walls):
        if _gap_m(wall.a_m, wall.b_m, size_m) > 0:
            problems.append(Problem(f"radio.walls[{index}]", f"{_shown(wall.a_m)} to {_shown(wall.b_m)}", allowed))
    for index, jammer in enumerate(radio.jammers):
        way = (jammer.center_m, *jammer.waypoints_m)
        legs = list(pairwise(way)) or [(way[0], way[0])]
        if min(_gap_m(a, b, size_m) for a, b in legs) > jammer.radius_m:
            circle = f"{_shown(jammer.center_m)}, {jammer.radius_m:.15g} m"
            problems.append(Problem(f"radio.jammers[{index}]", circle, allowed))
    return problems + rate_problems("radio", radio.bandwidth, step_s, LEAST_FRAME_BYTES, "the smallest frame")


def rate_problems(
    table: str, bandwidth: BandwidthSettings, step_s: float, least_bytes: int, what: str
) -> list[Problem]:
    """Check that the rates let the smallest message through, in a step or by the queue."""
    needed = f"must be 0 or allow at least {least_bytes} bytes in a step or in the queue, {what}"
    rates = {name: getattr(bandwidth, name) for name in ("sender_bytes_per_s", "receiver_bytes_per_s")}
    return [
        Problem(f"{table}.bandwidth.{name}", f"{rate:.15g}", needed)
        for name, rate in rates.items()
        if 0 < rate * step_s < least_bytes and bandwidth.queue_bytes < least_bytes
    ]


def _range_problems(ranges: Sequence[RangeSettings], agents: int) -> list[Problem]:
    problems = []
    known: set[int] = set()
    for index, entry in enumerate(ranges):
        path = f"radio.ranges[{index}].agents"
        if not entry.agents:
            problems.append(Problem(path, "none", "must name at least one agent"))
        for agent in entry.agents:
            if agent >= agents:
                problems.append(Problem(path, f"{agent}", f"must be from 0 to {agents - 1}"))
            elif agent in known:
                problems.append(Problem(path, f"{agent} again", "must name each agent once"))
            known.add(agent)
    return problems


def reversed_times(from_s: float, until_s: float | None) -> list[Problem]:
    """The end must be after the start."""
    if until_s is None or until_s > from_s:
        return []
    return [Problem("until_s", f"{until_s:.15g}", f"must be above from_s, {from_s:.15g} s")]


def _gap_m(a_m: Place, b_m: Place, size_m: tuple[float, float]) -> float:
    """Smallest distance from a segment to the rectangle from (0, 0) to `size_m` [m]."""

    def gap_m(share: float) -> float:
        place = [a + share * (b - a) for a, b in zip(a_m, b_m, strict=True)]
        return math.hypot(*(max(0.0, -x, x - limit) for x, limit in zip(place, size_m, strict=True)))

    low, high = 0.0, 1.0  # the distance to a convex shape has one minimum along a line
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
