"""The truth as an array, only for `state()` of an environment."""

import numpy as np

from deltaswarm_learn.vectors import Vector
from deltaswarm_orchestrator.run.in_process import InProcess

AGENT_NUMBERS = 4
"""Numbers of each agent: place along x and y, whether it has a process, whether it is asked in this step."""

EVENT_NUMBERS = 6
"""Numbers of each open event: mask, place along x and y, share of its work done, whether sensed, whether told."""

MAX_STATE_EVENTS = 16
"""Number of open events in the state, the oldest first."""


def state_size(agents: int) -> int:
    """Return the length of the state for this many agents."""
    return AGENT_NUMBERS * agents + EVENT_NUMBERS * MAX_STATE_EVENTS


def state_of(swarm: InProcess, asked: set[int]) -> Vector:
    """Return the truth of a step as float32 numbers from -1 to 1: agents, then open events."""
    scenario, world = swarm.scenario, swarm.world
    arena, environment, told = scenario.arena, world.environment, swarm.operator.told_s
    size_m = np.array([arena.width_m, arena.height_m])
    agents = np.zeros((scenario.agents.count, AGENT_NUMBERS))
    agents[:, :2] = 2 * environment.positions_m / size_m - 1
    agents[list(world.participants.present), 2] = 1
    agents[list(asked), 3] = 1
    events = np.zeros((MAX_STATE_EVENTS, EVENT_NUMBERS))
    for row, event in zip(events, environment.active, strict=False):
        place = 2 * np.array([event.x_m, event.y_m]) / size_m - 1
        done = event.work_agent_s / scenario.events.work_agent_s
        row[:] = 1, *place, done, event.sensed_s is not None, event.event in told
    numbers: Vector = np.concatenate([agents.ravel(), events.ravel()]).clip(-1, 1).astype(np.float32)
    return numbers
