"""Tree Growth (the paper's section of that name).

"When a free agent moves within communication range of another member of the swarm that is in a tree", at least d_min
away from it, it joins the tree with that member as its parent, and stops. Our reading: of several the nearest, and
literally *moves* within range, so that a freed agent does not join again at once.
"""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.frames import Member
from deltaswarm_agent.controllers.paper.membership import fits_below
from deltaswarm_agent.controllers.paper.states import Cause


def joins(agent: Agent, members: list[Member]) -> bool:
    """Let a free agent join the nearest member newly in range and at least d_min away, if there is one."""
    candidates = [
        frame
        for frame in members
        if not frame.orphan
        and agent.here.is_legal(frame)
        and agent.here.is_newly_met(frame)
        and fits_below(agent.id, frame)
        and (agent.previous_tree is None or agent.previous_tree.trusts(frame, agent.now))
    ]
    if not candidates:
        return False
    agent.enter_tree(min(candidates, key=agent.sender_distance), Cause.MEMBER_MET)
    return True
