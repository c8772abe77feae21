"""Tree Growth (`controllers/paper/growth.py`)."""

from deltaswarm_agent.controllers.paper.frames import MEMBER
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.membership import enter_tree, fits_below, trusts
from deltaswarm_dense.states import MEMBER_MET
from deltaswarm_dense.whereabouts import is_legal, is_newly_met, sender_m2


@compiled
def joins(swarm, agent, now, heard):
    """Let a free agent join the nearest member newly in range and at least d_min away, if there is one."""
    settings, best, best_m2 = swarm.settings[0], NONE, 0.0
    for k in range(heard.size):
        frame = heard_of(swarm.air, heard[k])
        if (
            frame.kind == MEMBER
            and not frame.orphan
            and is_legal(settings, agent, frame)
            and is_newly_met(settings, agent, swarm.trail_m, now, frame)
            and fits_below(agent, frame)
            and (agent.previous_root == NONE or trusts(settings, agent, now, frame))
        ):
            m2 = sender_m2(settings, agent, frame)
            if best == NONE or m2 < best_m2:
                best, best_m2 = heard[k], m2
    if best == NONE:
        return False
    enter_tree(swarm, agent, now, best, MEMBER_MET)
    return True
