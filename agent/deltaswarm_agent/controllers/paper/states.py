"""The states of an agent and every transition.

An agent changes its state only through this table, and the diagram in `STATES.md` is drawn from it.
"""

from enum import StrEnum


class State(StrEnum):
    """What an agent is doing. The first three are the paper's free agents."""

    WALKING = "walking"
    GOING = "going"
    ATTENDING = "attending"
    ROOT = "root"
    MEMBER = "member"
    ORPHAN = "orphan"
    RELOCATING = "relocating"


WALKING, GOING, ATTENDING, ROOT, MEMBER, ORPHAN, RELOCATING = State
"""Module-level names for use in every step: up to Python 3.11, access through the class takes ten times as long."""

FREE = frozenset({State.WALKING, State.GOING, State.ATTENDING})


class Cause(StrEnum):
    """Why an agent changes its state: the rule of the paper, or of `TREES.md`, behind it."""

    EVENT_SENSED = "event sensed"
    NEIGHBOUR_ATTENDS = "newly in range of an attending agent"
    AT_THE_EVENT = "at the event"
    EVENT_NOT_THERE = "event not there"
    EVENT_COMPLETE = "event complete"
    ANOTHER_SENSED = "event complete, another sensed"
    THRESHOLD_REACHED = "threshold of events sensed"
    MEMBER_MET = "newly in range of a member"
    SENIOR_ROOT = "senior root in range"
    SENIOR_TOO_CLOSE = "senior root closer than d_min"
    DISSOLVED = "gamma exhausted"
    ROOT_IDLE = "idle without followers"
    IMPATIENT = "patience lost"
    PARENT_LEFT = "parent left"
    PULSE_STALLED = "pulse stalled"
    PARENT_LOST = "parent lost"
    ELECTED = "root lost, first of its children"
    CYCLE_FOUND = "itself in its parent's path"
    ADOPTED = "member of the same tree in range"
    NOBODY_FOUND = "no member in range"
    ORDERED = "recruited by its root"
    RECALLED = "recalled by the operator"
    TAKEN_OFF = "no longer among those that work alone"


TRANSITIONS: dict[tuple[State, Cause], State] = {
    (State.WALKING, Cause.EVENT_SENSED): State.GOING,
    (State.WALKING, Cause.NEIGHBOUR_ATTENDS): State.GOING,
    (State.GOING, Cause.AT_THE_EVENT): State.ATTENDING,
    (State.GOING, Cause.EVENT_NOT_THERE): State.WALKING,
    (State.ATTENDING, Cause.EVENT_COMPLETE): State.WALKING,
    (State.ATTENDING, Cause.ANOTHER_SENSED): State.GOING,
    (State.GOING, Cause.TAKEN_OFF): State.WALKING,
    (State.ATTENDING, Cause.TAKEN_OFF): State.WALKING,
    (State.WALKING, Cause.THRESHOLD_REACHED): State.ROOT,
    (State.GOING, Cause.THRESHOLD_REACHED): State.ROOT,
    (State.ATTENDING, Cause.THRESHOLD_REACHED): State.ROOT,
    (State.WALKING, Cause.MEMBER_MET): State.MEMBER,
    (State.GOING, Cause.MEMBER_MET): State.MEMBER,
    (State.ATTENDING, Cause.MEMBER_MET): State.MEMBER,
    (State.ROOT, Cause.SENIOR_ROOT): State.MEMBER,
    (State.ROOT, Cause.SENIOR_TOO_CLOSE): State.WALKING,
    (State.ROOT, Cause.ROOT_IDLE): State.WALKING,
    (State.ROOT, Cause.IMPATIENT): State.WALKING,
    (State.MEMBER, Cause.IMPATIENT): State.WALKING,
    (State.MEMBER, Cause.DISSOLVED): State.WALKING,
    (State.MEMBER, Cause.PARENT_LEFT): State.WALKING,
    (State.MEMBER, Cause.PULSE_STALLED): State.WALKING,
    (State.MEMBER, Cause.PARENT_LOST): State.ORPHAN,
    (State.MEMBER, Cause.CYCLE_FOUND): State.ORPHAN,
    (State.MEMBER, Cause.ELECTED): State.ROOT,
    (State.MEMBER, Cause.ORDERED): State.RELOCATING,
    (State.ORPHAN, Cause.ADOPTED): State.MEMBER,
    (State.ORPHAN, Cause.NOBODY_FOUND): State.WALKING,
    (State.RELOCATING, Cause.ADOPTED): State.MEMBER,
    (State.RELOCATING, Cause.NOBODY_FOUND): State.WALKING,
    (State.ROOT, Cause.RECALLED): State.WALKING,
    (State.MEMBER, Cause.RECALLED): State.WALKING,
    (State.ORPHAN, Cause.RECALLED): State.WALKING,
    (State.RELOCATING, Cause.RECALLED): State.WALKING,
}


def diagram() -> str:
    """The table as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.WALKING.value}"]
    lines += [
        f"    {source.value} --> {target.value}: {cause.value}" for (source, cause), target in TRANSITIONS.items()
    ]
    return "\n".join(lines) + "\n"
