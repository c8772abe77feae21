"""The configuration of an agent: its task and its own body, with the paper's values as defaults."""

from dataclasses import dataclass
from typing import Any

from deltaswarm_wire.checked import PAPER, key, rest
from deltaswarm_wire.obstacles import ObstacleSettings


@dataclass(frozen=True)
class ControlSettings:
    """The controller and its options, which its `Settings` class checks."""

    mode: str = key("hybrid", "the controller: a shipped name, an entry point, or module:Class", source=PAPER)
    options: dict[str, Any] = rest("the controller's own options")


@dataclass(frozen=True)
class AgentSettings:
    """Configuration of one agent: its task and its own body, nothing about other agents.

    Besides this, an agent of a run gets only its number, the run's name, the router's address and its password.
    """

    seed: int = key(1, "the agent's own seed", low=0, high=2**63 - 1)
    step_s: float = key(1.0, "length of a step [s]", low=0.01, high=60)
    width_m: float = key(100.0, "arena along x [m]", low=1, high=1e5)
    height_m: float = key(100.0, "arena along y [m]", low=1, high=1e5)
    obstacles: tuple[ObstacleSettings, ...] = key((), "obstacles on its map")
    speed_mps: float = key(1.0, "maximum speed [m/s]", above=0, high=100)
    radius_m: float = key(0.0, "radius of its body; 0: a point [m]", low=0, high=100)
    sensing_range_m: float = key(5.0, "sensing range [m]", above=0)
    range_m: float = key(9.0, "nominal radio range [m]", above=0)
    latency_s: float = key(0.0, "longest delay of its radio beyond one step per hop [s]", low=0, high=7200)
    control: ControlSettings = key(ControlSettings, "its controller")
