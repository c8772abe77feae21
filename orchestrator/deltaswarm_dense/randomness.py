"""Python's `random.Random`, one generator per agent: the Mersenne Twister in arrays."""

import math

import numpy as np

from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.layout import WORDS


@compiled
def _twist(words):
    for k in range(WORDS):
        y = (words[k] & np.uint32(0x80000000)) | (words[(k + 1) % WORDS] & np.uint32(0x7FFFFFFF))
        v = words[(k + 397) % WORDS] ^ (y >> np.uint32(1))
        if y & np.uint32(1):
            v ^= np.uint32(0x9908B0DF)
        words[k] = v


@compiled
def _word(agent):
    if agent.used >= WORDS:
        _twist(agent.words)
        agent.used = 0
    y = agent.words[agent.used]
    agent.used += 1
    y ^= y >> np.uint32(11)
    y ^= (y << np.uint32(7)) & np.uint32(0x9D2C5680)
    y ^= (y << np.uint32(15)) & np.uint32(0xEFC60000)
    return y ^ (y >> np.uint32(18))


@compiled
def seed(agent, key):
    """Seed an agent's generator by the first of `key` numbers of 32 bits that follow their count (`init_by_array`)."""
    words, mixed = agent.words, 0xFFFFFFFF
    words[0] = 19650218
    for k in range(1, WORDS):
        words[k] = (1812433253 * _shifted(words[k - 1]) + k) & mixed
    place, used = 1, 0
    for k in range(2 * WORDS - 1):
        if k < WORDS:
            factor, added = 1664525, np.int64(key[1 + used]) + used
            used = used + 1 if used + 1 < key[0] else 0
        else:
            factor, added = 1566083941, -np.int64(place)
        words[place] = ((np.int64(words[place]) ^ (_shifted(words[place - 1]) * factor)) + added) & mixed
        place += 1
        if place == WORDS:
            words[0], place = words[WORDS - 1], 1
    words[0], agent.used = 0x80000000, WORDS


@inlined
def _shifted(word):
    return np.int64(word) ^ (np.int64(word) >> 30)


@compiled
def random(agent):
    """Draw `random()` of an agent's generator."""
    a, b = _word(agent) >> np.uint32(5), _word(agent) >> np.uint32(6)
    return (np.float64(a) * 67108864.0 + np.float64(b)) * (1.0 / 9007199254740992.0)


@compiled
def uniform(agent, low, high):
    """Draw `uniform(low, high)`."""
    return low + (high - low) * random(agent)


@compiled
def gauss(agent, x, y, deviation):
    """Draw `gauss(x, deviation)`, and then `gauss(y, deviation)`: Python makes its numbers in pairs."""
    angle = random(agent) * math.tau
    distance = math.sqrt(-2.0 * math.log(1.0 - random(agent)))
    return x + math.cos(angle) * distance * deviation, y + math.sin(angle) * distance * deviation


@compiled
def place_of_choice(agent, count):
    """Draw the place of the item that `choice` takes of `count` items."""
    bits = 0
    while (count >> bits) > 0:
        bits += 1
    drawn = np.int64(_word(agent) >> np.uint32(32 - bits))
    while drawn >= count:
        drawn = np.int64(_word(agent) >> np.uint32(32 - bits))
    return drawn
