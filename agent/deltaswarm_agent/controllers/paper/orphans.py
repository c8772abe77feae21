"""Members that lose their parent, and how they find another in their own tree."""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.frames import Leaving, Member, PaperFrame
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import Cause
from deltaswarm_agent.controllers.paper.succession import succeeds


def hear_parent(agent: Agent, membership: Membership, frame: PaperFrame) -> bool:
    """Follow the parent's frame; False if that ends this agent's membership as it was."""
    if type(frame) is Leaving:
        agent.leave_tree(Cause.PARENT_LEFT)
    elif type(frame) is not Member:
        become_orphan(agent, Cause.PARENT_LOST)
    elif not membership.follow(frame, agent.now):
        become_orphan(agent, Cause.CYCLE_FOUND)
    else:
        return True
    return False


def misses_parent(agent: Agent, membership: Membership) -> bool:
    """Whether a parent silent for too long made this agent an orphan or a root, or a stalled pulse set it free."""
    if agent.now - membership.parent_heard >= agent.timers.silence:
        if not succeeds(agent, membership):
            become_orphan(agent, Cause.PARENT_LOST)
    elif agent.now - membership.pulse_step >= agent.timers.stall:
        agent.leave_tree(Cause.PULSE_STALLED)
    else:
        return False
    return True


def become_orphan(agent: Agent, cause: Cause) -> None:
    """Lose the parent, and look for another from the next step on."""
    agent.change(cause)
    agent.since = agent.now


def find_parent(agent: Agent, membership: Membership, heard: list[PaperFrame], strict_steps: int, steps: int) -> bool:
    """Let an orphan, or a recruited agent at its target, find a parent in its own tree; return whether it has one.

    For `strict_steps` it takes members at legal distance only, then any in range; after `steps` it gives up.
    """
    waited = agent.now - agent.since
    fits = agent.here.is_legal if waited < strict_steps else agent.here.is_within_reach
    candidates = [f for f in heard if type(f) is Member and fits(f) and membership.adopts(f, agent.now)]
    parent = min(candidates, key=agent.sender_distance, default=None)
    if parent is not None and membership.follow(parent, agent.now):
        agent.change(Cause.ADOPTED)
        return True
    if waited >= steps:
        agent.leave_tree(Cause.NOBODY_FOUND)
    return False
