"""Root Formation (`controllers/paper/root_formation.py`)."""

from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.delta import delta_of
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.membership import enter_tree
from deltaswarm_dense.states import THRESHOLD_REACHED


@compiled
def founds(swarm, agent, now, sensed, hears_members):
    """Make a free agent a root, if it senses enough events and hears no member of a tree."""
    threshold = delta_of(agent)
    if threshold == NONE or sensed.size < threshold or hears_members:
        return False
    enter_tree(swarm, agent, now, NONE, THRESHOLD_REACHED)
    return True
