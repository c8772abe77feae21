"""A tree member's knowledge of events (`controllers/paper/beliefs.py`), in the order of Python's dictionaries.

`updates` and `places` are an agent's own rows of `Beliefs`. A full list is left as it is, and `is_full` says so.
"""

import math

from deltaswarm_agent.controllers.paper.frames import MAX_EVENTS, MAX_GONE
from deltaswarm_agent.controllers.paper.frames import MEMBER as MEMBER_FRAME
from deltaswarm_dense.arithmetic import rounded
from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE


@inlined
def to_cm(metres):
    """Round metres to whole centimetres, as in frames."""
    return rounded(metres * 100.0)


@compiled
def is_full(agent, beliefs):
    """Return whether an agent may have no room for what it learns next."""
    return max(agent.updates, agent.places) == beliefs.sorted.size


@inlined
def _find(entries, count, event):
    for at in range(count):
        if entries[at].event == event:
            return at
    return NONE


@compiled
def _update(agent, updates, event, step):
    """Set `_last_update_step[event] = step`."""
    at = _find(updates, agent.updates, event)
    if at == NONE:
        if agent.updates == updates.size:
            return
        at = agent.updates
        updates[at].event = event
        agent.updates += 1
    updates[at].step = step


@compiled
def _put(agent, places, event, x_cm, y_cm):
    """Set `_places[event] = (x_cm, y_cm)`."""
    at = _find(places, agent.places, event)
    if at == NONE:
        if agent.places == places.size:
            return
        at = agent.places
        places[at].event = event
        agent.places += 1
    places[at].x_cm, places[at].y_cm = x_cm, y_cm


@compiled
def _remove_update(agent, updates, at):
    for later in range(at + 1, agent.updates):
        updates[later - 1].event, updates[later - 1].step = updates[later].event, updates[later].step
    agent.updates -= 1


@compiled
def _remove_place(agent, places, event):
    at = _find(places, agent.places, event)
    if at != NONE:
        for later in range(at + 1, agent.places):
            places[later - 1].event = places[later].event
            places[later - 1].x_cm, places[later - 1].y_cm = places[later].x_cm, places[later].y_cm
        agent.places -= 1


@inlined
def _step_of(agent, updates, event):
    at = _find(updates, agent.updates, event)
    return -1 if at == NONE else updates[at].step


@compiled
def sense(settings, agent, beliefs, events, now, sensed):
    """Take the own sensor's events, and the missing ones."""
    updates, places = beliefs.updates[agent.id], beliefs.places[agent.id]
    for k in range(sensed.size):
        event = events[sensed[k]]
        _update(agent, updates, sensed[k], now)
        _put(agent, places, sensed[k], to_cm(event.x_m), to_cm(event.y_m))
    x_cm, y_cm = 100.0 * agent.x_m, 100.0 * agent.y_m
    at = 0
    while at < agent.places:
        number = places[at].event
        dx, dy = places[at].x_cm - x_cm, places[at].y_cm - y_cm
        if (
            _step_of(agent, updates, number) != now
            and math.pow(dx, settings.two) + math.pow(dy, settings.two) < settings.near_cm2
        ):
            _update(agent, updates, number, now)
            _remove_place(agent, places, number)
        else:
            at += 1


@compiled
def hear_tree(agent, beliefs, air, now, heard):
    """Take the frames of members of the own tree; fresher information wins."""
    updates, places = beliefs.updates[agent.id], beliefs.places[agent.id]
    for k in range(heard.size):
        frame = heard_of(air, heard[k])
        if frame.kind != MEMBER_FRAME or frame.path[0] != agent.path[0]:
            continue
        for row in range(frame.sightings):
            event, step = frame.sighting[4 * row], now - 1 - frame.sighting[4 * row + 3]
            if _step_of(agent, updates, event) < step:
                _update(agent, updates, event, step)
                _put(agent, places, event, frame.sighting[4 * row + 1], frame.sighting[4 * row + 2])
        for row in range(frame.departures):
            event, step = frame.departure[2 * row], now - 1 - frame.departure[2 * row + 1]
            if _step_of(agent, updates, event) < step:
                _update(agent, updates, event, step)
                _remove_place(agent, places, event)


@compiled
def forget(settings, agent, beliefs, now):
    """Drop information that is too old to use or to send."""
    updates, places = beliefs.updates[agent.id], beliefs.places[agent.id]
    at = 0
    while at < agent.updates:
        event, age = updates[at].event, now - updates[at].step
        is_old = age > settings.memory
        if is_old and (age > settings.gone or _find(places, agent.places, event) != NONE):
            _remove_place(agent, places, event)
            _remove_update(agent, updates, at)
        else:
            at += 1


@compiled
def sightings(agent, beliefs, events, now, frame):
    """Write the freshest events believed present to a frame."""
    updates, places = beliefs.updates[agent.id], beliefs.places[agent.id]
    frame.sightings = 0
    for at in range(agent.places):
        event = places[at].event
        age = now - _step_of(agent, updates, event)
        if agent.places <= MAX_EVENTS:
            row = frame.sightings
        else:
            row = _room_for(events, frame.sighting, frame.sightings, MAX_EVENTS, event, age)
        if row != NONE:
            frame.sighting[4 * row], frame.sighting[4 * row + 1] = event, places[at].x_cm
            frame.sighting[4 * row + 2], frame.sighting[4 * row + 3] = places[at].y_cm, age
            frame.sightings = min(frame.sightings + 1, MAX_EVENTS)


@compiled
def departures(agent, beliefs, events, now, frame):
    """Write the events most recently found missing to a frame."""
    updates, places = beliefs.updates[agent.id], beliefs.places[agent.id]
    frame.departures = 0
    missing = agent.updates - agent.places
    if missing == 0:
        return
    for at in range(agent.updates):
        event, age = updates[at].event, now - updates[at].step
        if _find(places, agent.places, event) != NONE:
            continue
        if missing <= MAX_GONE:
            row = frame.departures
        else:
            row = _room_for(events, frame.departure, frame.departures, MAX_GONE, event, age)
        if row != NONE:
            frame.departure[2 * row], frame.departure[2 * row + 1] = event, age
            frame.departures = min(frame.departures + 1, MAX_GONE)


@compiled
def _room_for(events, rows, count, most, event, age):
    """Make room for a row among sorted ones, by age and id, of which `most` are kept; return its place, or NONE."""
    width, at = rows.size // most, count
    while at > 0:
        other_age, other = rows[width * at - 1], rows[width * (at - 1)]
        if age > other_age or (age == other_age and events[event].id > events[other].id):
            break
        at -= 1
    if at == most:
        return NONE
    for later in range(min(count, most - 1), at, -1):
        for field in range(width):
            rows[width * later + field] = rows[width * (later - 1) + field]
    return at


@compiled
def active(agent, beliefs, events):
    """Write where the events believed present are in `places` to `sorted`, by their ids; return their number."""
    places, order = beliefs.places[agent.id], beliefs.sorted
    for at in range(agent.places):
        event_id, k = events[places[at].event].id, at
        while k > 0 and events[places[order[k - 1]].event].id > event_id:
            order[k] = order[k - 1]
            k -= 1
        order[k] = at
    return agent.places
