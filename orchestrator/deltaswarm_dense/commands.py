"""The operator's orders: relayed (`core/commands.py` of the agent) and obeyed (`controllers/paper/commands.py`).

Covered are orders to all agents that set delta, the structure or the price.
"""

from deltaswarm_dense.bandit import take_arm, update_arms
from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.delta import BANDIT, FIXED, LEARNED
from deltaswarm_dense.hearing import SENDER, SLOT
from deltaswarm_dense.layout import FORGOTTEN, KNOWN_COMMAND, NONE, UNKNOWN
from deltaswarm_dense.packing import put_array, put_bytes, put_unsigned, size_of_bytes, size_of_unsigned
from deltaswarm_dense.states import TAKEN_OFF, change
from deltaswarm_wire.envelope import ITEM_BYTES, MAX_COMMANDS
from deltaswarm_wire.operator_messages import DONE, HEARD, MAX_ANSWERS, REFUSED, SUPERSEDED


@compiled
def hear_commands(swarm, agent, now, arrived):
    """Take the commands that frames relay, then those of the base; write the new ones to `new`, and their number."""
    commands, frames, count = swarm.commands, swarm.air.frames, 0
    for k in range(arrived.shape[0]):
        frame = frames[arrived[k, SLOT], arrived[k, SENDER]]
        for item in range(frame.items):
            count = _accept(swarm, agent, now, frame.item[2 * item], frame.item[2 * item + 1], count)
    if commands.reached[agent.id]:
        for item in range(commands.base[commands.base.size - 1]):
            count = _accept(swarm, agent, now, commands.base[2 * item], commands.base[2 * item + 1], count)
    commands.new[commands.new.size - 1] = count


@compiled
def _accept(swarm, agent, now, number, left_steps, count):
    commands, settings = swarm.commands, swarm.settings[0]
    relay = commands.relays[agent.id, number]
    if left_steps == 0 or relay.standing == FORGOTTEN:
        return count
    if relay.standing == UNKNOWN:
        relay.standing, relay.state = KNOWN_COMMAND, HEARD
        relay.latest_end, relay.ends = now + commands.given[number].life, NONE
        agent.knows += 1
    ends = min(now + left_steps, relay.latest_end)
    if ends <= relay.ends:
        return count
    relay.ends, relay.send_at, relay.interval = ends, now, settings.first_interval
    if relay.state == HEARD:
        commands.new[count] = number
        return count + 1
    return count


@compiled
def obey(swarm, agent, now):
    """Carry out the new commands, unless a later one, heard before, has done so (`_restructure`)."""
    commands, settings = swarm.commands, swarm.settings[0]
    for k in range(commands.new[commands.new.size - 1]):
        number = commands.new[k]
        command, relay = commands.given[number], commands.relays[agent.id, number]
        if not settings.has_delta or (command.sets_price and not (settings.learns or settings.tries)):
            relay.state = REFUSED
        elif number < agent.strategy_command:
            relay.state = SUPERSEDED
        else:
            if settings.tries and command.sets_price != (agent.rule == BANDIT):
                update_arms(settings, agent, now)
            agent.strategy_command, agent.attends = number, agent.attends or agent.rule >= LEARNED
            if command.sets_price:
                agent.price_s, agent.rule, agent.attends = command.price_s, LEARNED, True
                if settings.tries:
                    agent.rule = BANDIT
                    take_arm(agent)
            else:
                agent.rule, agent.founds_at = FIXED, command.delta + (agent.rank < command.fraction)
            if command.sets_share:
                agent.attends = agent.rank < command.share
            if not agent.attends and agent.target != NONE:
                change(settings, agent, now, TAKEN_OFF)
            relay.state = DONE


@compiled
def relay_commands(swarm, agent, frame, now, room_bytes):
    """Write the commands that this step's frame relays, newest first (`CommandRelay.due`).

    Return the next step in which there is something to relay, NONE if there is none.
    """
    commands, settings = swarm.commands, swarm.settings[0]
    wake, is_full = NONE, False
    for number in range(commands.sent[0] - 1, -1, -1):
        relay = commands.relays[agent.id, number]
        if relay.standing != KNOWN_COMMAND:
            continue
        if relay.ends <= now - settings.answered:
            relay.standing = FORGOTTEN
            agent.knows -= 1
            continue
        if relay.ends <= now + 1:
            continue
        if relay.send_at <= now and not is_full:
            room_bytes -= _item_size(commands, number, relay.ends - now - 1) + ITEM_BYTES
            is_full = room_bytes < 0 or frame.items == MAX_COMMANDS
            if not is_full:
                frame.item[2 * frame.items], frame.item[2 * frame.items + 1] = number, relay.ends - now - 1
                frame.items += 1
                relay.send_at = now + relay.interval
                relay.interval = min(2 * relay.interval, settings.longest_interval)
        if wake == NONE or relay.send_at < wake:
            wake = relay.send_at
    return wake if wake == NONE else max(now + 1, wake)


@inlined
def _item_size(commands, number, left_steps):
    return 1 + size_of_unsigned(left_steps) + size_of_bytes(commands.given[number].body_bytes) + size_of_bytes(0)


@compiled
def write_items(out, at, commands, frame):
    """Write the commands that a frame relays (`encode_relayed`)."""
    at = put_array(out, at, frame.items)
    for item in range(frame.items):
        number, left_steps = frame.item[2 * item], frame.item[2 * item + 1]
        at = put_bytes(out, at, _item_size(commands, number, left_steps))
        at = put_unsigned(out, put_array(out, at, 3), left_steps)
        size = commands.given[number].body_bytes
        at = put_bytes(out, at, size)
        for k in range(size):
            out[at + k] = commands.bodies[number, k]
        at = put_bytes(out, at + size, 0)
    return at


@compiled
def write_answers(out, at, commands, agent):
    """Write the states of the newest commands that an agent knows, as many as fit (`CommandRelay.answers`)."""
    skipped, count = agent.knows - min(agent.knows, MAX_ANSWERS), commands.sent[0]
    at = put_array(out, at, 2 * min(agent.knows, MAX_ANSWERS))
    for number in range(count):
        relay = commands.relays[agent.id, number]
        if relay.standing == KNOWN_COMMAND:
            if skipped > 0:
                skipped -= 1
            else:
                at = put_unsigned(out, put_unsigned(out, at, number), relay.state)
    return at
