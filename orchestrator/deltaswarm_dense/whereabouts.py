"""Distances to others, whose places are as their frames say (`controllers/paper/whereabouts.py`)."""

from deltaswarm_dense.arithmetic import squared_m2
from deltaswarm_dense.compiled import compiled, inlined


@inlined
def distance_m2(settings, agent, x_m, y_m):
    """Return the squared distance to a place [m2]."""
    return squared_m2(x_m - agent.x_m, y_m - agent.y_m, settings.two)


@inlined
def sender_m2(settings, agent, frame):
    """Return the squared distance to a frame's sender [m2]."""
    return distance_m2(settings, agent, frame.x_cm * 0.01, frame.y_cm * 0.01)


@compiled
def is_newly_met(settings, agent, trail_m, now, frame):
    """Return whether the sender is in range now and was not a moment ago."""
    if sender_m2(settings, agent, frame) > settings.range_m2:
        return False
    x_m, y_m = frame.x_cm * 0.01, frame.y_cm * 0.01
    for back in range(1, min(settings.trail, now - agent.began) + 1):
        there = trail_m[(now - back) % settings.trail, agent.id]
        if squared_m2(x_m - there[0], y_m - there[1], settings.two) > settings.range_m2:
            return True
    return False


@compiled
def is_legal(settings, agent, frame):
    """Return whether the sender is at a legal distance for a parent."""
    return settings.d_min_m2 <= sender_m2(settings, agent, frame) <= settings.reach_m2


@compiled
def is_reachable(settings, x_m, y_m):
    """Return whether a place that another agent named is in the arena."""
    return 0.0 <= x_m <= settings.width_m and 0.0 <= y_m <= settings.height_m
