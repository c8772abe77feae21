"""Dissolution (the paper's section of that name).

A member's gamma is gamma_max while it observes an event, and else falls by the number of agents above it each second:
gamma = gamma - t_i. At 0 the agent leaves the tree, and with it its subtree. A root has nobody above it and stays.
"""

from collections.abc import Sequence

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import Cause
from deltaswarm_wire.messages import Event

EXHAUSTED = 1e-9
"""Counts as 0, despite rounding of short steps."""


def dissolve(agent: Agent, membership: Membership, sensed: Sequence[Event]) -> None:
    """Renew or lower a member's gamma; at 0 the member becomes free."""
    if sensed or not agent.settings.dissolution:
        agent.gamma = agent.settings.gamma_max
        return
    agent.gamma -= membership.level * agent.shared.step_s
    if agent.gamma <= EXHAUSTED:
        agent.leave_tree(Cause.DISSOLVED)
