"""One step of an agent: the order in which the rules apply (`controllers/paper/one_step.py`)."""

from deltaswarm_agent.controllers.paper.frames import MEMBER as MEMBER_FRAME
from deltaswarm_dense.baseline import seek_event
from deltaswarm_dense.beliefs import forget, hear_tree, is_full, sense
from deltaswarm_dense.commands import obey
from deltaswarm_dense.compiled import compiled, inlined
from deltaswarm_dense.delta import LEARNED
from deltaswarm_dense.dissolution import dissolve
from deltaswarm_dense.growth import joins
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import KNOWN, NONE, ORDER_FIELDS
from deltaswarm_dense.learning import learn, note
from deltaswarm_dense.membership import beat, hear_children, parent_of, stay
from deltaswarm_dense.orphans import find_parent, hear_parent, misses_parent
from deltaswarm_dense.policy import choose_structure
from deltaswarm_dense.recruitment import has_arrived, hear_order, recruit
from deltaswarm_dense.root_contest import yields
from deltaswarm_dense.root_formation import founds
from deltaswarm_dense.states import MEMBER, ORPHAN, ROOT


@inlined
def decide(swarm, agent, now, sensed, heard):
    """Apply the rules to what an agent senses and hears."""
    settings = swarm.settings[0]
    if settings.has_finds or settings.report_finds:
        note(agent, swarm.news, now, sensed)
    if settings.has_finds:
        learn(swarm, agent, now, heard)
    orders = swarm.commands.new[swarm.commands.new.size - 1]
    if orders:
        obey(swarm, agent, now)
    if agent.rule == LEARNED and (sensed.size or heard.size or orders):
        choose_structure(settings, swarm.policy, agent, now)
    if not agent.in_tree:
        hears_members = False
        for k in range(heard.size):
            hears_members = hears_members or heard_of(swarm.air, heard[k]).kind == MEMBER_FRAME
        if not founds(swarm, agent, now, sensed, hears_members):
            if not (hears_members and joins(swarm, agent, now, heard)):
                if agent.attends or agent.target != NONE:
                    seek_event(swarm, agent, now, sensed, heard)
                return
    _step_in_tree(swarm, agent, now, sensed, heard)


@compiled
def _step_in_tree(swarm, agent, now, sensed, heard):
    settings, air, trees = swarm.settings[0], swarm.air, swarm.trees
    agent.has_carried, agent.has_order = agent.has_order, False
    for k in range(ORDER_FIELDS):
        agent.carried[k] = agent.order[k]
    trouble = hear_children(settings, agent, air, trees, now, heard)
    hear_tree(agent, swarm.beliefs, air, now, heard)
    sense(settings, agent, swarm.beliefs, swarm.world.events, now, sensed)
    if is_full(agent, swarm.beliefs):
        trouble = KNOWN
    swarm.trouble[0] = max(swarm.trouble[0], trouble)
    forget(settings, agent, swarm.beliefs, now)
    if agent.state == ROOT:
        if yields(settings, agent, air, trees, now, heard) or dissolve(settings, agent, now, sensed.size > 0):
            return
        beat(agent, now)
        recruit(swarm, agent, now)
    elif agent.state == MEMBER:
        _step_member(swarm, agent, now, sensed, heard)
    elif agent.state == ORPHAN:
        find_parent(swarm, agent, now, heard, settings.orphan_strict, settings.orphan)
    elif has_arrived(settings, agent, now):
        if find_parent(swarm, agent, now, heard, settings.arrival_strict, settings.arrival):
            stay(settings, agent)


@compiled
def _step_member(swarm, agent, now, sensed, heard):
    settings, parent = swarm.settings[0], parent_of(agent)
    for k in range(heard.size):
        if heard[k] == parent:
            if not hear_parent(settings, agent, swarm.air, swarm.trees, now, parent):
                return
            if hear_order(settings, agent, swarm.trees, heard_of(swarm.air, parent), now):
                return
    if not misses_parent(swarm, agent, now):
        dissolve(settings, agent, now, sensed.size > 0)
