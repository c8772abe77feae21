"""Questions to a running world for `deltaswarm why`: could one agent, or the operator, hear another, and why not?"""

from deltaswarm_world.core.air.channel.links import Diagnosis
from deltaswarm_world.core.air.trace import TracedAir
from deltaswarm_world.core.uplink.trace import TracedUplink
from deltaswarm_world.core.world import WorldCore

Answer = tuple[list[Diagnosis], list[str]]
"""What each model says of a link in the last step, and what became of its frames or reports."""


def watch(world: WorldCore, sender: int, receiver: int) -> None:
    """Trace the frames of one agent at another from the next step on."""
    world.air = TracedAir(world.air, sender, receiver)


def explain(world: WorldCore) -> Answer:
    """The answer for the watched link; what is heard now was sent in the step before."""
    assert isinstance(world.air, TracedAir)
    return world.air.explain(world.speaking), world.air.outcomes_of(world.links)


def watch_uplink(world: WorldCore, sender: int) -> None:
    """Trace one agent's reports from the next step on."""
    assert world.uplink is not None
    world.uplink = TracedUplink(world.uplink, sender)


def explain_uplink(world: WorldCore) -> Answer:
    """The answer for the watched agent's way to the operator."""
    assert isinstance(world.uplink, TracedUplink)
    return world.uplink.explain(), list(world.uplink.outcomes)
