"""The random walk, and travel to a target (`controllers/paper/walk.py`), in an arena without obstacles."""

import math

from deltaswarm_agent.controllers.paper.finds import RANDOM, RETURNING
from deltaswarm_agent.core.obstacles import EDGE_M
from deltaswarm_dense.arithmetic import distance_m
from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.randomness import random, uniform
from deltaswarm_dense.returning import chooses_goal, near_goal_m
from deltaswarm_wire.messages import MAX_POSES

TAU = math.tau
LEVY_MIN_S = 1.0


@compiled
def leg_s(settings, agent):
    """Draw the duration of a leg [s]."""
    longest_s, exponent = settings.leg_max_s, settings.leg_exponent
    if exponent == 0.0:
        return uniform(agent, 0.0, longest_s)
    least_s, share = min(LEVY_MIN_S, longest_s), random(agent)
    if exponent == 1.0:
        return least_s * math.pow(longest_s / least_s, share)
    power = 1 - exponent
    least = math.pow(least_s, power)
    return math.pow(least + share * (math.pow(longest_s, power) - least), 1 / power)


@compiled
def turn(settings, agent, now):
    """Begin a new leg."""
    if settings.returns and chooses_goal(settings, agent, now):
        agent.leg = RETURNING
        x_m, y_m = near_goal_m(settings, agent)
        heading = math.atan2(y_m - agent.y_m, x_m - agent.x_m)
        time_s = distance_m(agent.x_m, agent.y_m, x_m, y_m) / settings.speed_mps
    else:
        agent.leg = RANDOM
        heading = uniform(agent, 0.0, TAU)
        time_s = leg_s(settings, agent)
    agent.leg_vx_mps = settings.speed_mps * math.cos(heading)
    agent.leg_vy_mps = settings.speed_mps * math.sin(heading)
    agent.leg_ends = now + max(1, int(math.ceil(time_s / settings.step_s)))


@inlined
def reflect(at_m, v_mps, step_s, wall_m):
    """Return the velocity of a stride that may cross a wall, and that after it; here no body is beyond one."""
    to_m = at_m + v_mps * step_s
    if 0.0 <= to_m <= wall_m:
        return v_mps, v_mps
    to_m = min(-to_m, wall_m) if to_m < 0.0 else max(2.0 * wall_m - to_m, 0.0)
    return (to_m - at_m) / step_s, -v_mps


@inlined
def walk(settings, agent, now):
    """Return the velocity of this step, and the step until which it holds (`velocity`, `straight_until`)."""
    if now >= agent.leg_ends:
        turn(settings, agent, now)
    vx_mps, agent.leg_vx_mps = reflect(agent.x_m, agent.leg_vx_mps, settings.step_s, settings.width_m)
    vy_mps, agent.leg_vy_mps = reflect(agent.y_m, agent.leg_vy_mps, settings.step_s, settings.height_m)
    if vx_mps != agent.leg_vx_mps or vy_mps != agent.leg_vy_mps:
        return vx_mps, vy_mps, now + 1
    free = float(min(agent.leg_ends - now, MAX_POSES))
    free = free_strides(agent.x_m, agent.leg_vx_mps * settings.step_s, settings.width_m, free)
    free = free_strides(agent.y_m, agent.leg_vy_mps * settings.step_s, settings.height_m, free)
    return vx_mps, vy_mps, now + max(1, int(math.floor(free)))


@inlined
def free_strides(at_m, stride_m, end_m, free):
    """Return how many strides fit before the arena's edge, at most `free` (`ObstacleMap.free_strides`)."""
    if stride_m == 0.0:
        return free
    room_m = (end_m - at_m if stride_m > 0 else at_m) - 0.0 - EDGE_M
    return max(0.0, min(free, room_m / abs(stride_m)))


@inlined
def towards(settings, agent, to_x_m, to_y_m):
    """Return the velocity straight to a target, which stops there."""
    dx, dy = to_x_m - agent.x_m, to_y_m - agent.y_m
    time_s = max(math.sqrt(dx * dx + dy * dy) / settings.speed_mps, settings.step_s)
    return dx / time_s, dy / time_s
