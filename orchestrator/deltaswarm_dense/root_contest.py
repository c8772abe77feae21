"""Two roots in range of each other (`controllers/paper/root_contest.py`)."""

from deltaswarm_agent.controllers.paper.frames import MEMBER
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.membership import follow, leave_tree, stay
from deltaswarm_dense.states import SENIOR_ROOT, SENIOR_TOO_CLOSE, change
from deltaswarm_dense.whereabouts import sender_m2


@compiled
def yields(settings, agent, air, trees, now, heard):
    """Let a root yield to a senior that it hears; return False if it stays."""
    senior = senior_of(settings, agent, air, heard)
    if senior == NONE:
        return False
    if sender_m2(settings, agent, heard_of(air, senior)) >= settings.d_min_m2 and follow(
        settings, agent, air, trees, now, senior
    ):
        change(settings, agent, now, SENIOR_ROOT)
        stay(settings, agent)
    else:
        leave_tree(settings, agent, now, SENIOR_TOO_CLOSE)
    return True


@compiled
def senior_of(settings, agent, air, heard):
    """Return the root heard to which this one yields; NONE if it stays."""
    senior, equal, rivals = NONE, NONE, 0
    for k in range(heard.size):
        sender = heard[k]
        frame = heard_of(air, sender)
        if frame.kind != MEMBER or frame.path_length != 1:
            continue
        rivals += 1
        if frame.pulse > agent.pulse or (frame.pulse == agent.pulse and sender < agent.id):
            if senior == NONE or _is_before(air, sender, senior):
                senior = sender
        elif sender < agent.id and frame.pulse >= agent.pulse - settings.freshness:
            if equal == NONE or _is_before(air, sender, equal):
                equal = sender
    if rivals == 0 or senior != NONE:
        return senior
    agent.contested_steps += equal != NONE
    return equal if agent.contested_steps >= settings.contested else NONE


@compiled
def _is_before(air, one, other):
    """Order by the longer pulse, then the lower id."""
    pulse, others = heard_of(air, one).pulse, heard_of(air, other).pulse
    return pulse > others or (pulse == others and one < other)
