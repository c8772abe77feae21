"""Patience (`controllers/paper/patience.py`)."""

from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.finds import rate_hz
from deltaswarm_dense.membership import leave_tree, level_of
from deltaswarm_dense.states import IMPATIENT


@compiled
def lose_patience(settings, agent, now, senses):
    """Count a member's or a root's idle time; return whether it left its tree."""
    if senses:
        agent.idle_s = 0.0
        return False
    agent.idle_s += max(1, level_of(agent)) * settings.step_s
    if agent.idle_s * rate_hz(agent) < settings.patience_finds:
        return False
    leave_tree(settings, agent, now, IMPATIENT)
    return True
