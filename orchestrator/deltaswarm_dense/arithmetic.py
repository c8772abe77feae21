"""Arithmetic with Python's results to the last bit, where compiled code would differ.

Python computes `x ** 2` by the C library's `pow`, which differs from the product in one of a thousand cases. Compiled
code would use the product, so the exponent is an argument that the compiler cannot know.
"""

import math

import numpy as np

from deltaswarm_dense.compiled import compiled, inlined


@inlined
def squared_m2(dx_m, dy_m, two):
    """Return `dx_m ** 2 + dy_m ** 2`; `two` is 2.0."""
    return math.pow(dx_m, two) + math.pow(dy_m, two)


@inlined
def rounded(value):
    """Return `round(value)`: halves go to the even neighbour."""
    return np.int64(np.rint(value))


@compiled
def steps_of(time_s, step_s):
    """Return `timers.steps_of(time_s, step_s)`."""
    return max(1, rounded(time_s / step_s))


SPLIT = 134217729.0
"""2 ** 27 + 1: splits a float into two halves whose products are exact."""


@compiled
def distance_m(ax_m, ay_m, bx_m, by_m):
    """Return `math.dist((ax_m, ay_m), (bx_m, by_m))`, which is not the plain root of a sum of squares.

    The same steps as CPython 3.11's: sums of exact products, and one correction of the root.
    """
    sides = (abs(ax_m - bx_m), abs(ay_m - by_m))
    longest = max(sides[0], sides[1])
    if longest == 0.0:
        return 0.0
    exponent = math.frexp(longest)[1]
    scale = math.ldexp(1.0, -exponent)
    total, first, second, third = 1.0, 0.0, 0.0, 0.0
    for side in sides:
        x = side * scale
        t = x * SPLIT
        high = t - (t - x)
        low = x - high
        x = high * high
        before = total
        total += x
        first += (before - total) + x
        x = 2.0 * high * low
        before = total
        total += x
        second += (before - total) + x
        third += low * low
    root = math.sqrt(total - 1.0 + (first + second + third))
    t = root * SPLIT
    high = t - (t - root)
    low = root - high
    x = -high * high
    before = total
    total += x
    first += (before - total) + x
    x = -2.0 * high * low
    before = total
    total += x
    second += (before - total) + x
    x = -low * low
    before = total
    total += x
    third += (before - total) + x
    rest = total - 1.0 + (first + second + third)
    return (root + rest / (2.0 * root)) / scale
