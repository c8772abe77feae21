"""Delta at run time (`controllers/paper/delta.py`)."""

import numpy as np

from deltaswarm_agent.controllers.paper.delta import CHOICES
from deltaswarm_agent.controllers.paper.settings import BANDIT as BANDIT_RULE
from deltaswarm_agent.controllers.paper.settings import BUSY as BUSY_RULE
from deltaswarm_agent.controllers.paper.settings import FIXED as FIXED_RULE
from deltaswarm_agent.controllers.paper.settings import LEARNED as LEARNED_RULE
from deltaswarm_dense.compiled import compiled

RULES = FIXED_RULE, BUSY_RULE, LEARNED_RULE, BANDIT_RULE
FIXED, BUSY, LEARNED, BANDIT = range(len(RULES))

LEAST_BUSY = np.array([least for least, _ in CHOICES])
DELTAS = np.array([delta for _, delta in CHOICES])


@compiled
def delta_of(agent):
    """Return the number of events sensed at once that makes an agent a root; NONE: never (`Agent.delta`)."""
    if agent.rule == BUSY:
        for k in range(DELTAS.size):
            if agent.busy >= LEAST_BUSY[k]:
                return DELTAS[k]
    return agent.founds_at
