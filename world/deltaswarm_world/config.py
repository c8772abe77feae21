"""What the world process is told."""

from dataclasses import dataclass
from pathlib import Path

from deltaswarm_wire.keys import OPERATOR
from deltaswarm_wire.session import RouterLink
from deltaswarm_wire.settings import Scenario


@dataclass(frozen=True)
class WorldConfig:
    """One run: its scenario, how parts join, what is left where."""

    run: str
    scenario: Scenario
    link: RouterLink
    credentials: Path
    """File of `user:password` lines, one for each process that may join."""
    out: Path
    expect: tuple[str, ...] = (OPERATOR,)
    """Roles, besides the agents, that must be there before the first step."""
    publish_truth: bool = False
    publish_wire: bool = False
    """Every raw radio frame and report, for a recorder."""
    listen: tuple[str, ...] = ()
    """Endpoints; without any, the link's."""
    checkpoint_steps: int = 0
    """Save world and agents each time that so many steps are closed; 0: never."""
    has_station: bool = False
    """A person may command, and set the pace; nobody waits for a person's turn."""
    boards: tuple[int, ...] = ()
    """Agents on machines of their own, which may leave and come back."""
