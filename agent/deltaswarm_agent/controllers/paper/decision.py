"""What an agent does in a step, by its state: motion, observed events, frame for the neighbours, report."""

from collections.abc import Callable
from functools import partial

from deltaswarm_agent.controller import STAND, Decision, OperatorReport, Velocity
from deltaswarm_agent.controllers.paper import commands, learning
from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.beliefs import to_cm
from deltaswarm_agent.controllers.paper.frames import Attending, Leaving, Member, PaperFrame, Relocating, encode
from deltaswarm_agent.controllers.paper.settings import ALL
from deltaswarm_agent.controllers.paper.states import ATTENDING, GOING, ORPHAN, RELOCATING, ROOT, WALKING
from deltaswarm_agent.controllers.paper.walk import towards
from deltaswarm_wire.codec import tuple_of
from deltaswarm_wire.messages import FREE, NOBODY, Event
from deltaswarm_wire.operator_messages import ReportedMember

_member: Callable[[tuple[int, ...]], ReportedMember] = partial(tuple_of, ReportedMember)

_ROLES = {type(None): FREE, Attending: "attending", Leaving: "leaving"}


def decision_of(agent: Agent, sensed: tuple[Event, ...]) -> Decision:
    """Return what the agent does, after the rules have set its state."""
    velocity, until = _motion(agent)
    observed = _observed(agent, sensed) if sensed else ()
    if agent.finds is not None:
        learning.begin(agent, agent.finds, bool(observed))
    frame = _frame(agent, len(sensed))
    payload = None if frame is None else encode(frame)
    until = agent.now + 1 if frame is not None else until
    place = _place(agent, frame)
    finds = agent.new if agent.settings.report_finds and agent.membership is None else ()
    report = _report(agent, frame, finds)
    if report is not None and agent.experience is not None:
        agent.experience.report(agent.now)
    if report is not None and agent.bandit is not None:
        agent.bandit.report(agent.now)
    fields = (velocity, observed, payload, report, *place, until, (), (), (), agent.delta or 0)
    decision: Decision = tuple_of(Decision, fields)
    if agent.done or agent.refused or agent.superseded:
        outcomes = agent.done, agent.refused, agent.superseded
        done, refused, superseded = map(tuple, outcomes)
        decision = decision._replace(done=done, refused=refused, superseded=superseded)
        for numbers in outcomes:
            numbers.clear()
    return decision


def _motion(agent: Agent) -> tuple[Velocity, int]:
    """Return the velocity, and the step until which it holds in any case."""
    here = agent.here
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


def _observed(agent: Agent, sensed: tuple[Event, ...]) -> tuple[int, ...]:
    """Return the events that this agent works on in this step."""
    if agent.state in (WALKING, GOING, RELOCATING):
        return ()
    if agent.state is ATTENDING:
        assert agent.target is not None
        return (agent.target.event,)
    if agent.settings.member_observes == ALL:
        return tuple(event.event for event in sensed)
    return (min(sensed, key=agent.event_distance).event,)


def _frame(agent: Agent, score: int) -> PaperFrame | None:
    membership = agent.membership
    attends = agent.state is ATTENDING
    if membership is None and not attends and agent.leave_frames_left == 0:
        return None
    head = (agent.id, to_cm(agent.here.x_m), to_cm(agent.here.y_m))
    if agent.state is RELOCATING:
        return Relocating(*head)
    averages = None if agent.finds is None else agent.finds.told(agent.now)
    if averages is not None and agent.bandit is not None:
        averages = averages._replace(tried=agent.bandit.told(agent.now))
    if membership is not None:
        table = membership.table()
        agent.rows_cut += membership.rows_cut
        fields = (
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
        member: Member = tuple_of(Member, fields)
        return member
    if agent.leave_frames_left > 0:
        agent.leave_frames_left -= 1
        return Leaving(*head)
    target = agent.target
    assert target is not None
    return Attending(*head, target.event, to_cm(target.x_m), to_cm(target.y_m), averages)


def _place(agent: Agent, frame: PaperFrame | None) -> tuple[str, int, int, int]:
    """Return the agent's role, level, parent and root; silent agents are free."""
    if type(frame) is Member:
        level = len(frame.path) - 1
        role = "orphan" if frame.orphan else "member" if level else "root"
        return role, level, frame.path[-2] if level else NOBODY, frame.path[0]
    if type(frame) is Relocating:
        assert agent.membership is not None
        return "relocating", 0, NOBODY, agent.membership.root
    return _ROLES[type(frame)], 0, NOBODY, NOBODY


def _report(agent: Agent, frame: PaperFrame | None, finds: tuple[Event, ...]) -> OperatorReport | None:
    """Return the report: an attending agent's event, the events known to a root's tree, or else what was found."""
    attends = agent.state is ATTENDING and agent.target is not None
    tree = frame if agent.state is ROOT and agent.beliefs and type(frame) is Member else None
    if not (attends or tree) or not agent.reporting.is_due(agent.now * agent.shared.step_s):
        return OperatorReport(finds) if finds else None
    if tree is None:
        assert agent.target is not None
        others = [event for event in finds if event.event != agent.target.event] if finds else ()
        return OperatorReport((agent.target, *others))
    members = tuple([_member(row[:4]) for row in tree.table]) if agent.settings.report_members else ()
    return OperatorReport(tuple(agent.beliefs.active()), len(tree.table), members)
