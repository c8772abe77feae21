"""What agents hear: frames in reach, or those that the air's models let through (`core/agent_core.Receiver`)."""

from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.layout import NONE
from deltaswarm_wire.messages import FRAME_ROOM_BYTES, MAX_SENSED, SENSED_BYTES
from deltaswarm_world.core.world import HEARD_BYTES

SENDER, SLOT = range(2)
"""Columns of a frame's place among the kept ones."""

COUNTER, STEP = range(2)
"""Columns of what a receiver remembers of a sender."""


@inlined
def slot_of(air, step):
    """Return where the frames of a step are kept."""
    return step % air.frames.shape[0]


@inlined
def heard_of(air, sender):
    """Return the frame that the present agent hears of a sender."""
    return air.frames[air.slots[sender], sender]


@inlined
def hear(settings, agent, agents, air, now):
    """Write the frames of the step before within radio range of an agent to `arrived`, unless they are lost.

    Return their number, and that of the lost ones.
    """
    count, lost, slot = 0, 0, slot_of(air, now - 1)
    for k in range(air.senders[agents.size]):
        other = agents[air.senders[k]]
        dx, dy = agent.x_m - other.x_m, agent.y_m - other.y_m
        if dx * dx + dy * dy <= settings.range_m2 and other.id != agent.id:
            if settings.loss > 0.0:
                air.drawn[0] += 1
                if air.draws[air.drawn[0] - 1] < settings.loss:
                    lost += 1
                    continue
            air.arrived[count, SENDER], air.arrived[count, SLOT] = other.id, slot
            count += 1
    return count, lost


@inlined
def has_room(sensed, arrived, frames):
    """Return whether all that an agent senses and hears fits into its frame; the world would cut the rest."""
    room_bytes = FRAME_ROOM_BYTES - SENSED_BYTES * sensed.size
    for k in range(arrived.shape[0]):
        room_bytes -= frames[arrived[k, SLOT], arrived[k, SENDER]].size_bytes + HEARD_BYTES
    return sensed.size <= MAX_SENSED and room_bytes >= 0


@compiled
def drop_old(settings, agent, air, arrived, now):
    """Keep the frames that are newer than those already heard of their senders; return their number."""
    count = 0
    for k in range(arrived.shape[0]):
        sender, slot = arrived[k, SENDER], arrived[k, SLOT]
        counter, known = air.frames[slot, sender].counter, air.newest[agent.id, sender]
        if counter > known[COUNTER] or now - known[STEP] > settings.forget_sender:
            known[COUNTER], known[STEP] = counter, now
            arrived[count, SENDER], arrived[count, SLOT] = sender, slot
            count += 1
    return count


@inlined
def read(air, arrived):
    """Note the newest frame of each sender that does more than relay commands, in `heard`; return their number."""
    count = 0
    for k in range(arrived.shape[0]):
        sender, slot = arrived[k, SENDER], arrived[k, SLOT]
        if air.frames[slot, sender].kind != NONE:
            air.slots[sender] = slot
            if count == 0 or air.heard[count - 1] != sender:
                air.heard[count] = sender
                count += 1
    return count


@inlined
def note_senders(agents, air, now):
    """Note who sent a frame in this step."""
    senders, slot = 0, slot_of(air, now)
    for i in range(agents.size):
        if air.frames[slot, i].size_bytes > 0:
            air.senders[senders] = i
            senders += 1
    air.senders[agents.size] = senders
