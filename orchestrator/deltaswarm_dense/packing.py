"""MessagePack in a buffer, and the heads of messages in the digest. Each function returns where the next byte goes."""

import numpy as np

from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_wire.digest import HEAD

HEAD_BYTES = HEAD.size


@inlined
def put_unsigned(out, at, value):
    """Write a whole number from 0 on, in its shortest form."""
    if value < 128:
        out[at] = value
        return at + 1
    if value < 256:
        out[at], out[at + 1] = 0xCC, value
        return at + 2
    if value < 65536:
        out[at], out[at + 1], out[at + 2] = 0xCD, value >> 8, value & 255
        return at + 3
    out[at] = 0xCE
    for k in range(4):
        out[at + 1 + k] = (value >> (24 - 8 * k)) & 255
    return at + 5


@compiled
def put_agent(out, at, agent):
    """Write an agent's id, or NOBODY."""
    if agent < 0:
        out[at] = 0xFF
        return at + 1
    return put_unsigned(out, at, agent)


@inlined
def put_float(out, at, value, bits):
    """Write a float; `bits` is one float64 and its view as uint64."""
    bits[0][0] = value
    word = bits[1][0]
    out[at] = 0xCB
    for k in range(8):
        out[at + 1 + k] = (word >> np.uint64(56 - 8 * k)) & np.uint64(255)
    return at + 9


@inlined
def put_array(out, at, count):
    """Write the head of an array."""
    if count < 16:
        out[at] = 0x90 | count
        return at + 1
    out[at], out[at + 1], out[at + 2] = 0xDC, count >> 8, count & 255
    return at + 3


@inlined
def put_bytes(out, at, size):
    """Write the head of so many bytes."""
    if size < 256:
        out[at], out[at + 1] = 0xC4, size
        return at + 2
    out[at], out[at + 1], out[at + 2] = 0xC5, size >> 8, size & 255
    return at + 3


@inlined
def size_of_bytes(size):
    """Return how many bytes `put_bytes` and what follows take."""
    return size + (2 if size < 256 else 3)


@inlined
def size_of_unsigned(value):
    """Return how many bytes `put_unsigned` takes."""
    return 1 if value < 128 else 2 if value < 256 else 3 if value < 65536 else 5


@compiled
def put_text(out, at, text):
    """Write encoded bytes as they are."""
    for k in range(text.size):
        out[at + k] = text[k]
    return at + text.size


@inlined
def put_head(out, at, step, agent, kind, size):
    """Write the head of a message in the digest (`deltaswarm_wire.digest`)."""
    for k in range(4):
        out[at + k] = (step >> (8 * k)) & 255
        out[at + 7 + k] = (size >> (8 * k)) & 255
    out[at + 4], out[at + 5], out[at + 6] = agent & 255, agent >> 8, kind
    return at + HEAD_BYTES
