"""Members that lose their parent, and how they find another one (`controllers/paper/orphans.py`)."""

from deltaswarm_agent.controllers.paper.frames import LEAVING, MEMBER
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.membership import adopts, follow, leave_tree
from deltaswarm_dense.states import (
    ADOPTED,
    CYCLE_FOUND,
    NOBODY_FOUND,
    PARENT_LEFT,
    PARENT_LOST,
    PULSE_STALLED,
    change,
)
from deltaswarm_dense.succession import succeeds
from deltaswarm_dense.whereabouts import is_legal, sender_m2


@compiled
def hear_parent(settings, agent, air, trees, now, sender):
    """Follow the parent's frame; return False if that ends this agent's membership as it was."""
    kind = heard_of(air, sender).kind
    if kind == LEAVING:
        leave_tree(settings, agent, now, PARENT_LEFT)
    elif kind != MEMBER:
        become_orphan(settings, agent, now, PARENT_LOST)
    elif not follow(settings, agent, air, trees, now, sender):
        become_orphan(settings, agent, now, CYCLE_FOUND)
    else:
        return True
    return False


@compiled
def misses_parent(swarm, agent, now):
    """Return whether a parent silent for too long, or a stalled pulse, changed this agent's membership."""
    settings = swarm.settings[0]
    if now - agent.parent_heard >= settings.silence:
        if not succeeds(swarm, agent, now):
            become_orphan(settings, agent, now, PARENT_LOST)
    elif now - agent.pulse_step >= settings.stall:
        leave_tree(settings, agent, now, PULSE_STALLED)
    else:
        return False
    return True


@compiled
def become_orphan(settings, agent, now, cause):
    """Lose the parent, and look for another from the next step on."""
    change(settings, agent, now, cause)
    agent.since = now


@compiled
def find_parent(swarm, agent, now, heard, strict_steps, steps):
    """Let an orphan, or a recruited agent at its goal, find a parent in its own tree; return whether it has one."""
    settings, air, waited = swarm.settings[0], swarm.air, now - agent.since
    best, best_m2 = NONE, 0.0
    for k in range(heard.size):
        frame = heard_of(air, heard[k])
        if frame.kind != MEMBER:
            continue
        m2 = sender_m2(settings, agent, frame)
        fits = is_legal(settings, agent, frame) if waited < strict_steps else m2 <= settings.reach_m2
        if fits and adopts(settings, agent, swarm.trees.heirs, now, frame) and (best == NONE or m2 < best_m2):
            best, best_m2 = heard[k], m2
    if best != NONE and follow(settings, agent, air, swarm.trees, now, best):
        change(settings, agent, now, ADOPTED)
        return True
    if waited >= steps:
        leave_tree(settings, agent, now, NOBODY_FOUND)
    return False
