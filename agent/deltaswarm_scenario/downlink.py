"""The operator's downlink, and the commands of a scripted operator.

Commands leave the operator's base as radio frames, which are repeated during a command's life. Each limit is off by
default; without any of them every agent hears the base.
"""

from dataclasses import dataclass
from typing import Any

from deltaswarm_scenario.radio import BlackoutSettings, Place
from deltaswarm_wire.checked import Problem, key
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.commands import MAX_LIFE_S, TARGET_NUMBERS, Command, Target, encode_command, make_target

FIRST_STEP = 2
"""The first step in which a command can leave the base: the world begins this step once it has the turn of step 0."""


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


def downlink_problems(downlink: DownlinkSettings, uplink_base: Place | None) -> list[Problem]:
    """A range needs a base."""
    if downlink.range_m is not None and (downlink.base_m or uplink_base) is None:
        must = "must have a base: downlink.base_m or uplink.base_m"
        return [Problem("downlink.range_m", f"{downlink.range_m:.15g}", must)]
    return []
