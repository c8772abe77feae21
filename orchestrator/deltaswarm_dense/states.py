"""States and roles of agents as numbers, and every change of state (`controllers/paper/states.py`)."""

import numpy as np

from deltaswarm_agent.controllers.paper.states import TRANSITIONS, Cause, State
from deltaswarm_dense.bandit import choose_arm
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.delta import BANDIT
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.walk import turn

STATES = tuple(State)
CAUSES = tuple(Cause)
WALKING, GOING, ATTENDING, ROOT, MEMBER, ORPHAN, RELOCATING = range(len(STATES))

(
    EVENT_SENSED,
    NEIGHBOUR_ATTENDS,
    AT_THE_EVENT,
    EVENT_NOT_THERE,
    EVENT_COMPLETE,
    ANOTHER_SENSED,
    THRESHOLD_REACHED,
    MEMBER_MET,
    SENIOR_ROOT,
    SENIOR_TOO_CLOSE,
    DISSOLVED,
    ROOT_IDLE,
    IMPATIENT,
    PARENT_LEFT,
    PULSE_STALLED,
    PARENT_LOST,
    ELECTED,
    CYCLE_FOUND,
    ADOPTED,
    NOBODY_FOUND,
    ORDERED,
    RECALLED,
    TAKEN_OFF,
) = range(len(CAUSES))

NEXT = np.full((len(STATES), len(CAUSES)), NONE, np.int64)
"""The state after a cause; NONE where the Python table has no entry."""
for (_source, _cause), _target in TRANSITIONS.items():
    NEXT[STATES.index(_source), CAUSES.index(_cause)] = STATES.index(_target)

ROLES = ("free", "attending", "leaving", "root", "member", "orphan", "relocating")
FREE_ROLE, ATTENDING_ROLE, LEAVING_ROLE, ROOT_ROLE, MEMBER_ROLE, ORPHAN_ROLE, RELOCATING_ROLE = range(len(ROLES))


@compiled
def change(settings, agent, now, cause):
    """Change the state along the table (`Agent.change`)."""
    agent.state = NEXT[agent.state, cause]
    agent.changed = now
    if agent.state == WALKING:
        agent.target = agent.back_step = NONE
        if agent.rule == BANDIT:
            choose_arm(settings, agent, now)
        turn(settings, agent, now)
