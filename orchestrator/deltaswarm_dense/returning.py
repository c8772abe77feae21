"""Return to finds (`controllers/paper/returning.py`)."""

import math

from deltaswarm_agent.controllers.paper.returning import LEAST, MAX_PLACES, MOST, SPREAD_M
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.finds import ratio
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.randomness import gauss, place_of_choice, random


@compiled
def add_place(agent, x_m, y_m, now):
    """Remember a place."""
    if agent.found == MAX_PLACES:
        _forget(agent, 0)
    agent.found_x_m[agent.found], agent.found_y_m[agent.found], agent.found_step[agent.found] = x_m, y_m, now
    agent.found += 1
    agent.back_step = NONE


@compiled
def _forget(agent, place):
    agent.found -= 1
    for k in range(place, agent.found):
        agent.found_x_m[k], agent.found_y_m[k] = agent.found_x_m[k + 1], agent.found_y_m[k + 1]
        agent.found_step[k] = agent.found_step[k + 1]


@compiled
def _forget_vain_goal(agent):
    """Forget the place to which a whole leg led back in vain."""
    if agent.back_step == NONE:
        return
    for k in range(agent.found):
        if (
            agent.found_x_m[k] == agent.back_x_m
            and agent.found_y_m[k] == agent.back_y_m
            and agent.found_step[k] == agent.back_step
        ):
            _forget(agent, k)
            break
    agent.back_step = NONE


@compiled
def chooses_goal(settings, agent, now):
    """End the present leg; return whether the next one leads back, to the place that is now `back` (`next_goal`)."""
    _forget_vain_goal(agent)
    fresh = 0
    for k in range(agent.found):
        fresh += now - agent.found_step[k] <= settings.find_memory
    if fresh == 0 or random(agent) >= max(LEAST, MOST * (1.0 - math.pow(ratio(agent), settings.two))):
        return False
    chosen = place_of_choice(agent, fresh)
    for k in range(agent.found):
        if now - agent.found_step[k] <= settings.find_memory:
            if chosen == 0:
                agent.back_x_m, agent.back_y_m = agent.found_x_m[k], agent.found_y_m[k]
                agent.back_step = agent.found_step[k]
                break
            chosen -= 1
    return True


@compiled
def near_goal_m(settings, agent):
    """Draw where in the arena a returning leg ends [m]."""
    x_m, y_m = gauss(agent, agent.back_x_m, agent.back_y_m, SPREAD_M)
    return min(max(x_m, 0.0), settings.width_m), min(max(y_m, 0.0), settings.height_m)
