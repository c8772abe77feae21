"""Baseline coordination algorithm (`controllers/paper/baseline.py`)."""

from deltaswarm_agent.controllers.paper.frames import ATTENDING as ATTENDING_FRAME
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.states import (
    ANOTHER_SENSED,
    AT_THE_EVENT,
    ATTENDING,
    EVENT_COMPLETE,
    EVENT_NOT_THERE,
    EVENT_SENSED,
    GOING,
    NEIGHBOUR_ATTENDS,
    WALKING,
    change,
)
from deltaswarm_dense.whereabouts import distance_m2, is_newly_met, is_reachable, sender_m2


@compiled
def nearest_sensed(settings, agent, events, sensed):
    """Return the nearest of the sensed events, ties by lowest id."""
    best, best_m2 = sensed[0], 0.0
    for k in range(sensed.size):
        event = events[sensed[k]]
        m2 = distance_m2(settings, agent, event.x_m, event.y_m)
        if k == 0 or m2 < best_m2 or (m2 == best_m2 and event.id < events[best].id):
            best, best_m2 = sensed[k], m2
    return best


@compiled
def seek_event(swarm, agent, now, sensed, heard):
    """Go to an event, and observe it until it is complete; one that is not to work only ends what it has begun."""
    settings, events = swarm.settings[0], swarm.world.events
    if not agent.attends:
        at = 0
        while at < sensed.size and sensed[at] != agent.target:
            at += 1
        sensed, heard = sensed[at : at + 1], heard[:0]
    had_target = agent.target != NONE
    target_x_m, target_y_m = agent.target_x_m, agent.target_y_m
    if agent.state == ATTENDING and had_target:
        for k in range(sensed.size):
            if sensed[k] == agent.target:
                return
        change(settings, agent, now, ANOTHER_SENSED if sensed.size else EVENT_COMPLETE)
    if sensed.size:
        agent.target = nearest_sensed(settings, agent, events, sensed)
        agent.target_x_m, agent.target_y_m = events[agent.target].x_m, events[agent.target].y_m
        if agent.state == WALKING:
            change(settings, agent, now, EVENT_SENSED)
    elif agent.state == GOING and had_target:
        if distance_m2(settings, agent, target_x_m, target_y_m) < settings.gone_m2:
            change(settings, agent, now, EVENT_NOT_THERE)
    elif heard.size and agent.state == WALKING:
        _join_attending(settings, agent, swarm.air, swarm.trail_m, now, heard)
    if agent.state == GOING and sensed.size and agent.target != NONE:
        if distance_m2(settings, agent, agent.target_x_m, agent.target_y_m) <= settings.at_event_m2:
            change(settings, agent, now, AT_THE_EVENT)


@compiled
def _join_attending(settings, agent, air, trail_m, now, heard):
    """Let a walking agent newly in range of an attending agent go to its event."""
    best, best_m2 = NONE, 0.0
    for k in range(heard.size):
        frame = heard_of(air, heard[k])
        if (
            frame.kind == ATTENDING_FRAME
            and is_newly_met(settings, agent, trail_m, now, frame)
            and is_reachable(settings, frame.event_x_cm / 100, frame.event_y_cm / 100)
        ):
            m2 = sender_m2(settings, agent, frame)
            if best == NONE or m2 < best_m2:
                best, best_m2 = heard[k], m2
    if best != NONE:
        frame = heard_of(air, best)
        agent.target = frame.event
        agent.target_x_m, agent.target_y_m = frame.event_x_cm / 100, frame.event_y_cm / 100
        change(settings, agent, now, NEIGHBOUR_ATTENDS)
