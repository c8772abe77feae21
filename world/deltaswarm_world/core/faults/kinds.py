"""The kinds of faults, in the order in which they act on a body."""

from deltaswarm_world.core.faults.bodies import RadioDead, Slow, Stuck
from deltaswarm_world.core.faults.kind import Kind
from deltaswarm_world.core.faults.processes import Freeze, Kill, Restart
from deltaswarm_world.core.faults.senses import Blind, Lying, Noisy

KINDS: tuple[type[Kind], ...] = (
    Kill,
    Freeze,
    Restart,
    Blind,
    Noisy,
    Slow,
    Stuck,
    RadioDead,
    Lying,
)
"""A new kind is one line here. Lying comes after noisy, since invented events have no error."""
