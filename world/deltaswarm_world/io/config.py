"""Configuration of the world's process."""

from dataclasses import dataclass
from pathlib import Path

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.keys import OPERATOR
from deltaswarm_wire.session import RouterLink


@dataclass(frozen=True)
class WorldConfig:
    """One run: its scenario, links and files."""

    run: str
    scenario: Scenario
    link: RouterLink
    credentials: Path
    """File of `user:password` lines, one per process."""
    out: Path
    expect: tuple[str, ...] = (OPERATOR,)
    """Roles, besides the agents, that must be ready before the first step."""
    publish_truth: bool = False
    publish_wire: bool = False
    """Publish every raw radio frame and report, for a recorder."""
    listen: tuple[str, ...] = ()
    """Endpoints; default: the link's."""
    checkpoint_steps: int = 0
    """Interval of checkpoints in steps; 0: never."""
    has_station: bool = False
    """Accept commands and pace from a person, without waiting for turns."""
    boards: tuple[int, ...] = ()
    """Agents on machines of their own, which may leave and come back."""
