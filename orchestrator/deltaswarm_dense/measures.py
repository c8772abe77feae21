"""What the world's record of a step tells of trees (`bookkeeping.py`, `environment.Coverage`)."""

import math
from typing import Any

from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.states import MEMBER_ROLE, ROOT_ROLE

BLOCK = 8
MOST_IN_BLOCKS = 128
HALVINGS = 7
"""Enough for 10,000 agents."""


@compiled
def measure(settings, agents, measures, count, now):
    """Count agents in trees and roots; measure roots' distance from the densest place, and the covered area."""
    count.in_trees = count.roots = count.deltas = count.deltas_sum = 0
    is_due = now % measures.coverage_every[0] == 0
    area_m2 = 0
    densest_x_m, densest_y_m = measures.densest_m[now]
    for i in range(agents.size):
        agent = agents[i]
        if not agent.has_status:
            continue
        count.deltas += agent.delta > 0
        count.deltas_sum += agent.delta
        if agent.role >= ROOT_ROLE:
            count.in_trees += 1
            if agent.role == ROOT_ROLE:
                measures.distances_m[count.roots] = math.hypot(agent.x_m - densest_x_m, agent.y_m - densest_y_m)
                count.roots += 1
            if is_due:
                area_m2 += newly_covered_m2(settings, agent, measures.is_covered, now + 1)
    count.covered_area_m2 = area_m2 if is_due else NONE
    count.roots_from_densest_m = math.nan
    if count.roots:
        count.roots_from_densest_m = sum_as_numpy(measures.distances_m, 0, count.roots) / count.roots


@compiled
def newly_covered_m2(settings, agent, is_covered, stamp):
    """Mark the cells within an agent's sensing range; return how many were not marked before [m2]."""
    range_m, x_m, y_m, found = settings.sensing_range_m, agent.x_m, agent.y_m, 0
    columns, rows = is_covered.shape
    for x in range(int(max(0.0, x_m - range_m)), min(int(x_m + range_m) + 1, columns)):
        for y in range(int(max(0.0, y_m - range_m)), min(int(y_m + range_m) + 1, rows)):
            dx, dy = (x + 0.5) - x_m, (y + 0.5) - y_m
            if dx * dx + dy * dy <= settings.sensing_m2 and is_covered[x, y] != stamp:
                is_covered[x, y] = stamp
                found += 1
    return found


@compiled
def _interleaved_sum(values, begin, count):
    total, at = 0.0, begin
    if count >= BLOCK:
        a, b, c, d = values[at], values[at + 1], values[at + 2], values[at + 3]
        e, f, g, h = values[at + 4], values[at + 5], values[at + 6], values[at + 7]
        at += BLOCK
        while at + BLOCK <= begin + count:
            a, b, c, d = a + values[at], b + values[at + 1], c + values[at + 2], d + values[at + 3]
            e, f, g, h = e + values[at + 4], f + values[at + 5], g + values[at + 6], h + values[at + 7]
            at += BLOCK
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for k in range(at, begin + count):
        total += values[k]
    return total


def _in_halves(of_half: Any) -> Any:
    @compiled
    def total(values, begin, count):
        if count <= MOST_IN_BLOCKS:
            return _interleaved_sum(values, begin, count)
        half = count // 2 - count // 2 % BLOCK
        return of_half(values, begin, half) + of_half(values, begin + half, count - half)

    return total


sum_as_numpy = _interleaved_sum
"""The sum of `count` values from `begin` on as NumPy adds them: halves of many, eight sums of eight or more.

Compiled code that calls itself cannot be read from disk, so there is a function for each halving.
"""
for _ in range(HALVINGS):
    sum_as_numpy = _in_halves(sum_as_numpy)

assert MEMBER_ROLE > ROOT_ROLE
