"""Succession (not in the paper): a tree whose root has fallen silent gets a new one.

The root's last frames name its children. Each child that misses the root for as long as any parent may be missed
knows them, and the one with the lowest id takes the root's place, with its own subtree and the root's pulse. The others
look for a parent as orphans do, in the trees of all of them. If the first child fell silent, too, the tree dissolves.
"""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import Cause


def succeeds(agent: Agent, membership: Membership) -> bool:
    """Let a member that misses its parent take a root's place if it is the first of its children."""
    if not agent.settings.root_succession or membership.level != 1:
        return False
    membership.heirs = membership.siblings()
    if agent.id != min(membership.heirs):
        return False
    agent.change(Cause.ELECTED)
    agent.stay()
    agent.contested = 0
    agent.recruits_in_transit.clear()
    membership.become_root(agent.now)
    return True
