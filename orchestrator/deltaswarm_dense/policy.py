"""The learned rule (`controllers/paper/policy.py`)."""

import math

from deltaswarm_agent.controllers.paper.policy import FAR_DELTA, FIRST_DELTA, GAIN, INPUTS, LEAST_DELTA
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.experience import write_inputs
from deltaswarm_dense.layout import NONE

COUNT = len(INPUTS)


@compiled
def choose_structure(settings, weights, agent, now):
    """Follow the policy (`Agent.choose_structure`)."""
    write_inputs(settings, agent, now)
    inputs = agent.inputs
    delta, working = weights[0], weights[1 + COUNT]
    for k in range(COUNT):
        delta += weights[1 + k] * inputs[k]
        working += weights[2 + COUNT + k] * inputs[k]
    delta = FIRST_DELTA + GAIN * delta
    agent.attends = agent.rank < 1.0 + working
    if delta > FAR_DELTA:
        agent.founds_at = NONE
        return
    delta = max(delta, LEAST_DELTA)
    least = math.floor(delta)
    agent.founds_at = int(least) + (agent.rank < delta - least)
