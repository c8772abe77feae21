"""One step of an agent under the paper's control structures: the order in which the rules apply."""

from deltaswarm_agent.controller import Decision, Percept
from deltaswarm_agent.controllers.paper import (
    baseline,
    commands,
    dissolution,
    growth,
    learning,
    orphans,
    recruitment,
    root_contest,
)
from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.decision import decision_of
from deltaswarm_agent.controllers.paper.frames import Member, PaperFrame, decode
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.root_formation import founds
from deltaswarm_agent.controllers.paper.states import MEMBER, ORPHAN, ROOT
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.messages import Event


def decide(agent: Agent, percept: Percept) -> Decision:
    """Apply the rules to what an agent senses and hears; return what it does."""
    agent.now = percept.step
    agent.here.move_to(percept.pose, percept.poses)
    sensed, heard = percept.events, _decoded(agent, percept.heard)
    if agent.finds is not None or agent.settings.report_finds:
        agent.note(sensed)
    if agent.finds is not None:
        learning.learn(agent, agent.finds, heard)
    if percept.commands or agent.goto is not None:
        commands.obey(agent, percept.commands)
    if sensed or heard or percept.commands:  # else it need not be asked, and would not choose
        agent.choose_structure()
    if agent.membership is None:
        _step_free(agent, sensed, heard)
    else:
        _step_in_tree(agent, agent.membership, sensed, heard)
    decision = decision_of(agent, sensed)
    agent.here.keep()
    return decision


def _decoded(agent: Agent, heard: list[tuple[int, bytes]]) -> list[PaperFrame]:
    frames: list[PaperFrame] = []
    for sender, payload in heard:
        try:
            frames.append(decode(sender, payload))
        except WireError:
            agent.rejected_frames += 1
    return frames


def _step_free(agent: Agent, sensed: tuple[Event, ...], heard: list[PaperFrame]) -> None:
    members = [frame for frame in heard if type(frame) is Member] if heard else []
    if founds(agent, sensed, members) or (members and growth.joins(agent, members)):
        assert agent.membership is not None
        _step_in_tree(agent, agent.membership, sensed, heard)
    elif agent.strategy.attends or agent.target is not None:
        baseline.seek_event(agent, sensed, heard)


def _step_in_tree(agent: Agent, membership: Membership, sensed: tuple[Event, ...], heard: list[PaperFrame]) -> None:
    carried, agent.order = agent.order, None
    membership.hear_children(heard, agent.now)
    agent.beliefs.hear_tree(heard, membership.root, agent.now)
    agent.beliefs.sense(sensed, agent.here.x_m, agent.here.y_m, agent.now)
    agent.beliefs.forget(agent.now)
    times = agent.timers
    if agent.state is ROOT:
        if not (root_contest.yields(agent, membership, heard) or dissolution.dissolve(agent, membership, sensed)):
            membership.beat(agent.now)
            recruitment.recruit(agent, membership, carried)
    elif agent.state is MEMBER:
        _step_member(agent, membership, sensed, heard)
    elif agent.state is ORPHAN:
        orphans.find_parent(agent, membership, heard, times.orphan_strict, times.orphan)
    elif recruitment.has_arrived(agent) and orphans.find_parent(
        agent, membership, heard, times.arrival_strict, times.arrival
    ):
        agent.stay()


def _step_member(agent: Agent, membership: Membership, sensed: tuple[Event, ...], heard: list[PaperFrame]) -> None:
    parent = membership.parent
    for frame in heard:
        if frame.sender == parent:
            if not orphans.hear_parent(agent, membership, frame):
                return
            if type(frame) is Member and recruitment.hear_order(agent, membership, frame):
                return
    if not orphans.misses_parent(agent, membership):
        dissolution.dissolve(agent, membership, sensed)
