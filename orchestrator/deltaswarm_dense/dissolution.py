"""Dissolution (`controllers/paper/dissolution.py`)."""

from deltaswarm_agent.controllers.paper.dissolution import EXHAUSTED
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.membership import leave_tree, level_of
from deltaswarm_dense.patience import lose_patience
from deltaswarm_dense.states import DISSOLVED, ROOT_IDLE


@compiled
def dissolve(settings, agent, now, senses):
    """Renew or lower the gamma of a member or root; return whether it left its tree."""
    if not settings.dissolution:
        return False
    if settings.patience_finds:
        return lose_patience(settings, agent, now, senses)
    level = level_of(agent)
    if senses or (level == 0 and agent.children > 0):
        agent.gamma = settings.gamma_max
        return False
    if level or settings.idle_root_leaves:
        agent.gamma -= (level if level else 1) * settings.step_s
    if agent.gamma > EXHAUSTED:
        return False
    leave_tree(settings, agent, now, DISSOLVED if level else ROOT_IDLE)
    return True
