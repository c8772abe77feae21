"""The protocol's timers in steps. They are seconds, so that a tree's lifetime does not depend on the step."""

from dataclasses import dataclass

SILENCE_S = 12.0
"""A parent or a child that has not been heard for this long is lost."""

STALL_S = 20.0
"""A pulse that has not advanced for this long means that the root is dead or cut off."""

FRESHNESS_S = 8.0
"""How far behind its expected value a pulse may be for its sender to be trusted as a parent."""

PREVIOUS_TREE_S = 20.0
"""For this long a freed agent is as careful with its previous tree as an orphan."""

LEAVING_S = 4.0
"""For this long an agent announces that it has left."""

ORPHAN_STRICT_S, ORPHAN_S = 2.0, 5.0
"""An orphan takes parents at legal distance only, then any in range, then gives up."""

ARRIVAL_STRICT_S, ARRIVAL_S = 3.0, 8.0
"""The same for a recruited agent at its target."""

CONTESTED_S = 12.0
"""After this long near an equal root, neither of which has yielded, the lower id decides."""

ORDER_S = 12.0
"""An order is sent, and relayed, for this long."""


MEMORY_S = 12.0
"""An event is forgotten when no agent of the tree has sensed it for this long; a longer memory would keep ghosts."""

GONE_S = 30.0
"""For this long members announce that an event is gone."""

TRAIL_S = 4.0
"""An agent comes *newly* into range if it was out of range at some time this long ago, plus the radio's latency."""

MAX_HOPS = 255
"""Maximum of the frame's field for an order's remaining hops."""


def steps_of(time_s: float, step_s: float, least: int = 1) -> int:
    """A time in whole steps, at least `least`."""
    return max(least, round(time_s / step_s))


@dataclass(frozen=True)
class Timers:
    """All timers, in steps.

    A message travels one hop per step, so timers that wait for messages have a minimum number of steps.
    """

    silence: int
    stall: int
    freshness: int
    previous_tree: int
    leaving: int
    orphan_strict: int
    orphan: int
    arrival_strict: int
    arrival: int
    contested: int
    order: int

    memory: int
    gone: int
    trail: int


def timers(step_s: float, latency_s: float = 0.0) -> Timers:
    """The timers for steps of this length, with a radio that delays frames by up to `latency_s` besides."""

    def steps(time_s: float, least: int = 1) -> int:
        return steps_of(time_s, step_s, least)

    return Timers(
        silence=steps(SILENCE_S, 3),
        stall=steps(STALL_S, 6),
        freshness=steps(FRESHNESS_S, 4),
        previous_tree=steps(PREVIOUS_TREE_S, 6),
        leaving=steps(LEAVING_S, 2),
        orphan_strict=steps(ORPHAN_STRICT_S),
        orphan=steps(ORPHAN_S, 2),
        arrival_strict=steps(ARRIVAL_STRICT_S),
        arrival=steps(ARRIVAL_S, 2),
        contested=steps(CONTESTED_S, 3),
        order=min(MAX_HOPS, steps(ORDER_S, 12)),
        memory=steps(MEMORY_S, 3),
        gone=steps(GONE_S, 3),
        trail=steps(TRAIL_S + latency_s, 4),
    )
