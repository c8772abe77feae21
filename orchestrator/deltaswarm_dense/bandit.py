"""Learning while it runs (`controllers/paper/bandit.py`)."""

import math

import numpy as np

from deltaswarm_agent.controllers.paper.bandit import ARMS, EXPLORES, FADING_S, MEAN_S
from deltaswarm_dense.arithmetic import rounded
from deltaswarm_dense.compiled import compiled
from deltaswarm_dense.delta import BANDIT
from deltaswarm_dense.finds import tells_averages
from deltaswarm_dense.hearing import heard_of
from deltaswarm_dense.layout import NONE
from deltaswarm_dense.randomness import place_of_choice, random

COUNT = len(ARMS)
FOUNDS_AT = np.array([NONE if arm.founds_at is None else arm.founds_at for arm in ARMS])
ATTENDS = np.array([arm.attends for arm in ARMS])
ARM, TIME, WORK, MESSAGES = range(4)
"""The places of what a frame tells (`frames.Tried`)."""


@compiled
def update_arms(settings, agent, now):
    """Let the time since the last update pass (`Bandit.update`)."""
    passed_s = 0.0 if agent.arms_step == NONE else (now - agent.arms_step) * settings.step_s
    agent.arms_step = now
    if passed_s <= 0.0:
        return
    kept = math.exp(-passed_s / FADING_S)
    for arm in range(COUNT):
        agent.arm_s[arm] *= kept
        agent.arm_work_s[arm] *= kept
        agent.arm_messages[arm] *= kept
    if agent.rule != BANDIT:  # an order says which structure the agent has
        return
    agent.arm_s[agent.arm] += FADING_S * (1.0 - kept)
    if agent.arm_works:
        agent.arm_work_s[agent.arm] += FADING_S * (1.0 - kept)


@compiled
def begin_arm(settings, agent, works, now):
    """Say whether the agent works from this step on (`Bandit.begin`)."""
    if works != agent.arm_works or agent.arms_step == NONE:
        update_arms(settings, agent, now)
        agent.arm_works = works


@compiled
def count_message(settings, agent, now):
    """Count a report (`Bandit.report`)."""
    update_arms(settings, agent, now)
    if agent.rule == BANDIT:
        agent.arm_messages[agent.arm] += 1.0


@compiled
def follow_arm(settings, agent, arm, now):
    """Count what comes from this step on for another structure (`Bandit.follow`)."""
    update_arms(settings, agent, now)
    agent.arm = arm


@compiled
def take_arm(agent):
    """Have the structure that the agent follows (`Agent.take`)."""
    agent.founds_at, agent.attends = FOUNDS_AT[agent.arm], ATTENDS[agent.arm]


@compiled
def _cost_of(agent, arm):
    return agent.busy * agent.arm_s[arm] + agent.price_s * agent.arm_messages[arm]


@compiled
def _best_arm(agent):
    total, work_s, best, least = 0.0, 0.0, 0, math.inf
    for arm in range(COUNT):
        total += _cost_of(agent, arm)
        work_s += agent.arm_work_s[arm]
    mean = total / (work_s + MEAN_S)
    for arm in range(COUNT):
        cost = (_cost_of(agent, arm) + MEAN_S * mean) / (agent.arm_work_s[arm] + MEAN_S)
        if cost < least:
            best, least = arm, cost
    return best


@compiled
def choose_arm(settings, agent, now):
    """Choose a structure, and follow it (`Bandit.choose`)."""
    update_arms(settings, agent, now)
    agent.arm = place_of_choice(agent, COUNT) if random(agent) < EXPLORES else _best_arm(agent)
    take_arm(agent)


@compiled
def hear_arms(settings, agent, air, now, heard):
    """Mix in what others know of the structures that they follow (`Bandit.hear`)."""
    for arm in range(COUNT):
        count = time_ds = work_ds = messages_milli = 0
        for k in range(heard.size):
            frame = heard_of(air, heard[k])
            if tells_averages(frame) and frame.tried[ARM] == arm:
                count += 1
                time_ds += frame.tried[TIME]
                work_ds += frame.tried[WORK]
                messages_milli += frame.tried[MESSAGES]
        if count:
            update_arms(settings, agent, now)
            kept = math.pow(settings.own_weight, float(count))
            share = (1.0 - kept) / count
            agent.arm_s[arm] = kept * agent.arm_s[arm] + share * time_ds / 10
            agent.arm_work_s[arm] = kept * agent.arm_work_s[arm] + share * work_ds / 10
            agent.arm_messages[arm] = kept * agent.arm_messages[arm] + share * messages_milli / 1000


@compiled
def tell_arm(settings, agent, frame, now):
    """Write what a frame tells of its sender's structure, with NONE for nothing (`Bandit.told`)."""
    update_arms(settings, agent, now)
    frame.tried[ARM] = agent.arm if agent.rule == BANDIT else NONE
    frame.tried[TIME] = rounded(10 * agent.arm_s[agent.arm])
    frame.tried[WORK] = rounded(10 * agent.arm_work_s[agent.arm])
    frame.tried[MESSAGES] = rounded(1000 * agent.arm_messages[agent.arm])
