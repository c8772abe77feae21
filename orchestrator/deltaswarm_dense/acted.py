"""Runs in arrays whose agents are moved from outside: what a learning environment does (`deltaswarm_learn`).

A step takes an action of each agent (`vectors.ACTION`, then the numbers of its broadcast), and gives observations
(`vectors.observation_shapes`) and the numbers of rewards (`rewards.REWARDS`), in their orders.
"""

from typing import NamedTuple

import numpy as np

from deltaswarm_dense.arithmetic import distance_m, rounded
from deltaswarm_dense.compiled import compiled, entry, inlined
from deltaswarm_dense.decision import (
    EVENTS,
    FOLLOWERS,
    REPORT_BEGINS,
    REPORT_ITEMS,
    ROLE,
    ROLE_BYTES,
    ROLE_SIZES,
    SEQUENCE,
    STEP,
    X,
    Y,
)
from deltaswarm_dense.hearing import SENDER, SLOT, has_room, hear, note_senders, slot_of
from deltaswarm_dense.layout import FRAME_ROOM, FRAME_SIZE, NONE, World, record
from deltaswarm_dense.packing import (
    HEAD_BYTES,
    put_agent,
    put_array,
    put_bytes,
    put_float,
    put_head,
    put_text,
    put_unsigned,
)
from deltaswarm_dense.states import ATTENDING_ROLE, FREE_ROLE
from deltaswarm_dense.step import arrive, command, move, sense_events, work
from deltaswarm_wire.codec import MAX_RADIO_BYTES, PROTOCOL_VERSION
from deltaswarm_wire.digest import ACT, RADIO, REPORT
from deltaswarm_wire.messages import ACT_ITEMS
from deltaswarm_wire.operator_messages import MAX_REPORTED

FULL_SCALE = 32_767
"""As in `vectors`."""

HOUR_S = 3600.0
EAST, NORTH, ATTENDS, SPEAKS, REPORTS, MESSAGE = range(6)
OWN_NUMBERS, EVENT_NUMBERS = 5, 3
TOLD, SENSED, WORKED, COMPLETED, UNTOLD, OPEN, MESSAGES, FRAMES, BYTES = range(9)

SETTINGS = record(
    "step_s width_m height_m speed_mps sensing_range_m sensing_m2 range_m2 work_agent_s loss horizon_s half",
    "event_slots frame_slots",
)
AGENT = record("x_m y_m vx_mps vy_mps", "id counter sequence near", "sees")
"""A body, and the number of events that it senses, its `near` ones in `Acted.near`."""

FRAME = record(whole="size_bytes")


class Broadcasts(NamedTuple):
    """The radio frames of two steps; the names are those of `layout.Air`. Numbers of broadcasts are whole."""

    frames: np.ndarray
    """(2, n) FRAME"""
    messages: np.ndarray
    """(2, n, m)"""
    senders: np.ndarray
    arrived: np.ndarray
    draws: np.ndarray
    drawn: np.ndarray


class Acted(NamedTuple):
    """One run: n agents, e events."""

    settings: np.ndarray
    agents: np.ndarray
    world: World
    air: Broadcasts
    near: np.ndarray
    """(n, s) events that each agent senses, the nearest first."""
    untold: np.ndarray
    """(e,) whether an event waits to be told, for no longer than the horizon."""
    followed: np.ndarray
    """(2,) arrived events that are in `untold`; events that are newly sensed."""
    buffers: tuple[np.ndarray, np.ndarray]
    """Bytes of acts and frames, and of reports, in a step."""
    ends: np.ndarray
    bits: tuple[np.ndarray, np.ndarray]
    trouble: np.ndarray


@compiled
def _by_distance(agent, world, near, sensed):
    """Write the sensed events to `near` by distance, then id."""
    for k in range(sensed.size):
        number, at = sensed[k], k
        event = world.events[number]
        far_m = distance_m(event.x_m, event.y_m, agent.x_m, agent.y_m)
        while at > 0:
            other = world.events[near[at - 1]]
            other_m = distance_m(other.x_m, other.y_m, agent.x_m, agent.y_m)
            if other_m < far_m or (other_m == far_m and other.id < event.id):
                break
            near[at] = near[at - 1]
            at -= 1
        near[at] = number
    agent.near = sensed.size


@inlined
def _observe(acted, agent, arrived, time_s, out):
    """Write what an agent senses and hears (`VectorCoding.observation`)."""
    settings, events = acted.settings[0], acted.world.events
    out[:] = 0.0
    out[0], out[1], out[2] = 1.0, 1.0, time_s / HOUR_S
    out[3], out[4] = 2.0 * agent.x_m / settings.width_m - 1.0, 2.0 * agent.y_m / settings.height_m - 1.0
    at = OWN_NUMBERS
    for k in range(min(agent.near, settings.event_slots)):
        event = events[acted.near[agent.id, k]]
        out[at] = 1.0
        out[at + 1] = (event.x_m - agent.x_m) / settings.sensing_range_m
        out[at + 2] = (event.y_m - agent.y_m) / settings.sensing_range_m
        at += EVENT_NUMBERS
    at, size = OWN_NUMBERS + EVENT_NUMBERS * settings.event_slots, acted.air.messages.shape[2]
    first = 0
    while first < arrived.shape[0] and arrived[first, SENDER] < agent.id:
        first += 1
    for k in range(min(arrived.shape[0], settings.frame_slots)):
        row = arrived[(first + k) % arrived.shape[0]]
        out[at] = 1.0
        for m in range(size):
            out[at + 1 + m] = acted.air.messages[row[SLOT], row[SENDER], m] / FULL_SCALE
        at += 1 + size
    for k in range(out.size):
        out[k] = min(max(out[k], np.float32(-1.0)), np.float32(1.0))


@compiled
def _begin(acted, now, observations):
    """Begin a step: bodies move, events arrive, agents sense and hear."""
    settings, agents, world, air = acted.settings[0], acted.agents, acted.world, acted.air
    time_s = now * settings.step_s
    if now > 0:
        move(settings, agents)
    arrive(world, now)
    for i in range(agents.size):
        agent = agents[i]
        sensed = world.sensed[: sense_events(settings, agent, world, time_s)]
        received, _ = hear(settings, agent, agents, air, now)
        arrived = air.arrived[:received]
        if not has_room(sensed, arrived, air.frames):
            acted.trouble[0] = FRAME_ROOM
            return
        _by_distance(agent, world, acted.near[i], sensed)
        _observe(acted, agent, arrived, time_s, observations[i])
    acted.followed[1] = 0
    for k in range(world.active[world.active.size - 1]):
        acted.followed[1] += world.events[world.active[k]].sensed_s == time_s


@compiled
def _send(acted, agent, action, now):
    """Write an agent's broadcast, if it speaks; return its length [bytes]."""
    air, slot, out, begins = acted.air, slot_of(acted.air, now), acted.buffers[0], acted.ends[0]
    frame, message = air.frames[slot, agent.id], air.messages[slot, agent.id]
    frame.size_bytes = 0
    if not action[SPEAKS] > 0.0:
        return 0
    at = put_unsigned(out, put_array(out, begins + HEAD_BYTES, 3), PROTOCOL_VERSION)
    at = put_bytes(out, put_unsigned(out, at, agent.counter), 2 * message.size)
    for m in range(message.size):
        message[m] = rounded(np.float64(action[MESSAGE + m]) * FULL_SCALE)
        out[at], out[at + 1] = message[m] & 255, (message[m] >> 8) & 255
        at += 2
    size = at - begins - HEAD_BYTES
    put_head(out, begins, now, agent.id, RADIO, size)
    acted.ends[0] = at
    agent.counter += 1
    frame.size_bytes = size
    return size


@compiled
def _report(acted, agent, near, role, now, numbers):
    """Write an agent's report of what it senses; count the events that are told."""
    settings, events, out, begins = acted.settings[0], acted.world.events, acted.buffers[1], acted.ends[1]
    out[begins + HEAD_BYTES] = 0x80 | REPORT_ITEMS
    at = put_unsigned(out, put_text(out, begins + HEAD_BYTES + 1, REPORT_BEGINS), agent.id)
    at = put_unsigned(out, put_text(out, at, SEQUENCE), agent.sequence)
    at = put_unsigned(out, put_text(out, at, STEP), now)
    at = put_text(out, put_text(out, at, ROLE), ROLE_BYTES[role, : ROLE_SIZES[role]])
    at = put_float(out, put_text(out, at, X), agent.x_m, acted.bits)
    at = put_float(out, put_text(out, at, Y), agent.y_m, acted.bits)
    at = put_unsigned(out, put_text(out, at, FOLLOWERS), 0)
    told = min(near.size, MAX_REPORTED)
    at = put_array(out, put_text(out, at, EVENTS), told)
    for k in range(told):
        event = events[near[k]]
        at = put_unsigned(out, put_array(out, at, 3), event.id)
        at = put_float(out, put_float(out, at, event.x_m, acted.bits), event.y_m, acted.bits)
        if np.isnan(event.told_s):
            event.told_s = now * settings.step_s
            numbers[TOLD] += acted.untold[near[k]]
    put_head(out, begins, now, agent.id, REPORT, at - begins - HEAD_BYTES)
    acted.ends[1] = at
    agent.sequence += 1


@compiled
def _act(acted, agent, action, now, numbers):
    """Do what an action says (`VectorCoding.decision`)."""
    settings, world = acted.settings[0], acted.world
    near = acted.near[agent.id, : agent.near]
    vx_mps = np.float64(action[EAST]) * settings.speed_mps
    vy_mps = np.float64(action[NORTH]) * settings.speed_mps
    attends = near.size > 0 and action[ATTENDS] > 0.0
    role = ATTENDING_ROLE if attends else FREE_ROLE
    size = _send(acted, agent, action, now)
    if size > MAX_RADIO_BYTES:
        acted.trouble[0] = FRAME_SIZE
    numbers[FRAMES] += size > 0
    numbers[BYTES] += size
    if action[REPORTS] > 0.0:
        _report(acted, agent, near, role, now, numbers)
        numbers[MESSAGES] += 1
    out, begins = acted.buffers[0], acted.ends[0]
    at = put_unsigned(out, put_array(out, begins + HEAD_BYTES, ACT_ITEMS), PROTOCOL_VERSION)
    at = put_float(out, put_unsigned(out, at, now), vx_mps, acted.bits)
    at = put_array(out, put_float(out, at, vy_mps, acted.bits), 1 if attends else 0)
    if attends:
        at = put_unsigned(out, at, world.events[near[0]].id)
        world.observers[near[0]] += 1
    at = put_unsigned(out, put_text(out, at, ROLE_BYTES[role, : ROLE_SIZES[role]]), 0)
    at = put_agent(out, put_agent(out, at, NONE), NONE)
    at = put_unsigned(out, put_unsigned(out, at, 0), now + 1)
    put_head(out, begins, now, agent.id, ACT, at - begins - HEAD_BYTES)
    acted.ends[0] = at
    command(settings, agent, vx_mps, vy_mps)


@compiled
def _follow(acted, now):
    """Let arrived events wait to be told."""
    world, time_s = acted.world, now * acted.settings[0].step_s
    while acted.followed[0] < world.arrived[0] and world.events[acted.followed[0]].arrived_s <= time_s:
        acted.untold[acted.followed[0]] = True
        acted.followed[0] += 1


@compiled
def _count(acted, now, numbers):
    """Count what happened to the events in a step (`Tally.count`), and let agents work on them."""
    settings, world = acted.settings[0], acted.world
    time_s, last = now * settings.step_s, world.active.size - 1
    for number in range(acted.followed[0]):
        event = world.events[number]
        is_old = event.arrived_s <= time_s - settings.horizon_s
        acted.untold[number] = acted.untold[number] and not is_old and np.isnan(event.told_s)
        numbers[UNTOLD] += acted.untold[number]
    numbers[UNTOLD] *= settings.step_s
    numbers[SENSED] = acted.followed[1]
    for k in range(world.active[last]):
        number = world.active[k]
        numbers[WORKED] += world.observers[number] > 0 and np.isnan(world.events[number].worked_s)
    completed = world.arrived[1]
    work(settings, world, time_s)
    numbers[COMPLETED] = world.arrived[1] - completed
    numbers[OPEN] = world.active[last] * settings.step_s


@entry
def advance_acted(acted, now, actions, observations, numbers):
    """Do what the actions of step `now` say, and begin the next one; with -1 begin the first."""
    acted.ends[:] = 0
    numbers[:] = 0.0
    if now >= 0:
        _follow(acted, now)
        for i in range(acted.agents.size):
            _act(acted, acted.agents[i], actions[i], now, numbers)
        note_senders(acted.agents, acted.air, now)
        _count(acted, now, numbers)
    if acted.trouble[0] == 0:
        _begin(acted, now + 1, observations)
