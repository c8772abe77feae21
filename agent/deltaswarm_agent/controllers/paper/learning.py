"""What an agent learns in each step about finding events, for `finds` and `returning`."""

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.finds import Finds
from deltaswarm_agent.controllers.paper.frames import Attending, Member, PaperFrame, Tried
from deltaswarm_agent.controllers.paper.states import WALKING
from deltaswarm_wire.messages import Event


def learn(agent: Agent, finds: Finds, heard: list[PaperFrame]) -> None:
    """Take what the agent senses and hears: its new events, where they are, and the averages of others.

    An event near an agent that is attending or in a tree, by its frames, is not a find: it was known already.
    """
    now, found, new, experience = agent.now, agent.found, agent.new, agent.experience
    if new:
        finds.update(now)
        finds.find(sum(not _is_known(agent, event, heard) for event in new))
    if heard:
        finds.hear(heard, now)
    if agent.bandit is not None and (told := [tried for frame in heard if (tried := _tried(frame)) is not None]):
        agent.bandit.hear(told, now)
    if experience is not None:
        experience.note(len(agent.sensed), heard, now)
        experience.found = now if new else experience.found
    if found is None:
        return
    for event in new:
        found.add(event.x_m, event.y_m, now)
    if agent.membership is None:
        met = [frame for frame in heard if type(frame) is Attending and agent.here.is_newly_met(frame)]
        for x_cm, y_cm in sorted({(frame.event_x_cm, frame.event_y_cm) for frame in met}):
            found.add(x_cm / 100, y_cm / 100, now)


def _tried(frame: PaperFrame) -> Tried | None:
    averages = frame.averages if type(frame) is Attending or type(frame) is Member else None
    return None if averages is None else averages.tried


def _is_known(agent: Agent, event: Event, heard: list[PaperFrame]) -> bool:
    reach_m2 = agent.shared.sensing_range_m**2
    return any(
        (type(frame) is Attending or type(frame) is Member)
        and (frame.x_cm * 0.01 - event.x_m) ** 2 + (frame.y_cm * 0.01 - event.y_m) ** 2 <= reach_m2
        for frame in heard
    )


def begin(agent: Agent, finds: Finds, works: bool) -> None:
    """Say what the agent does from this step on: whether it walks on its own account, and whether it works."""
    walks = agent.state is WALKING and agent.now >= agent.holds_until and agent.goto is None
    finds.begin(agent.walk.leg if walks else None, works, agent.now)
    if agent.bandit is not None:
        agent.bandit.begin(works, agent.now)
    if agent.experience is not None:
        agent.experience.begin(agent.membership is not None, agent.now)
