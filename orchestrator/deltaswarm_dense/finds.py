"""How often walkers find events, and how much of the time agents work (`controllers/paper/finds.py`)."""

import math

from deltaswarm_agent.controllers.paper.finds import FADING_S, LEAST_FINDS, LEAST_S, RANDOM, RETURNING
from deltaswarm_agent.controllers.paper.frames import ATTENDING, MEMBER
from deltaswarm_dense.arithmetic import rounded
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE
from deltaswarm_wire.codec import MAX_ID


@compiled
def rate_hz(agent):
    """Return the new events that a walker finds per second."""
    return (agent.finds[RANDOM] + agent.finds[RETURNING]) / (agent.walked_s[RANDOM] + agent.walked_s[RETURNING])


@compiled
def ratio(agent):
    """Return finds per second on random legs by those on returning ones."""
    return agent.finds[RANDOM] * agent.walked_s[RETURNING] / (agent.finds[RETURNING] * agent.walked_s[RANDOM])


@compiled
def update_averages(settings, agent, now):
    """Let the time since the last update pass (`Finds.update`)."""
    passed_s = (now - agent.averaged_step) * settings.step_s
    if passed_s <= 0.0:
        return
    agent.averaged_step = now
    kept = math.exp(-passed_s / FADING_S)
    agent.busy = kept * agent.busy + (1.0 - kept) * (1.0 if agent.works else 0.0)
    if agent.averaged_leg != NONE:
        for leg in range(2):
            agent.finds[leg] = max(LEAST_FINDS, agent.finds[leg] * kept)
            agent.walked_s[leg] *= kept
        agent.walked_s[agent.averaged_leg] += FADING_S * (1.0 - kept)


@compiled
def begin_activity(settings, agent, leg, works, now):
    """Say what the agent does from this step on (`Finds.begin`)."""
    if leg != agent.averaged_leg or works != agent.works:
        update_averages(settings, agent, now)
        agent.averaged_leg, agent.works = leg, works


@compiled
def hear_averages(settings, agent, air, now, heard):
    """Mix in the averages of others (`Finds.hear`)."""
    count = 0
    for k in range(heard.size):
        count += tells_averages(heard_of(air, heard[k]))
    if count == 0:
        return
    update_averages(settings, agent, now)
    kept = math.pow(settings.own_weight, float(count))
    for leg in range(2):
        mean = (1.0 - kept) * _sum_of(air, heard, leg) / count
        agent.finds[leg] = max(LEAST_FINDS, kept * agent.finds[leg] + mean / 1000)
        mean = (1.0 - kept) * _sum_of(air, heard, 2 + leg) / count
        agent.walked_s[leg] = max(LEAST_S, kept * agent.walked_s[leg] + mean / 10)
    agent.busy = kept * agent.busy + (1.0 - kept) * _sum_of(air, heard, 4) / count / 1000


@compiled
def tells_averages(frame):
    """Return whether a frame is of a kind that has averages, if a rule needs them."""
    return frame.kind == ATTENDING or frame.kind == MEMBER


@compiled
def _sum_of(air, heard, column):
    total = 0
    for k in range(heard.size):
        if tells_averages(heard_of(air, heard[k])):
            total += heard_of(air, heard[k]).averages[column]
    return total


@compiled
def tell_averages(settings, agent, frame, now):
    """Write the averages of a frame (`Finds.told`)."""
    update_averages(settings, agent, now)
    for leg in range(2):
        frame.averages[leg] = min(MAX_ID, rounded(1000 * agent.finds[leg]))
        frame.averages[2 + leg] = rounded(10 * agent.walked_s[leg])
    frame.averages[4] = rounded(1000 * agent.busy)
