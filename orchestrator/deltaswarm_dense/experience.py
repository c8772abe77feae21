"""What an agent has come upon of late, for its policy (`controllers/paper/experience.py`)."""

import math

from deltaswarm_agent.controllers.paper.experience import (
    ATTENDING,
    CHANGE_S,
    CROWD,
    FADING_S,
    FIND_RATE_HZ,
    FIND_S,
    MEMBERS,
    PRICE_S,
    REPORTS_HZ,
)
from deltaswarm_agent.controllers.paper.frames import ATTENDING as ATTENDING_FRAME
from deltaswarm_agent.controllers.paper.frames import MEMBER as MEMBER_FRAME
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.finds import rate_hz
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.states import ATTENDING as ATTENDING_STATE


@compiled
def _scaled(value, middle):
    return (value - middle) / (value + middle)


@compiled
def _kept(settings, steps):
    return math.exp(-steps * settings.step_s / FADING_S)


@compiled
def _update(settings, agent, now):
    kept = _kept(settings, now - agent.noted_until)
    agent.noted_until = now
    agent.events_s *= kept
    agent.sensing_s *= kept
    agent.attending_heard *= kept
    agent.members_heard *= kept
    agent.reports_hz *= kept


@compiled
def note_heard(settings, agent, air, sensed, heard, now):
    """Take the number of events that it senses, and what it hears (`Experience.note`)."""
    if sensed == 0 and heard.size == 0:
        return
    _update(settings, agent, now)
    if sensed:
        agent.events_s += sensed * settings.step_s
        agent.sensing_s += settings.step_s
    share, attending, members = settings.step_s / FADING_S, 0, 0
    for k in range(heard.size):
        kind = heard_of(air, heard[k]).kind
        attending += kind == ATTENDING_FRAME
        members += kind == MEMBER_FRAME
    agent.attending_heard += share * attending
    agent.members_heard += share * members


@compiled
def note_report(settings, agent, now):
    """Count a report (`Experience.report`)."""
    _update(settings, agent, now)
    agent.reports_hz += 1.0 / FADING_S


@compiled
def begin_place(settings, agent, now):
    """Note whether it is in a tree from this step on (`Experience.begin`)."""
    if agent.in_tree != agent.was_in_tree:
        agent.in_trees = _share_in_trees(settings, agent, now)
        agent.entered, agent.was_in_tree = now, agent.in_tree


@compiled
def _share_in_trees(settings, agent, now):
    kept = _kept(settings, now - agent.entered)
    return kept * agent.in_trees + (1.0 - kept) * (1.0 if agent.was_in_tree else 0.0)


@compiled
def write_inputs(settings, agent, now):
    """Write the inputs of its policy (`Experience.inputs`)."""
    inputs, kept = agent.inputs, _kept(settings, now - agent.noted_until)
    inputs[0] = 2.0 * agent.busy - 1.0
    inputs[1] = _scaled(rate_hz(agent), FIND_RATE_HZ)
    inputs[2] = _scaled(agent.events_s / agent.sensing_s, CROWD)
    inputs[3] = _scaled(kept * agent.attending_heard, ATTENDING)
    inputs[4] = _scaled(kept * agent.members_heard, MEMBERS)
    inputs[5] = _scaled(kept * agent.reports_hz, REPORTS_HZ)
    inputs[6] = 2.0 * _share_in_trees(settings, agent, now) - 1.0
    inputs[7] = _scaled((now - agent.last_found) * settings.step_s, FIND_S)
    inputs[8] = _scaled((now - agent.changed) * settings.step_s, CHANGE_S)
    inputs[9] = 1.0 if agent.state == ATTENDING_STATE else -1.0
    inputs[10] = _scaled(agent.price_s, PRICE_S)
