"""The steps of a run: bodies, arrivals, sensing, the air, every agent that is asked, and work on events."""

import math

import numpy as np

from deltaswarm_agent.core.agent_core import ENVELOPE_BYTES
from deltaswarm_dense.commands import hear_commands, relay_commands
from deltaswarm_dense.compiled import compiled, entry, inlined
from deltaswarm_dense.decision import act, compose, motion, observe, report, role_of
from deltaswarm_dense.frames import send, write_payload
from deltaswarm_dense.hearing import drop_old, has_room, hear, note_senders, read, slot_of
from deltaswarm_dense.layout import BUFFER, FRAME_ROOM, FRAME_SIZE, NONE
from deltaswarm_dense.learning import begin
from deltaswarm_dense.measures import measure
from deltaswarm_dense.one_step import decide
from deltaswarm_dense.randomness import seed
from deltaswarm_wire.codec import MAX_RADIO_BYTES
from deltaswarm_wire.messages import MAX_POSES

BYTES_PER_AGENT = 20_000
"""Room for what an agent says in a step."""


@inlined
def move(settings, agents):
    """Move bodies by one step; the arena's edge stops them (`dynamics.Points.move`)."""
    for i in range(agents.size):
        agent = agents[i]
        agent.x_m = min(max(agent.x_m + agent.vx_mps * settings.step_s, 0.0), settings.width_m)
        agent.y_m = min(max(agent.y_m + agent.vy_mps * settings.step_s, 0.0), settings.height_m)


@compiled
def arrive(world, now):
    """Let the events of this step arrive."""
    last = world.active.size - 1
    while world.arrived[0] < world.events.size and world.events[world.arrived[0]].step <= now:
        world.active[world.active[last]] = world.arrived[0]
        world.active[last] += 1
        world.arrived[0] += 1


@inlined
def sense_events(settings, agent, world, time_s):
    """Write the events within an agent's sensing range to `sensed`; return their number.

    Note when an event is first sensed.
    """
    count = 0
    if not agent.sees:
        return count
    for k in range(world.active[world.active.size - 1]):
        event = world.events[world.active[k]]
        dx, dy = agent.x_m - event.x_m, agent.y_m - event.y_m
        if dx * dx + dy * dy <= settings.sensing_m2:
            world.sensed[count] = world.active[k]
            count += 1
            if np.isnan(event.sensed_s):
                event.sensed_s = time_s
    return count


@inlined
def work(settings, world, time_s):
    """Let each event's observers work on it for one step; complete finished events (`Environment.work`)."""
    last, kept = world.active.size - 1, 0
    for k in range(world.active[last]):
        number = world.active[k]
        event, observers = world.events[number], world.observers[number]
        world.observers[number] = 0
        if observers:
            if np.isnan(event.worked_s):
                event.worked_s = time_s
            event.work_agent_s += observers * settings.step_s
            if event.work_agent_s >= settings.work_agent_s - 1e-9:
                event.completed_s = time_s
                world.arrived[1] += 1
                continue
        world.active[kept] = number
        kept += 1
    world.active[last] = kept


@inlined
def command(settings, agent, vx_mps, vy_mps):
    """Set an agent's velocity, cut to the speed limit (`Environment.command`)."""
    speed = math.pow(vx_mps * vx_mps + vy_mps * vy_mps, settings.half)
    if speed > settings.speed_mps:
        vx_mps, vy_mps = vx_mps * settings.speed_mps / speed, vy_mps * settings.speed_mps / speed
    agent.vx_mps, agent.vy_mps = vx_mps, vy_mps


@inlined
def step_agent(swarm, agent, now, time_s, sensed, heard):
    """Let an agent decide; write what it says. Return if it reports, and news; its frame's bytes; refused claims."""
    settings, world = swarm.settings[0], swarm.world
    decide(swarm, agent, now, sensed, heard)
    vx_mps, vy_mps, until = motion(settings, agent, now)
    observed = observe(settings, agent, world.events, world.observed, sensed)
    if settings.has_finds:
        begin(settings, agent, observed > 0, now)
    compose(swarm, agent, now, sensed.size)
    frame, length = swarm.air.frames[slot_of(swarm.air, now), agent.id], 0
    if frame.kind != NONE:
        until = now + 1
        table = swarm.air.tables[slot_of(swarm.air, now), agent.id]
        length = write_payload(swarm.output.payload, frame, table, world.events, settings.has_finds + settings.tries)
    if agent.knows:
        wake = relay_commands(swarm, agent, frame, now, MAX_RADIO_BYTES - ENVELOPE_BYTES - length)
        if wake != NONE:
            until = min(until, wake)
    agent.role = role_of(agent, frame)
    reports, is_news = report(swarm, agent, now, time_s)
    size = send(agent, frame, length, swarm.commands, swarm.output, now)
    act(swarm, agent, now, (vx_mps, vy_mps), until, observed)
    command(settings, agent, vx_mps, vy_mps)
    agent.until = min(until, now + MAX_POSES)
    return reports, is_news, size, observed - claim(world, observed, sensed)


@inlined
def claim(world, observed, sensed):
    """Count the agent among the observers of those events that it works on and senses; return their number."""
    claims = 0
    for k in range(observed):
        for s in range(sensed.size):
            if sensed[s] == world.observed[k]:
                world.observers[world.observed[k]] += 1
                claims += 1
                break
    return claims


@inlined
def silence(agent, air, now):
    """Let an agent say nothing in this step."""
    frame = air.frames[slot_of(air, now), agent.id]
    frame.kind, frame.size_bytes = NONE, 0


@inlined
def note_places(settings, agents, trail_m, now):
    """Note where everybody is in this step."""
    for i in range(agents.size):
        trail_m[now % settings.trail, i, 0], trail_m[now % settings.trail, i, 1] = agents[i].x_m, agents[i].y_m


@entry
def advance(swarm, first, steps, all_steps, counts, keys):
    """Do `steps` steps from `first` on; add their bytes to the buffers of both digests. Return those done.

    `keys` seed the generator of each agent in each step (`branching.keys_of`); none: they draw on.

    It ends early when a buffer is full or all draws are used, and with `swarm.trouble` when the run cannot go on here.
    """
    settings, agents, world = swarm.settings[0], swarm.agents, swarm.world
    air, output, commands = swarm.air, swarm.output, swarm.commands
    room = agents.size * BYTES_PER_AGENT
    for done in range(steps):
        if output.ends[0] + room > output.world.size or output.ends[1] + room > output.operator.size:
            if done == 0:
                swarm.trouble[0] = BUFFER
            return done
        if settings.loss > 0.0 and air.drawn[0] + agents.size * agents.size > air.draws.size:
            return done
        now = first + done
        time_s, is_last = now * settings.step_s, now == all_steps - 1
        count = counts[done]
        count.asked = count.frames_sent = count.bytes_sent = count.frames_received = count.reports = count.news = 0
        count.refused_claims = count.frames_lost = 0
        if now > 0 and not settings.is_modelled:
            move(settings, agents)
        arrive(world, now)
        for i in range(agents.size):
            agent = agents[i]
            if not agent.takes_part:
                agent.sensed_before = agent.has_status = False
                silence(agent, air, now)
                continue
            sensed = world.sensed[: sense_events(settings, agent, world, time_s)]
            if settings.is_modelled:
                arrived = air.carried[air.begins[i] : air.begins[i + 1]]
            else:
                received, lost = hear(settings, agent, agents, air, now)
                arrived = air.arrived[:received]
                count.frames_lost += lost
            count.frames_received += arrived.shape[0]
            has_news = sensed.size > 0 or arrived.shape[0] > 0 or agent.sensed_before or commands.reached[i]
            agent.sensed_before = sensed.size > 0
            if not (has_news or is_last or settings.ask_every_step or agent.until <= now):
                silence(agent, air, now)
                continue
            if not has_room(sensed, arrived, air.frames):
                swarm.trouble[0] = FRAME_ROOM
                return done
            if settings.is_modelled:
                arrived = arrived[: drop_old(settings, agent, air, arrived, now)]
            if commands.sent[0]:
                hear_commands(swarm, agent, now, arrived)
            heard = air.heard[: read(air, arrived)]
            if keys.shape[0] > 0:
                seed(agent, keys[done, i])
            count.asked += 1
            reports, is_news, size, refused = step_agent(swarm, agent, now, time_s, sensed, heard)
            agent.has_status = True
            if size > MAX_RADIO_BYTES:
                swarm.trouble[0] = FRAME_SIZE
            if swarm.trouble[0]:
                return done
            count.reports += reports
            count.news += is_news
            count.refused_claims += refused
            count.frames_sent += size > 0
            count.bytes_sent += size
        commands.reached[:] = False
        note_senders(agents, air, now)
        note_places(settings, agents, swarm.trail_m, now)
        measure(settings, agents, swarm.measures, count, now)
        work(settings, world, time_s)
        count.events_open, count.events_completed = world.active[world.active.size - 1], world.arrived[1]
        count.world_end, count.operator_end = output.ends[0], output.ends[1]
    return steps
