"""Delta at run time (the paper's open question): each agent chooses it by how busy agents are.

Where agents work on events for most of their time, few are left to search, and a tree that holds them at the work is
worth founding early. Where there is little work, walkers find new events sooner than a tree that waits for them.
"""

CHOICES = ((0.5, 2), (0.25, 3), (0.0, 4))
"""Least share of their time in which agents work, and the delta that fits; found by search in simulation."""


def delta_for(busy: float) -> int:
    """Return delta for the share of the time in which agents work on events (`Finds.busy`)."""
    return next(delta for least, delta in CHOICES if busy >= least)
