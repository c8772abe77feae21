"""One step of an agent under the paper's control structures: the order in which the rules apply."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar

from deltaswarm_agent.controller import STAND, ControllerContext, Decision, OperatorReport, Percept, Velocity
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
from deltaswarm_agent.controllers.paper.beliefs import to_cm
from deltaswarm_agent.controllers.paper.frames import (
    Attending,
    Leaving,
    Member,
    PaperFrame,
    Relocating,
    decode,
    encode,
)
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.root_formation import founds
from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_agent.controllers.paper.states import ATTENDING, GOING, MEMBER, ORPHAN, RELOCATING, ROOT, WALKING, State
from deltaswarm_agent.controllers.paper.walk import towards
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.commands import CommandForm
from deltaswarm_wire.messages import FREE, NOBODY, Event
from deltaswarm_wire.operator_messages import ReportedMember

_member: Callable[[tuple[int, ...]], ReportedMember] = partial(tuple.__new__, ReportedMember)
REPORTING_ROLES = ("attending", "leaving", "root")
"""The roles in which agents report to the operator."""

_ROLES = {type(None): FREE, Attending: "attending", Leaving: "leaving"}


class PaperController:
    """One agent of a decentralised, hierarchical or hybrid swarm. `step` is its only mutating method."""

    Settings: ClassVar[type[PaperSettings]] = PaperSettings
    Commands: ClassVar[tuple[CommandForm, ...]] = commands.FORMS

    def __init__(self, context: ControllerContext) -> None:
        self.agent = Agent(context)
        self.counts = {"rejected_frames": 0, "rows_cut": 0}
        """Received invalid frames; descendants beyond a frame's table."""

    @property
    def state(self) -> State:
        """The agent's state."""
        return self.agent.state

    @property
    def membership(self) -> Membership | None:
        """Its place in a tree; None if it is free."""
        return self.agent.membership

    def step(self, percept: Percept) -> Decision:
        """Decide."""
        agent = self.agent
        agent.now = percept.step
        agent.here.move_to(percept.pose, percept.poses)
        heard = self._decoded(percept.heard) if percept.heard else []
        if agent.finds is not None:
            learning.learn(agent, agent.finds, percept.events, heard)
        if percept.commands or agent.goto is not None:
            commands.obey(agent, percept.commands)
        if agent.membership is None:
            self._step_free(percept.events, heard)
        else:
            self._step_in_tree(agent.membership, percept.events, heard)
        decision = self._decision(percept.events)
        agent.here.keep()
        return decision

    def _decoded(self, heard: Sequence[tuple[int, bytes]]) -> list[PaperFrame]:
        frames = []
        for sender, payload in heard:
            try:
                frames.append(decode(sender, payload))
            except WireError:
                self.counts["rejected_frames"] += 1
        return frames

    def _step_free(self, sensed: Sequence[Event], heard: list[PaperFrame]) -> None:
        agent = self.agent
        members = [frame for frame in heard if type(frame) is Member] if heard else []
        if founds(agent, sensed, members) or (members and growth.joins(agent, members)):
            assert agent.membership is not None
            self._step_in_tree(agent.membership, sensed, heard)
        elif agent.strategy.attends:
            baseline.seek_event(agent, sensed, heard)

    def _step_in_tree(self, membership: Membership, sensed: Sequence[Event], heard: list[PaperFrame]) -> None:
        agent = self.agent
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
            self._step_member(membership, sensed, heard)
        elif agent.state is ORPHAN:
            orphans.find_parent(agent, membership, heard, times.orphan_strict, times.orphan)
        elif recruitment.has_arrived(agent) and orphans.find_parent(
            agent, membership, heard, times.arrival_strict, times.arrival
        ):
            agent.stay()

    def _step_member(self, membership: Membership, sensed: Sequence[Event], heard: Sequence[PaperFrame]) -> None:
        agent, parent = self.agent, membership.parent
        for frame in heard:
            if frame.sender == parent:
                if not orphans.hear_parent(agent, membership, frame):
                    return
                if type(frame) is Member and recruitment.hear_order(agent, membership, frame):
                    return
        if not orphans.misses_parent(agent, membership):
            dissolution.dissolve(agent, membership, sensed)

    # The decision

    def _decision(self, sensed: tuple[Event, ...]) -> Decision:
        agent = self.agent
        velocity, until = self._motion()
        observed = self._observed(sensed) if sensed else ()
        if agent.finds is not None:
            learning.begin(agent, agent.finds, bool(observed))
        frame = self._frame(len(sensed))
        role, level, parent, root = self._place(frame)
        decision = Decision(
            velocity,
            observed,
            None if frame is None else encode(frame),
            self._report(frame),
            role,
            level,
            parent,
            root,
            agent.now + 1 if frame is not None else until,
            delta=agent.delta or 0,
        )
        if agent.done or agent.refused or agent.superseded:
            outcomes = agent.done, agent.refused, agent.superseded
            done, refused, superseded = map(tuple, outcomes)
            decision = decision._replace(done=done, refused=refused, superseded=superseded)
            for numbers in outcomes:
                numbers.clear()
        return decision

    def _motion(self) -> tuple[Velocity, int]:
        """Return the velocity, and the step until which it holds in any case."""
        agent, here = self.agent, self.agent.here
        if agent.now < agent.holds_until:
            return STAND, agent.holds_until
        if agent.state is WALKING and (place := commands.goto(agent)):
            return towards(here.x_m, here.y_m, *place, agent.shared), agent.now + 1
        if agent.state is WALKING:
            velocity = agent.walk.velocity(agent.now, here.x_m, here.y_m)
            return velocity, agent.walk.straight_until(agent.now, here.x_m, here.y_m, velocity)
        velocity = STAND
        if agent.state is GOING and agent.target is not None:
            velocity = towards(here.x_m, here.y_m, agent.target.x_m, agent.target.y_m, agent.shared)
        elif agent.state is RELOCATING:
            velocity = towards(here.x_m, here.y_m, *agent.recruit_goal, agent.shared)
        return velocity, agent.now + 1

    def _observed(self, sensed: Sequence[Event]) -> tuple[int, ...]:
        """Return the events that this agent works on in this step."""
        agent = self.agent
        if agent.state in (WALKING, GOING, RELOCATING):
            return ()
        if agent.state is ATTENDING:
            assert agent.target is not None
            return (agent.target.event,)
        if agent.settings.member_observes == "all":
            return tuple(event.event for event in sensed)
        return (min(sensed, key=agent.event_distance).event,)

    def _frame(self, score: int) -> PaperFrame | None:
        """Return the frame for the neighbours, or None."""
        agent, membership = self.agent, self.agent.membership
        attends = agent.state is ATTENDING
        if membership is None and not attends and agent.leave_frames_left == 0:
            return None
        head = (agent.id, to_cm(agent.here.x_m), to_cm(agent.here.y_m))
        if agent.state is RELOCATING:
            return Relocating(*head)
        averages = None if agent.finds is None else agent.finds.told(agent.now)
        if membership is not None:
            table = membership.table()
            self.counts["rows_cut"] += membership.rows_cut
            return Member(
                *head,
                agent.state is ORPHAN,
                membership.path,
                membership.pulse,
                score,
                table,
                agent.beliefs.sightings(agent.now),
                agent.beliefs.departures(agent.now),
                agent.order,
                averages,
            )
        if agent.leave_frames_left > 0:
            agent.leave_frames_left -= 1
            return Leaving(*head)
        target = agent.target
        assert target is not None
        return Attending(*head, target.event, to_cm(target.x_m), to_cm(target.y_m), averages)

    def _place(self, frame: PaperFrame | None) -> tuple[str, int, int, int]:
        """Return the agent's role, level, parent and root; silent agents are free."""
        if type(frame) is Member:
            level = len(frame.path) - 1
            role = "orphan" if frame.orphan else "member" if level else "root"
            return role, level, frame.path[-2] if level else NOBODY, frame.path[0]
        if type(frame) is Relocating:
            assert self.agent.membership is not None
            return "relocating", 0, NOBODY, self.agent.membership.root
        return _ROLES[type(frame)], 0, NOBODY, NOBODY

    def _report(self, frame: PaperFrame | None) -> OperatorReport | None:
        """Return the report: an attending agent's event, or the events known to a root's tree."""
        agent = self.agent
        attends = agent.state is ATTENDING and agent.target is not None
        tree = frame if agent.state is ROOT and agent.beliefs and type(frame) is Member else None
        if not (attends or tree) or not agent.reporting.is_due(agent.now * agent.shared.step_s):
            return None
        if tree is None:
            assert agent.target is not None
            return OperatorReport((agent.target,))
        members = tuple([_member(row[:4]) for row in tree.table]) if agent.settings.report_members else ()
        return OperatorReport(tuple(agent.beliefs.active()), len(tree.table), members)
