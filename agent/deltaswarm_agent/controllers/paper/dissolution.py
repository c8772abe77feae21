"""Dissolution (the paper's section of that name).

A member's gamma is gamma_max while it observes an event, and else falls by the number of agents above it each second:
gamma = gamma - t_i. At 0 the agent leaves the tree, and with it its subtree. A root has no agent above it and stays;
with `idle_root = "leaves"` one that has no followers and senses nothing leaves after gamma_max seconds. With patience
(`patience.py`) other rules hold.
"""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.patience import lose_patience
from deltaswarm_agent.controllers.paper.settings import LEAVES
from deltaswarm_agent.controllers.paper.states import Cause
from deltaswarm_wire.messages import Event

EXHAUSTED = 1e-9
"""Counts as 0, despite rounding of short steps."""


def dissolve(agent: Agent, membership: Membership, sensed: tuple[Event, ...]) -> bool:
    """Renew or lower the gamma of a member or root; return whether it left its tree."""
    settings = agent.settings
    if not settings.dissolution:
        return False
    if settings.patience_finds:
        return lose_patience(agent, membership, sensed)
    level = membership.level
    if sensed or (not level and membership.children):
        agent.gamma = settings.gamma_max
        return False
    if level or settings.idle_root == LEAVES:
        agent.gamma -= (level or 1) * agent.shared.step_s
    if agent.gamma > EXHAUSTED:
        return False
    agent.leave_tree(Cause.DISSOLVED if level else Cause.ROOT_IDLE)
    return True
