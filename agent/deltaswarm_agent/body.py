"""The body: what an agent has of a robot. In a simulation it is the world's frame; on a board it is a plug-in.

A plug-in is a class, named in the board's file by an entry point of the group `deltaswarm.bodies` or as
`module:Class`. It says what options it takes (`Settings`), and whether it can be run faster than real time
(`REAL_TIME`). Places are in m in the arena's frame, from (0, 0) at a corner; x and y as the arena's file says.
"""

from dataclasses import dataclass
from random import Random
from typing import Any, ClassVar, NamedTuple, Protocol

from deltaswarm_wire.messages import Event
from deltaswarm_wire.settings import AgentSettings


class Sensed(NamedTuple):
    """What a body knows at one time.

    `std_m` is the standard deviation of the place along each axis [m]. `fault` is empty while the body is well;
    else it says in a few words what is wrong, and the agent neither moves nor speaks on the strength of the rest.
    """

    x_m: float
    y_m: float
    std_m: float
    events: tuple[Event, ...] = ()
    fault: str = ""


NOWHERE = Sensed(0.0, 0.0, float("inf"), fault="no position yet")
"""What a body knows before its first position."""


@dataclass(frozen=True)
class BodyContext:
    """What any body is told of its agent: its number, its settings, and a generator of its own."""

    agent: int
    settings: AgentSettings
    rng: Random


class Body(Protocol):
    """One robot, for one agent. All calls come from one thread; none may block for as long as a step.

    A call that raises, or gives what it may not, is a fault of that step; after ten such steps in a row the agent ends.
    """

    Settings: ClassVar[type[Any]]
    """A frozen dataclass whose fields are made by `deltaswarm_wire.checked.key`: the options in the board's file."""

    REAL_TIME: ClassVar[bool]
    """Whether time on this body passes by the wall clock alone."""

    def sense(self, time_s: float) -> Sensed:
        """Where the robot is at `time_s` [s since the agent's start; never less than before], and what it senses."""

    def move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> None:
        """Go at this velocity [m/s; arena frame] until told otherwise, and observe these events meanwhile.

        A command holds for one step and a little; a robot that is not commanded again stops by itself.
        """

    def close(self) -> None:
        """Stop the robot and let go of it. Called once, whatever has happened."""
