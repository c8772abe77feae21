"""Succession of a silent root (`controllers/paper/succession.py`)."""

from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.layout import AGENT_ID, PARENT
from deltaswarm_dense.membership import forget_recruits, level_of, parent_of, stay
from deltaswarm_dense.states import ELECTED, change


@compiled
def succeeds(swarm, agent, now):
    """Let a member that misses its parent take a root's place if it is the first of its children."""
    settings, trees, i = swarm.settings[0], swarm.trees, agent.id
    if not settings.root_succession or level_of(agent) != 1:
        return False
    trees.heirs[i, 0] = i
    agent.heirs = 1
    first, parent = i, parent_of(agent)
    for k in range(agent.parents_rows):
        row = trees.parents_tables[i, k]
        if row[PARENT] == parent:
            trees.heirs[i, agent.heirs] = row[AGENT_ID]
            agent.heirs += 1
            first = min(first, row[AGENT_ID])
    if i != first:
        return False
    change(settings, agent, now, ELECTED)
    stay(settings, agent)
    agent.contested_steps = 0
    forget_recruits(swarm.recruits.until, agent)
    agent.path[0] = i
    agent.path_length = 1
    agent.pulse += now - agent.pulse_step
    agent.pulse_step = now
    return True
