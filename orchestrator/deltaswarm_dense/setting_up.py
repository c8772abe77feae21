"""Make the arrays of a run: bodies, arrivals, generators and settings are those that the Python engine makes."""

import math
from typing import Any

import numpy as np

from deltaswarm_agent.controller import make_controller
from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.beliefs import GONE_MARGIN_M
from deltaswarm_agent.controllers.paper.finds import FIRST_FINDS, FIRST_S, WEIGHT_PER_S
from deltaswarm_agent.controllers.paper.frames import MAX_TABLE
from deltaswarm_agent.controllers.paper.recruitment import _cells_within
from deltaswarm_agent.controllers.paper.settings import ALL, ANY, LEAVES
from deltaswarm_agent.controllers.paper.timers import steps_of
from deltaswarm_agent.controllers.paper.whereabouts import AT_EVENT_RADII, AT_PLACE_M, RANGE_MARGIN_M
from deltaswarm_agent.core.commands import ANSWERED_S, FIRST_INTERVAL_S, LONGEST_INTERVAL_S
from deltaswarm_dense import layout
from deltaswarm_dense.layout import NONE, Air, Beliefs, Commands, Measures, News, Output, Recruits, Swarm, Trees, World
from deltaswarm_dense.step import BYTES_PER_AGENT
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.codec import MAX_RADIO_BYTES
from deltaswarm_wire.commands import MAX_COMMAND_BYTES
from deltaswarm_wire.envelope import MAX_COMMANDS
from deltaswarm_wire.messages import MAX_SENSED
from deltaswarm_world.core.environment import COVERAGE_EVERY_S, Environment

BLOCK_BYTES = 4_000_000
"""Size of the buffers whose bytes are hashed at once."""


def set_up(scenario: Scenario, environment: Environment, branches: int, beliefs: int, orders: int) -> Swarm:
    """Make the arrays of a run before its first step, with room for children, known events and orders.

    `environment` is that of a world in which nothing has happened; its arrivals are used up.
    """
    n = scenario.agents.count
    controllers: list[Any] = [make_controller(i, scenario.for_agent(i)) for i in range(n)]
    made: list[Agent] = [controller.agent for controller in controllers]
    settings, events = _settings(scenario, made[0]), _events(scenario, environment)
    rows, e = min(MAX_TABLE, max(1, n - 1)), len(events)
    agents = np.zeros(n, layout.AGENT)
    agents["id"] = np.arange(n)
    agents["x_m"], agents["y_m"] = environment.positions_m.T
    for name in ("target", "followed_order", "previous_root", "leg_ends", "noted_step", "averaged_leg", "back_step"):
        agents[name] = NONE
    agents["finds"], agents["walked_s"] = FIRST_FINDS, FIRST_S
    for row, agent in zip(agents, made, strict=True):
        *row["words"], row["used"] = agent.rng.getstate()[1]
        row["rank"], row["attends"] = agent.rank, agent.strategy.attends
        row["adapts"] = agent.finds is not None and agent.strategy.adapts
        row["founds_at"] = NONE if agent.strategy.founds_at is None else agent.strategy.founds_at
    frames = np.zeros((2, n), layout.FRAME)
    frames["kind"] = NONE
    cells = int(scenario.arena.width_m) + 1, int(scenario.arena.height_m) + 1
    bits = np.zeros(1)
    sensed = min(e, MAX_SENSED) if settings["has_finds"][0] or settings["report_finds"][0] else 0
    room = max(BLOCK_BYTES, 2 * n * BYTES_PER_AGENT)

    def tables(*shape: int) -> np.ndarray:
        return np.zeros((*shape, rows, layout.ROW_FIELDS), np.int64)

    def numbers(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.int64)

    return Swarm(
        settings=settings,
        agents=agents,
        trail_m=np.zeros((int(settings["trail"][0]), n, 2)),
        world=World(events, numbers(e + 1), numbers(2), numbers(e), numbers(e), numbers(e)),
        air=Air(frames, tables(2, n), numbers(n + 1), numbers(n)),
        trees=Trees(
            branches=np.zeros((n, branches), layout.BRANCH),
            branch_tables=tables(n, branches),
            children=numbers(n, branches),
            parents_tables=tables(n),
            heirs=numbers(n, rows + 2),
            table=tables(),
            marks=numbers(n),
            stamp=numbers(1),
        ),
        beliefs=Beliefs(np.zeros((n, beliefs), layout.UPDATE), np.zeros((n, beliefs), layout.PLACE), numbers(beliefs)),
        news=News(numbers(n, sensed), numbers(sensed + 1), numbers(n, 2)),
        recruits=Recruits(
            until=numbers(n, n),
            goals_m=np.zeros((n, n, 2)),
            members_m=np.zeros((rows + 1, 2)),
            scores=numbers(*cells),
            cells=np.array(_cells_within(math.ceil(scenario.agents.sensing_range_m)), np.int64),
        ),
        measures=Measures(
            densest_m=_densest_m(scenario, environment),
            distances_m=np.zeros(n),
            coverage_every=np.array([max(1, round(COVERAGE_EVERY_S / scenario.run.step_s))]),
            is_covered=numbers(
                *(max(1, round(side_m)) for side_m in (scenario.arena.width_m, scenario.arena.height_m))
            ),
        ),
        commands=Commands(
            given=np.zeros(orders, layout.COMMAND),
            bodies=np.zeros((orders, MAX_COMMAND_BYTES), np.uint8),
            sent=numbers(1),
            relays=np.zeros((n, orders), layout.RELAY),
            base=numbers(2 * MAX_COMMANDS + 1),
            reached=np.zeros(n, np.bool_),
            new=numbers(MAX_COMMANDS * (n + 1) + 1),
        ),
        output=Output(
            world=np.zeros(room, np.uint8),
            operator=np.zeros(room, np.uint8),
            ends=numbers(2),
            payload=np.zeros(4 * MAX_RADIO_BYTES, np.uint8),
            bits=(bits, bits.view(np.uint64)),
        ),
        trouble=numbers(1),
    )


def _densest_m(scenario: Scenario, environment: Environment) -> np.ndarray:
    step_s, find = scenario.run.step_s, environment.density.densest_m
    found = [find(step * step_s) for step in range(scenario.run.steps)]
    return np.array([(math.nan, math.nan) if place is None else place for place in found])


def _settings(scenario: Scenario, agent: Agent) -> np.ndarray:
    shared, control, strategy, timers = agent.shared, agent.settings, agent.strategy, agent.timers
    made = np.zeros(1, layout.SETTINGS)
    values = {
        "step_s": shared.step_s,
        "width_m": shared.width_m,
        "height_m": shared.height_m,
        "speed_mps": shared.speed_mps,
        "sensing_range_m": shared.sensing_range_m,
        "sensing_m2": shared.sensing_range_m**2,
        "gone_m2": (shared.sensing_range_m - GONE_MARGIN_M) ** 2,
        "near_cm2": (100.0 * max(0.0, shared.sensing_range_m - GONE_MARGIN_M)) ** 2,
        "range_m": shared.range_m,
        "range_m2": shared.range_m**2,
        "reach_m": shared.range_m - RANGE_MARGIN_M,
        "reach_m2": (shared.range_m - RANGE_MARGIN_M) ** 2,
        "d_min_m2": control.d_min_m**2,
        "at_place_m2": AT_PLACE_M**2,
        "at_event_m2": max(AT_PLACE_M, AT_EVENT_RADII * shared.radius_m) ** 2,
        "leg_max_s": control.leg_max_s,
        "leg_exponent": control.leg_exponent,
        "gamma_max": control.gamma_max,
        "patience_finds": control.patience_finds,
        "own_weight": (1.0 - WEIGHT_PER_S) ** shared.step_s,
        "report_every_s": control.report_every_s,
        "work_agent_s": scenario.events.work_agent_s,
        "two": 2.0,
        "half": 0.5,
        "first_interval": max(1, round(FIRST_INTERVAL_S / shared.step_s)),
        "longest_interval": max(1, round(LONGEST_INTERVAL_S / shared.step_s)),
        "answered": max(1, round(ANSWERED_S / shared.step_s)),
        "find_memory": steps_of(control.find_memory_s, shared.step_s),
        "recruit_every": steps_of(control.recruitment_interval_s, shared.step_s),
        "recruitment": control.recruitment,
        "dissolution": control.dissolution,
        "any_place": control.recruitment_places == ANY,
        "idle_root_leaves": control.idle_root == LEAVES,
        "root_succession": control.root_succession,
        "observes_all": control.member_observes == ALL,
        "report_members": control.report_members,
        "report_finds": control.report_finds,
        "has_finds": agent.finds is not None,
        "returns": agent.found is not None,
        "has_delta": strategy.has_delta,
        "ask_every_step": scenario.run.ask_every_step,
    }
    for name in layout.SETTINGS.names or ():
        made[name] = values[name] if name in values else getattr(timers, name)
    return made


def _events(scenario: Scenario, environment: Environment) -> np.ndarray:
    """Return all events of a run, each with the step in which it arrives, in the order of arrival."""
    step_s, steps, arrivals = scenario.run.step_s, scenario.run.steps, environment._arrivals
    found = [(arrival, step) for step in range(steps) for arrival in arrivals.until(step * step_s)]
    found += [(arrival, steps) for arrival in arrivals.until((steps - 1) * step_s + step_s)]
    events = np.zeros(len(found), layout.EVENT)
    for name in ("sensed_s", "told_s", "worked_s", "completed_s"):
        events[name] = math.nan
    for row, (arrival, step) in zip(events, found, strict=True):
        row["id"], row["x_m"], row["y_m"], row["arrived_s"], row["step"] = *arrival, step
    return events
