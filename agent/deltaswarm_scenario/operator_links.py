"""The operator's radio links: the uplink from the agents, the downlink to them, and a scripted operator's commands.

Each effect is off by default. Without any, reports go directly to the operator, and every agent hears the base. The
world's `uplink/uplink.py` and `downlink.py` say in which order the effects apply.
"""

from dataclasses import dataclass
from typing import Any

from deltaswarm_scenario.radio import BandwidthSettings, BlackoutSettings, BurstSettings, Place, rate_problems
from deltaswarm_wire.checked import Problem, key, plain_value
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.commands import MAX_LIFE_S, TARGET_NUMBERS, Command, Target, encode_command, make_target

FIRST_STEP = 2
"""The first step in which a command can leave the base: the world begins this step once it has the turn of step 0."""

LEAST_REPORT_BYTES = 82
"""Size of the smallest report: of a root without events, with the smallest numbers."""


@dataclass(frozen=True)
class UplinkBandwidthSettings(BandwidthSettings):
    """Data rates of agents and base. Excess bytes wait in first-in, first-out queues."""

    sender_bytes_per_s: float = key(0.0, "rate of an agent's reports; 0: unlimited", low=0, high=1e9)
    receiver_bytes_per_s: float = key(0.0, "rate of the operator's receiver; 0: unlimited", low=0, high=1e9)


@dataclass(frozen=True)
class UplinkSettings:
    """The radio link to the operator, emulated by the world."""

    loss: float = key(0.0, "share of reports that are lost, also on each hop of a relay", low=0, high=1)
    burst: BurstSettings = key(BurstSettings, "loss in bursts on each agent's link to the base")
    latency_s: float = key(
        0.0,
        "minimum delay (0: within the step), rounded at random to whole steps with the same mean [s]",
        low=0,
        high=3600,
    )
    jitter_s: float = key(
        0.0, "maximum of an additional uniform delay, rounded together with latency_s [s]", low=0, high=3600
    )
    bandwidth: UplinkBandwidthSettings = key(UplinkBandwidthSettings, "data rates of agents and base")
    outages: tuple[BlackoutSettings, ...] = key((), "periods without any report, as tables of from_s, until_s")
    base_m: Place | None = key(None, "position of the operator's base [m]; default: in range of every agent", length=2)
    range_m: float | None = key(None, "range of the base [m]; required with base_m", above=0, high=1e6)
    relay: bool = key(
        False, "relay reports from beyond the range through the sender's tree, one hop per step; else they are lost"
    )

    @property
    def is_on(self) -> bool:
        """Whether any effect is on; if not, the world does not handle reports."""
        rates = (self.bandwidth.sender_bytes_per_s, self.bandwidth.receiver_bytes_per_s)
        numbers = (self.loss, self.latency_s, self.jitter_s, *rates)
        return max(numbers) > 0 or self.burst.is_on or bool(self.outages) or self.base_m is not None

    def problems(self) -> list[Problem]:
        """A base needs a range; range and relay need a base."""
        problems = []
        if self.base_m is not None and self.range_m is None:
            problems.append(Problem("range_m", "nothing", "must be given with base_m"))
        if self.base_m is None and self.range_m is not None:
            problems.append(Problem("range_m", f"{self.range_m:.15g}", "must be left out without base_m"))
        if self.base_m is None and self.relay:
            problems.append(Problem("relay", "true", "must be false without base_m and range_m"))
        return problems


def uplink_problems(uplink: UplinkSettings, size_m: Place, step_s: float) -> list[Problem]:
    """Check `[uplink]` against the scenario: a base outside the arena, rates too small."""
    problems = _place_problems("uplink.base_m", uplink.base_m, size_m)
    return problems + rate_problems("uplink", uplink.bandwidth, step_s, LEAST_REPORT_BYTES, "the smallest report")


def _place_problems(path: str, at_m: Place | None, size_m: Place) -> list[Problem]:
    if at_m is None or all(0 <= x <= end for x, end in zip(at_m, size_m, strict=True)):
        return []
    allowed = f"must be within the arena, {size_m[0]:.15g} m x {size_m[1]:.15g} m"
    return [Problem(path, str(plain_value(at_m)), allowed)]


@dataclass(frozen=True)
class DownlinkSettings:
    """The radio link from the operator's base to the agents, emulated by the world."""

    base_m: Place | None = key(None, "position of the base [m]; default: uplink.base_m", length=2)
    range_m: float | None = key(None, "range of the base [m]; default: unlimited", above=0, high=1e6)
    loss: float = key(0.0, "share of the base's frames that an agent loses", low=0, high=1)
    latency_s: float = key(0.0, "minimum delay of a frame [s]", low=0, high=3600)
    jitter_s: float = key(0.0, "maximum of an additional uniform delay [s]", low=0, high=3600)
    outages: tuple[BlackoutSettings, ...] = key(
        (), "periods in which no agent hears the base, as tables of from_s, until_s"
    )
    repeat_s: float = key(5.0, "interval at which the base repeats unexpired commands [s]", above=0, high=3600)


@dataclass(frozen=True)
class CommandSettings:
    """One command of a scripted operator."""

    at_s: float = key(0.0, "time at which it leaves the base [s], not before the third step", low=0, high=1e8)
    name: str = key("", "a command that the controller accepts; `deltaswarm list` shows them")
    target: str = key("all", "recipients", choices=tuple(TARGET_NUMBERS))
    numbers: tuple[float, ...] = key(
        (), "circle: x, y and radius [m]; tree: its root; agent: its number; place: x and y [m]"
    )
    arguments: dict[str, Any] = key(dict, "its arguments, by name")
    life_s: float = key(
        120.0, "time for which agents relay it and may start carrying it out [s]", above=0, high=MAX_LIFE_S
    )

    def command(self, number: int) -> Command:
        """The command that is sent."""
        return Command(number, self.name, Target(self.target, self.numbers), dict(self.arguments), self.life_s)

    def problems(self) -> list[Problem]:
        """A target has its numbers, and all of it fits on the wire."""
        try:
            make_target([self.target, *self.numbers])
            encode_command(self.command(0))
        except WireError as error:
            return [Problem("target", repr(self.target), f"must fit: {error}")]
        return []


def downlink_problems(downlink: DownlinkSettings, uplink_base: Place | None, size_m: Place) -> list[Problem]:
    """A range needs a base, which is within the arena."""
    if downlink.range_m is not None and (downlink.base_m or uplink_base) is None:
        must = "must have a base: downlink.base_m or uplink.base_m"
        return [Problem("downlink.range_m", f"{downlink.range_m:.15g}", must)]
    return _place_problems("downlink.base_m", downlink.base_m, size_m)
