"""What an agent learns in each step about finding events (`controllers/paper/learning.py`)."""

from deltaswarm_agent.controllers.paper.frames import ATTENDING
from deltaswarm_dense.arithmetic import squared_m2
from deltaswarm_dense.bandit import begin_arm, hear_arms
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.experience import begin_place, note_heard
from deltaswarm_dense.finds import begin_activity, hear_averages, tells_averages, update_averages
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.returning import add_place
from deltaswarm_dense.states import WALKING
from deltaswarm_dense.whereabouts import is_newly_met


@compiled
def note(agent, news, now, sensed):
    """Note the events that are new in this step (`Agent.note`)."""
    noted, last = news.noted[agent.id], news.new.size - 1
    before = agent.noted if agent.noted_step == now - 1 else 0
    news.new[last] = 0
    for k in range(sensed.size):
        is_new = True
        for s in range(before):
            is_new = is_new and noted[s] != sensed[k]
        if is_new:
            news.new[news.new[last]] = sensed[k]
            news.new[last] += 1
    for k in range(sensed.size):
        noted[k] = sensed[k]
    agent.noted, agent.noted_step = sensed.size, now


@compiled
def learn(swarm, agent, now, heard):
    """Take what the agent senses and hears: its new events, where they are, and the averages of others."""
    settings, events, air = swarm.settings[0], swarm.world.events, swarm.air
    new = swarm.news.new[: swarm.news.new[swarm.news.new.size - 1]]
    if new.size:
        update_averages(settings, agent, now)
        count = 0
        for k in range(new.size):
            count += not _is_known(settings, events[new[k]], air, heard)
        if agent.averaged_leg != NONE:
            agent.finds[agent.averaged_leg] += count
    hear_averages(settings, agent, air, now, heard)
    if settings.tries:
        hear_arms(settings, agent, air, now, heard)
    if settings.learns:
        note_heard(settings, agent, air, agent.noted, heard, now)
        agent.last_found = now if new.size else agent.last_found
    if not settings.returns:
        return
    for k in range(new.size):
        add_place(agent, events[new[k]].x_m, events[new[k]].y_m, now)
    if not agent.in_tree:
        met_cm = swarm.news.met_cm
        for k in range(_note_met(settings, agent, air, swarm.trail_m, now, heard, met_cm)):
            add_place(agent, met_cm[k, 0] / 100, met_cm[k, 1] / 100, now)


@compiled
def _is_known(settings, event, air, heard):
    """Return whether an agent that attends or is in a tree is near enough to an event to know it."""
    for k in range(heard.size):
        frame = heard_of(air, heard[k])
        if tells_averages(frame):
            dx_m, dy_m = frame.x_cm * 0.01 - event.x_m, frame.y_cm * 0.01 - event.y_m
            if squared_m2(dx_m, dy_m, settings.two) <= settings.sensing_m2:
                return True
    return False


@compiled
def _note_met(settings, agent, air, trail_m, now, heard, met_cm):
    """Write the places of the events of agents newly met, in order, each once; return their number."""
    count = 0
    for k in range(heard.size):
        frame = heard_of(air, heard[k])
        if frame.kind != ATTENDING or not is_newly_met(settings, agent, trail_m, now, frame):
            continue
        x_cm, y_cm, at = frame.event_x_cm, frame.event_y_cm, 0
        while at < count and (met_cm[at, 0] < x_cm or (met_cm[at, 0] == x_cm and met_cm[at, 1] < y_cm)):
            at += 1
        if at < count and met_cm[at, 0] == x_cm and met_cm[at, 1] == y_cm:
            continue
        for later in range(count, at, -1):
            met_cm[later, 0], met_cm[later, 1] = met_cm[later - 1, 0], met_cm[later - 1, 1]
        met_cm[at, 0], met_cm[at, 1] = x_cm, y_cm
        count += 1
    return count


@compiled
def begin(settings, agent, works, now):
    """Say what the agent does from this step on: whether it walks, and whether it works."""
    begin_activity(settings, agent, agent.leg if agent.state == WALKING else NONE, works, now)
    begin_place(settings, agent, now)
    begin_arm(settings, agent, works, now)
