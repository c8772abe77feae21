"""Patience (Charnov's marginal value theorem; not in the paper): when to stop waiting in a tree.

An agent that senses nothing counts idle seconds; below level 1 they count as often as there are agents above it, as in
`dissolution`. It leaves when a walker would have found `patience_finds` events by then: so it waits for long where
events are hard to find, and not at all where they are everywhere. A root does the same, and takes its tree along.
"""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import Cause
from deltaswarm_wire.messages import Event


def lose_patience(agent: Agent, membership: Membership, sensed: tuple[Event, ...]) -> bool:
    """Count a member's or a root's idle time; return whether it left its tree."""
    assert agent.finds is not None
    if sensed:
        agent.idle_s = 0.0
        return False
    agent.idle_s += max(1, membership.level) * agent.shared.step_s
    if agent.idle_s * agent.finds.rate_hz < agent.settings.patience_finds:
        return False
    agent.leave_tree(Cause.IMPATIENT)
    return True
