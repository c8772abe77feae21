"""Payloads of radio frames, written as `controllers/paper/frames.py` encodes them, and their envelopes."""

from deltaswarm_agent.controllers.paper.frames import ATTENDING, MEMBER
from deltaswarm_dense.bandit import ARM
from deltaswarm_dense.commands import write_items
from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.layout import NONE, ORDER_FIELDS, ROW_FIELDS
from deltaswarm_dense.packing import HEAD_BYTES, put_array, put_bytes, put_head, put_unsigned
from deltaswarm_wire.codec import PROTOCOL_VERSION
from deltaswarm_wire.digest import RADIO

NIL, FALSE, TRUE = 0xC0, 0xC2, 0xC3


@compiled
def write_payload(out, frame, table, events, averages):
    """Write a frame's payload, with averages (1) and with what was tried (2); return its length [bytes]."""
    if frame.tried[ARM] == NONE:
        averages = min(averages, 1)
    items = 11 if frame.kind == MEMBER else 6 if frame.kind == ATTENDING else 3
    at = put_array(out, 0, items + (averages > 0 and items > 3))
    at = put_unsigned(out, at, frame.kind)
    at = put_unsigned(out, at, frame.x_cm)
    at = put_unsigned(out, at, frame.y_cm)
    if frame.kind == ATTENDING:
        at = put_unsigned(out, at, events[frame.event].id)
        at = put_unsigned(out, at, frame.event_x_cm)
        at = put_unsigned(out, at, frame.event_y_cm)
        return _write_averages(out, at, frame, averages) if averages else at
    if frame.kind != MEMBER:
        return at
    out[at] = TRUE if frame.orphan else FALSE
    at = put_array(out, at + 1, frame.path_length - 1)
    for k in range(frame.path_length - 1):
        at = put_unsigned(out, at, frame.path[k])
    at = put_unsigned(out, at, frame.pulse)
    at = put_unsigned(out, at, frame.score)
    at = put_array(out, at, ROW_FIELDS * frame.rows)
    for row in range(frame.rows):
        for field in range(ROW_FIELDS):
            at = put_unsigned(out, at, table[row, field])
    at = _write_known(out, at, frame.sighting, 4, frame.sightings, events)
    at = _write_known(out, at, frame.departure, 2, frame.departures, events)
    if not frame.has_order:
        out[at] = NIL
        at += 1
    else:
        at = put_array(out, at, ORDER_FIELDS)
        for field in range(ORDER_FIELDS):
            at = put_unsigned(out, at, frame.order[field])
    return _write_averages(out, at, frame, averages) if averages else at


@compiled
def _write_averages(out, at, frame, averages):
    at = put_array(out, at, frame.averages.size + averages - 1)
    for k in range(frame.averages.size):
        at = put_unsigned(out, at, frame.averages[k])
    if averages > 1:
        at = put_array(out, at, frame.tried.size)
        for k in range(frame.tried.size):
            at = put_unsigned(out, at, frame.tried[k])
    return at


@compiled
def _write_known(out, at, rows, width, count, events):
    """Write rows that begin with an event."""
    at = put_array(out, at, width * count)
    for row in range(count):
        at = put_unsigned(out, at, events[rows[width * row]].id)
        for field in range(1, width):
            at = put_unsigned(out, at, rows[width * row + field])
    return at


@inlined
def send(agent, frame, length, commands, output, now):
    """Write an agent's frame of this step with its envelope; return its length [bytes], 0 if there is none.

    Its payload is in `output`, with `length` bytes.
    """
    frame.size_bytes = 0
    if frame.kind == NONE and frame.items == 0:
        return 0
    out, begins = output.world, output.ends[0]
    at = put_array(out, begins + HEAD_BYTES, 3 + (frame.items > 0))
    at = put_unsigned(out, at, PROTOCOL_VERSION)
    at = put_unsigned(out, at, agent.counter)
    if frame.kind == NONE:
        out[at] = NIL
        at += 1
    else:
        at = put_bytes(out, at, length)
        for k in range(length):
            out[at + k] = output.payload[k]
        at += length
    if frame.items:
        at = write_items(out, at, commands, frame)
    output.ends[0] = at
    size = output.ends[0] - begins - HEAD_BYTES
    put_head(out, begins, now, agent.id, RADIO, size)
    frame.begins, frame.size_bytes, frame.counter = begins + HEAD_BYTES, size, agent.counter
    agent.counter += 1
    return size
