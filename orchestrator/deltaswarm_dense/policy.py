"""The learned rule (`controllers/paper/policy.py`)."""

import math

from deltaswarm_agent.controllers.paper.policy import FAR_DELTA, FIRST_DELTA, GAIN, HIDDEN, INPUTS, LEAST_DELTA
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.experience import write_inputs
from deltaswarm_dense.layout import NONE

COUNT = len(INPUTS)
UNITS = COUNT + HIDDEN


@compiled
def choose_structure(settings, weights, agent, now):
    """Follow the policy (`Agent.choose_structure`)."""
    write_inputs(settings, agent, now)
    units, at = agent.units, 0
    for h in range(HIDDEN):
        total = weights[at]
        for k in range(COUNT):
            total += weights[at + 1 + k] * units[k]
        units[COUNT + h] = total / (1.0 + abs(total))
        at += 1 + COUNT
    delta, working = weights[at], weights[at + 1 + UNITS]
    for k in range(UNITS):
        delta += weights[at + 1 + k] * units[k]
        working += weights[at + 2 + UNITS + k] * units[k]
    delta = FIRST_DELTA + GAIN * delta
    agent.attends = agent.rank < 1.0 + working
    if delta > FAR_DELTA:
        agent.founds_at = NONE
        return
    delta = max(delta, LEAST_DELTA)
    least = math.floor(delta)
    agent.founds_at = int(least) + (agent.rank < delta - least)
