"""Baseline coordination algorithm (the paper's section of that name): the decentralised swarm.

"When an agent observes an event, the agent corrects its heading to move directly towards the event." There it stops and
observes until the event is complete; then it goes to another one that it senses, or walks on. "If a randomly moving
agent moves within communication range of an agent that is observing an event", it goes to that event too.
"""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.beliefs import GONE_MARGIN_M
from deltaswarm_agent.controllers.paper.frames import Attending, PaperFrame
from deltaswarm_agent.controllers.paper.states import ATTENDING, GOING, WALKING, Cause
from deltaswarm_wire.messages import Event


def seek_event(agent: Agent, sensed: tuple[Event, ...], heard: list[PaperFrame]) -> None:
    """Go to an event, and observe it until it is complete; one that is not to work only ends what it has begun."""
    target = agent.target
    if not agent.strategy.attends:
        sensed, heard = tuple([event for event in sensed if target is not None and event.event == target.event]), []
    if agent.state is ATTENDING and target is not None:
        if any(event.event == target.event for event in sensed):
            return
        agent.change(Cause.ANOTHER_SENSED if sensed else Cause.EVENT_COMPLETE)
    if sensed:
        agent.target = min(sensed, key=agent.event_distance)
        if agent.state is WALKING:
            agent.change(Cause.EVENT_SENSED)
    elif agent.state is GOING and target is not None:
        if agent.event_distance(target)[0] < (agent.shared.sensing_range_m - GONE_MARGIN_M) ** 2:
            agent.change(Cause.EVENT_NOT_THERE)
    elif heard and agent.state is WALKING:
        _join_attending(agent, heard)
    going_to = agent.target if agent.state is GOING and sensed else None
    if going_to is not None and agent.here.is_at_event(going_to.x_m, going_to.y_m):
        agent.change(Cause.AT_THE_EVENT)


def _join_attending(agent: Agent, heard: list[PaperFrame]) -> None:
    """Let a walking agent newly in range of an attending agent go to its event."""
    attending = [
        frame
        for frame in heard
        if type(frame) is Attending
        and agent.here.is_newly_met(frame)
        and agent.here.is_reachable(frame.event_x_cm / 100, frame.event_y_cm / 100)
    ]
    if attending:
        near = min(attending, key=agent.sender_distance)
        agent.target = Event(near.event, near.event_x_cm / 100, near.event_y_cm / 100)
        agent.change(Cause.NEIGHBOUR_ATTENDS)
