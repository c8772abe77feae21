"""The body: an agent's interface to its robot, a plug-in on a board. In a simulation the world's frame replaces it.

A plug-in is a class, named in the board's file by an entry point of the group `deltaswarm.bodies` or as
`module:Class`. It declares its options (`Settings`) and whether it only runs in real time (`REAL_TIME`). Positions are
in m in the arena's frame, with (0, 0) at a corner.
"""

from dataclasses import dataclass
from random import Random
from typing import Any, ClassVar, NamedTuple, Protocol

from deltaswarm_wire.messages import Event
from deltaswarm_wire.settings import AgentSettings


class Sensed(NamedTuple):
    """A body's state at one time.

    `std_m` is the standard deviation of the position along each axis [m]. `fault` is "" while the body is well. With a
    fault, a short description, the agent ignores the rest, stands, and sends nothing.
    """

    x_m: float
    y_m: float
    std_m: float
    events: tuple[Event, ...] = ()
    fault: str = ""


NOWHERE = Sensed(0.0, 0.0, float("inf"), fault="no position yet")
"""The state before the first position."""


@dataclass(frozen=True)
class BodyContext:
    """The arguments of a new body: its agent's number and settings, and its own generator."""

    agent: int
    settings: AgentSettings
    rng: Random


class Body(Protocol):
    """One robot for one agent. All calls come from one thread; each must be faster than a step.

    A call that raises or returns an invalid value is a fault of that step. After ten such consecutive steps the agent
    fails.
    """

    Settings: ClassVar[type[Any]]
    """The options in the board's file: a frozen dataclass with fields made by `deltaswarm_wire.checked.key`."""

    REAL_TIME: ClassVar[bool]
    """Whether this body runs only in real time."""

    def sense(self, time_s: float) -> Sensed:
        """Return the robot's position and sensed events at `time_s` [s since the agent's start; never decreasing]."""

    def move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> None:
        """Move at this velocity [m/s; arena frame] and observe these events until the next command.

        A command holds for slightly more than one step; without another one the robot must stop.
        """

    def close(self) -> None:
        """Stop and release the robot. Called exactly once, even after errors."""
