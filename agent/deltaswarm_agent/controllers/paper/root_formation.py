"""Root Formation (the paper's section of that name).

"An agent forms a root node when the density of events currently occurring within the sensing range of the agent at its
current location exceeds an event density threshold", |E_i^(x,y)| >= rho (delta under hybrid control). It stops, and is
the root of a new tree without followers. Our reading: not where it hears a member of a tree, which it may join.
"""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.frames import Member
from deltaswarm_agent.controllers.paper.states import Cause
from deltaswarm_wire.messages import Event


def founds(agent: Agent, sensed: tuple[Event, ...], members: list[Member]) -> bool:
    """Make a free agent a root, if it senses enough events and hears no member of a tree."""
    threshold = agent.delta
    if threshold is None or len(sensed) < threshold or members or agent.now < agent.founds_from:
        return False
    agent.enter_tree(None, Cause.THRESHOLD_REACHED)
    return True
