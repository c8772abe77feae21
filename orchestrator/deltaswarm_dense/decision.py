"""What an agent does in a step, by its state: motion, observed events, frame, report, act (`paper/decision.py`)."""

import numpy as np

from deltaswarm_agent.controllers.paper.frames import ATTENDING as ATTENDING_FRAME
from deltaswarm_agent.controllers.paper.frames import LEAVING as LEAVING_FRAME
from deltaswarm_agent.controllers.paper.frames import MEMBER as MEMBER_FRAME
from deltaswarm_agent.controllers.paper.frames import RELOCATING as RELOCATING_FRAME
from deltaswarm_dense.bandit import count_message, tell_arm
from deltaswarm_dense.baseline import nearest_sensed
from deltaswarm_dense.beliefs import active, departures, sightings, to_cm
from deltaswarm_dense.commands import write_answers
from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.delta import delta_of
from deltaswarm_dense.experience import note_report
from deltaswarm_dense.finds import tell_averages
from deltaswarm_dense.hearing import slot_of
from deltaswarm_dense.layout import NONE, ORDER_FIELDS
from deltaswarm_dense.membership import level_of, parent_of, table_of
from deltaswarm_dense.packing import (
    HEAD_BYTES,
    put_agent,
    put_array,
    put_float,
    put_head,
    put_text,
    put_unsigned,
)
from deltaswarm_dense.states import (
    ATTENDING,
    ATTENDING_ROLE,
    FREE_ROLE,
    GOING,
    LEAVING_ROLE,
    MEMBER_ROLE,
    ORPHAN,
    ORPHAN_ROLE,
    RELOCATING,
    RELOCATING_ROLE,
    ROLES,
    ROOT,
    ROOT_ROLE,
    WALKING,
)
from deltaswarm_dense.walk import towards, walk
from deltaswarm_wire.codec import PROTOCOL_VERSION
from deltaswarm_wire.digest import ACT, REPORT
from deltaswarm_wire.messages import ACT_ITEMS, MAX_POSES
from deltaswarm_wire.operator_messages import MAX_MEMBERS, MAX_REPORTED


def _text(text: bytes) -> np.ndarray:
    return np.frombuffer(text, np.uint8)


ROLE_BYTES = np.zeros((len(ROLES), 16), np.uint8)
ROLE_SIZES = np.array([1 + len(role) for role in ROLES])
for _k, _role in enumerate(ROLES):
    ROLE_BYTES[_k, : 1 + len(_role)] = _text(bytes([0xA0 | len(_role)]) + _role.encode())

REPORT_BEGINS = _text(b"\xa1v" + bytes([PROTOCOL_VERSION]) + b"\xa5agent")
SEQUENCE, STEP, ROLE, X, Y = map(_text, (b"\xa8sequence", b"\xa4step", b"\xa4role", b"\xa3x_m", b"\xa3y_m"))
FOLLOWERS, EVENTS, MEMBERS = map(_text, (b"\xa9followers", b"\xa6events", b"\xa7members"))
ANSWERS, DELTA = map(_text, (b"\xa7answers", b"\xa5delta"))
REPORT_ITEMS = 9
"""Items of a report without members, answers and delta."""


@inlined
def motion(settings, agent, now):
    """Return the velocity, and the step until which it holds in any case."""
    if agent.state == WALKING:
        return walk(settings, agent, now)
    if agent.state == GOING and agent.target != NONE:
        vx_mps, vy_mps = towards(settings, agent, agent.target_x_m, agent.target_y_m)
        return vx_mps, vy_mps, now + 1
    if agent.state == RELOCATING:
        vx_mps, vy_mps = towards(settings, agent, agent.goal_x_m, agent.goal_y_m)
        return vx_mps, vy_mps, now + 1
    return 0.0, 0.0, now + 1


@inlined
def observe(settings, agent, events, observed, sensed):
    """Write the events that this agent works on to `observed`; return their number."""
    if sensed.size == 0 or agent.state in (WALKING, GOING, RELOCATING):
        return 0
    if agent.state == ATTENDING:
        observed[0] = agent.target
        return 1
    if not settings.observes_all:
        observed[0] = nearest_sensed(settings, agent, events, sensed)
        return 1
    for k in range(sensed.size):
        observed[k] = sensed[k]
    return sensed.size


@compiled
def compose(swarm, agent, now, score):
    """Write the agent's frame of this step, of kind NONE if it sends nothing."""
    frame = swarm.air.frames[slot_of(swarm.air, now), agent.id]
    frame.kind, frame.items = NONE, 0
    if not agent.in_tree and agent.state != ATTENDING and agent.leave_frames_left == 0:
        return
    frame.x_cm, frame.y_cm = to_cm(agent.x_m), to_cm(agent.y_m)
    if swarm.settings[0].has_finds and agent.state != RELOCATING:
        tell_averages(swarm.settings[0], agent, frame, now)
        if swarm.settings[0].tries:
            tell_arm(swarm.settings[0], agent, frame, now)
    if agent.state == RELOCATING:
        frame.kind = RELOCATING_FRAME
    elif agent.in_tree:
        frame.kind = MEMBER_FRAME
        frame.orphan = agent.state == ORPHAN
        frame.path_length = agent.path_length
        for k in range(agent.path_length):
            frame.path[k] = agent.path[k]
        frame.pulse, frame.score = agent.pulse, score
        frame.rows = table_of(agent, swarm.trees, swarm.air.tables[slot_of(swarm.air, now), agent.id])
        sightings(agent, swarm.beliefs, swarm.world.events, now, frame)
        departures(agent, swarm.beliefs, swarm.world.events, now, frame)
        frame.has_order = agent.has_order
        for k in range(ORDER_FIELDS):
            frame.order[k] = agent.order[k]
    elif agent.leave_frames_left > 0:
        agent.leave_frames_left -= 1
        frame.kind = LEAVING_FRAME
    else:
        frame.kind = ATTENDING_FRAME
        frame.event = agent.target
        frame.event_x_cm, frame.event_y_cm = to_cm(agent.target_x_m), to_cm(agent.target_y_m)


@inlined
def role_of(agent, frame):
    """Return the agent's role; silent agents are free."""
    if frame.kind == MEMBER_FRAME:
        return ORPHAN_ROLE if frame.orphan else MEMBER_ROLE if level_of(agent) else ROOT_ROLE
    if frame.kind == RELOCATING_FRAME:
        return RELOCATING_ROLE
    if frame.kind == ATTENDING_FRAME:
        return ATTENDING_ROLE
    return LEAVING_ROLE if frame.kind == LEAVING_FRAME else FREE_ROLE


@compiled
def report(swarm, agent, now, time_s):
    """Write the report that is due, if there is something to report; return whether there is one."""
    settings, frame, events = swarm.settings[0], swarm.air.frames[slot_of(swarm.air, now), agent.id], swarm.world.events
    attends = agent.state == ATTENDING and agent.target != NONE
    is_of_tree = agent.state == ROOT and agent.places > 0 and frame.kind == MEMBER_FRAME
    finds = 0 if agent.in_tree or not settings.report_finds else swarm.news.new[swarm.news.new.size - 1]
    found = swarm.news.new[:finds]
    if (attends or is_of_tree) and time_s >= agent.report_due_s - 1e-9:
        in_turn_s = agent.report_due_s + settings.report_every_s
        agent.report_due_s = in_turn_s if in_turn_s > time_s + 1e-9 else time_s + settings.report_every_s
    elif found.size:
        attends = is_of_tree = False
    else:
        return False, False
    followers, is_news = frame.rows if is_of_tree else 0, False
    members = min(followers, MAX_MEMBERS) if settings.report_members else 0
    delta = max(delta_of(agent), 0)
    out, bits, begins = swarm.output.operator, swarm.output.bits, swarm.output.ends[1]
    out[begins + HEAD_BYTES] = 0x80 | (REPORT_ITEMS + (members > 0) + (agent.knows > 0) + (delta > 0))
    at = put_unsigned(out, put_text(out, begins + HEAD_BYTES + 1, REPORT_BEGINS), agent.id)
    at = put_unsigned(out, put_text(out, at, SEQUENCE), agent.sequence)
    at = put_unsigned(out, put_text(out, at, STEP), now)
    at = put_text(out, at, ROLE)
    at = put_text(out, at, ROLE_BYTES[agent.role, : ROLE_SIZES[agent.role]])
    at = put_float(out, put_text(out, at, X), agent.x_m, bits)
    at = put_float(out, put_text(out, at, Y), agent.y_m, bits)
    at = put_unsigned(out, put_text(out, at, FOLLOWERS), followers)
    at = put_text(out, at, EVENTS)
    if is_of_tree:
        count, order = active(agent, swarm.beliefs, events), swarm.beliefs.sorted
        at = put_array(out, at, min(count, MAX_REPORTED))
        for k in range(min(count, MAX_REPORTED)):
            place = swarm.beliefs.places[agent.id, order[k]]
            at = put_unsigned(out, put_array(out, at, 3), events[place.event].id)
            at = put_float(out, put_float(out, at, place.x_cm / 100, bits), place.y_cm / 100, bits)
            is_news |= _tell(events[place.event], time_s)
    else:
        at, is_news = _write_found(agent, swarm.output, at, events, time_s, attends, found)
    if members:
        at = put_array(out, put_text(out, at, MEMBERS), 4 * members)
        for row in range(members):
            for field in range(4):
                at = put_unsigned(out, at, swarm.air.tables[slot_of(swarm.air, now), agent.id, row, field])
    if agent.knows:
        at = write_answers(out, put_text(out, at, ANSWERS), swarm.commands, agent)
    if delta:
        at = put_unsigned(out, put_text(out, at, DELTA), delta)
    swarm.output.ends[1] = at
    put_head(out, begins, now, agent.id, REPORT, at - begins - HEAD_BYTES)
    agent.sequence += 1
    if settings.learns:
        note_report(settings, agent, now)
    if settings.tries:
        count_message(settings, agent, now)
    return True, is_news


@compiled
def _write_found(agent, output, at, events, time_s, attends, found):
    """Write the event that an agent attends to, if it does, and the others that it has come upon."""
    out, bits, count, is_news = output.operator, output.bits, 1 if attends else 0, False
    for k in range(found.size):
        count += not (attends and found[k] == agent.target)
    at = put_array(out, at, min(count, MAX_REPORTED))
    if attends:
        at = put_unsigned(out, put_array(out, at, 3), events[agent.target].id)
        at = put_float(out, put_float(out, at, agent.target_x_m, bits), agent.target_y_m, bits)
        is_news |= _tell(events[agent.target], time_s)
    written = 1 if attends else 0
    for k in range(found.size):
        event = events[found[k]]
        if not (attends and found[k] == agent.target) and written < MAX_REPORTED:
            at = put_unsigned(out, put_array(out, at, 3), event.id)
            at = put_float(out, put_float(out, at, event.x_m, bits), event.y_m, bits)
            is_news |= _tell(event, time_s)
            written += 1
    return at, is_news


@compiled
def _tell(event, time_s):
    """Note that the operator is told of an event; return whether for the first time."""
    is_news = np.isnan(event.told_s)
    if is_news:
        event.told_s = time_s
    return is_news


@inlined
def act(swarm, agent, now, velocity_mps, until, observed):
    """Write the act that closes the step."""
    frame, output = swarm.air.frames[slot_of(swarm.air, now), agent.id], swarm.output
    out, begins = output.world, output.ends[0]
    at = put_array(out, begins + HEAD_BYTES, ACT_ITEMS)
    at = put_unsigned(out, put_unsigned(out, at, PROTOCOL_VERSION), now)
    at = put_float(out, put_float(out, at, velocity_mps[0], output.bits), velocity_mps[1], output.bits)
    at = put_array(out, at, observed)
    for k in range(observed):
        at = put_unsigned(out, at, swarm.world.events[swarm.world.observed[k]].id)
    at = put_text(out, at, ROLE_BYTES[agent.role, : ROLE_SIZES[agent.role]])
    is_member = frame.kind == MEMBER_FRAME
    level = level_of(agent) if is_member else 0
    at = put_unsigned(out, at, level)
    at = put_agent(out, at, parent_of(agent) if level else NONE)
    at = put_agent(out, at, agent.path[0] if is_member or frame.kind == RELOCATING_FRAME else NONE)
    agent.delta = max(delta_of(agent), 0)
    at = put_unsigned(out, at, agent.delta)
    at = put_unsigned(out, at, min(until, now + MAX_POSES))
    output.ends[0] = at
    put_head(out, begins, now, agent.id, ACT, at - begins - HEAD_BYTES)
