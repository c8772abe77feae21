"""Two roots in range of each other: the senior stays, the other joins it or leaves.

The paper has no rule for this; without one, trees would interleave.
"""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.frames import Member, PaperFrame
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import Cause


def yields(agent: Agent, membership: Membership, heard: list[PaperFrame]) -> bool:
    """Let a root yield to a senior that it hears; False if it stays. To be called before the root's pulse beats."""
    rivals = [frame for frame in heard if type(frame) is Member and len(frame.path) == 1]
    senior = senior_of(agent, membership, rivals) if rivals else None
    if senior is None:
        return False
    if agent.here.is_apart(senior) and membership.follow(senior, agent.now):
        agent.change(Cause.SENIOR_ROOT)
        agent.stay()
    else:
        agent.leave_tree(Cause.SENIOR_TOO_CLOSE)
    return True


def senior_of(agent: Agent, membership: Membership, rivals: list[Member]) -> Member | None:
    """The root heard to which this one, a root too, yields; None if it stays.

    With latency in the air two roots of about the same age each seem the senior to themselves. When
    both have stayed for long, the one with the higher id yields.
    """
    seniors = [frame for frame in rivals if is_senior(frame, membership.pulse, agent.id)]
    if not seniors:
        oldest = membership.pulse - agent.timers.freshness
        equals = [frame for frame in rivals if frame.sender < agent.id and frame.pulse >= oldest]
        agent.contested += bool(equals)
        if agent.contested >= agent.timers.contested:
            seniors = equals
    return min(seniors, key=lambda frame: (-frame.pulse, frame.sender), default=None)


def is_senior(rival: Member, pulse: int, agent: int) -> bool:
    """Whether another root is senior: the longer pulse of the step before this one, equal ones by lower id.

    A pulse that comes later than one step is too short and never too long. So the root that yields is the younger
    in truth, and roots cannot yield in a ring.
    """
    return (rival.pulse, -rival.sender) > (pulse, -agent)
