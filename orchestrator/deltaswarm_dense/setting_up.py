"""Make the arrays of a run: bodies, arrivals, generators and settings are those that the Python engine makes."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from deltaswarm_agent.controller import ControllerContext, agent_rng
from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.beliefs import GONE_MARGIN_M
from deltaswarm_agent.controllers.paper.experience import FIRST_S as FIRST_SENSING_S
from deltaswarm_agent.controllers.paper.finds import FIRST_FINDS, FIRST_S, WEIGHT_PER_S
from deltaswarm_agent.controllers.paper.frames import MAX_TABLE
from deltaswarm_agent.controllers.paper.recruitment import _cells_within
from deltaswarm_agent.controllers.paper.settings import ALL, ANY, LEAVES
from deltaswarm_agent.controllers.paper.timers import steps_of
from deltaswarm_agent.controllers.paper.whereabouts import AT_EVENT_RADII, AT_PLACE_M, RANGE_MARGIN_M
from deltaswarm_agent.core.agent_core import FORGET_SENDER_S
from deltaswarm_agent.core.commands import ANSWERED_S, FIRST_INTERVAL_S, LONGEST_INTERVAL_S
from deltaswarm_dense import layout
from deltaswarm_dense.delta import RULES
from deltaswarm_dense.layout import NONE, Air, Beliefs, Commands, Measures, News, Output, Recruits, Swarm, Trees, World
from deltaswarm_dense.step import BYTES_PER_AGENT
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.codec import MAX_RADIO_BYTES
from deltaswarm_wire.commands import MAX_COMMAND_BYTES
from deltaswarm_wire.envelope import MAX_COMMANDS
from deltaswarm_wire.messages import MAX_SENSED
from deltaswarm_wire.plugins import controller_settings
from deltaswarm_wire.seeds import agent_seed
from deltaswarm_world.core.environment import COVERAGE_EVERY_S, Environment

DRAWS = 100_000
"""Draws of a random effect that are made at once."""

BLOCK_BYTES = 4_000_000
"""Size of the buffers whose bytes are hashed at once."""


Redraw = tuple[int, int] | None
"""The step from which on arrivals are drawn anew, and their seed."""


class Room(NamedTuple):
    """What the arrays of a run have room for."""

    branches: int = 16
    """Children of an agent."""
    beliefs: int = 64
    """Events that an agent knows."""
    slots: int = 2
    """Steps whose frames are kept."""
    orders: int = 0


def set_up(
    scenario: Scenario, environment: Environment, has: Room, *, is_modelled: bool, redraw: Redraw = None
) -> Swarm:
    """Make the arrays of a run before its first step.

    `environment` is that of a world in which nothing has happened; its arrivals are used up.
    """
    n = scenario.agents.count
    made = _made(scenario, range(n))
    settings, events = _settings(scenario, made[0]), events_in_order(scenario, environment, redraw)
    loss = 0.0 if is_modelled else scenario.radio.loss
    settings["is_modelled"], settings["loss"] = is_modelled, loss
    rows, e = min(MAX_TABLE, max(1, n - 1)), len(events)
    agents = _rows(made)
    agents["id"] = np.arange(n)
    agents["x_m"], agents["y_m"] = environment.positions_m.T
    frames = np.zeros((has.slots, n), layout.FRAME)
    frames["kind"] = NONE
    cells = int(scenario.arena.width_m) + 1, int(scenario.arena.height_m) + 1
    draws, bits = room_for_draws(loss, n), np.zeros(1)
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
        world=world_of(events),
        air=Air(
            frames=frames,
            tables=tables(has.slots, n),
            senders=numbers(n + 1),
            arrived=numbers(n, 2),
            heard=numbers(n),
            slots=numbers(n),
            carried=numbers(2 * n * n if is_modelled else 0, 2),
            begins=numbers(n + 1),
            draws=draws,
            drawn=np.array([len(draws)]),
            newest=np.full((n, n, 2) if is_modelled else (0, 0, 2), NONE),
        ),
        trees=Trees(
            branches=np.zeros((n, has.branches), layout.BRANCH),
            branch_tables=tables(n, has.branches),
            children=numbers(n, has.branches),
            parents_tables=tables(n),
            heirs=numbers(n, rows + 2),
            table=tables(),
            marks=numbers(n),
            stamp=numbers(1),
        ),
        beliefs=Beliefs(
            updates=np.zeros((n, has.beliefs), layout.UPDATE),
            places=np.zeros((n, has.beliefs), layout.PLACE),
            sorted=numbers(has.beliefs),
        ),
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
            given=np.zeros(has.orders, layout.COMMAND),
            bodies=np.zeros((has.orders, MAX_COMMAND_BYTES), np.uint8),
            sent=numbers(1),
            relays=np.zeros((n, has.orders), layout.RELAY),
            base=numbers(2 * MAX_COMMANDS + 1),
            reached=np.zeros(n, np.bool_),
            new=numbers(MAX_COMMANDS * (n + 1) + 1),
        ),
        policy=np.array(made[0].settings.policy, np.float64),
        output=Output(
            world=np.zeros(room, np.uint8),
            operator=np.zeros(room, np.uint8),
            ends=numbers(2),
            payload=np.zeros(4 * MAX_RADIO_BYTES, np.uint8),
            bits=(bits, bits.view(np.uint64)),
        ),
        trouble=numbers(1),
    )


def world_of(events: np.ndarray) -> World:
    """Return the arrays of a world in which none of its events has arrived."""
    count = len(events)
    return World(events, *(np.zeros(size, np.int64) for size in (count + 1, 2, count, count, count)))


def room_for_draws(loss: float, agents: int) -> np.ndarray:
    """Return an array for draws of the loss of frames, for at least two steps; an empty one if none is lost."""
    return np.zeros(max(DRAWS, 2 * agents * agents) if loss else 0)


def draw_losses(air: Any, rng: np.random.Generator) -> None:
    """Replace the used draws by new ones, in the order of the generator, if the rest may be too few for a step."""
    agents, used = len(air.senders) - 1, int(air.drawn[0])
    if used and len(air.draws) - used < agents * agents:
        air.draws[:-used] = air.draws[used:]
        air.draws[-used:] = rng.random(used)
        air.drawn[0] = 0


def _made(scenario: Scenario, agents: Iterable[int], restart: int = 0) -> list[Agent]:
    """Make agents as `make_controller` does; their settings, of which only the seeds differ, are checked once."""
    control, first = scenario.control, scenario.for_agent(0)
    own, made = controller_settings(control.mode, control.options, first), []
    for agent in agents:
        shared = replace(first, seed=agent_seed(scenario.seed, agent))
        rng = agent_rng(shared.seed, agent, restart)
        made.append(Agent(ControllerContext(agent, control.mode, own, shared, rng)))
    return made


def _rows(made: Sequence[Agent]) -> np.ndarray:
    """Return the rows of agents that have just been made, without their ids and places."""
    rows = np.zeros(len(made), layout.AGENT)
    steps = "noted_step", "arms_step", "back_step"
    for name in ("target", "followed_order", "previous_root", "leg_ends", "averaged_leg", *steps):
        rows[name] = NONE
    rows["finds"], rows["walked_s"] = FIRST_FINDS, FIRST_S
    rows["events_s"] = rows["sensing_s"] = FIRST_SENSING_S
    rows["takes_part"] = rows["sees"] = True
    for row, agent in zip(rows, made, strict=True):
        *row["words"], row["used"] = agent.rng.getstate()[1]
        row["rank"], row["attends"] = agent.rank, agent.strategy.attends
        row["rule"], row["price_s"] = RULES.index(agent.strategy.rule), agent.price_s
        row["founds_at"] = NONE if agent.strategy.founds_at is None else agent.strategy.founds_at
    return rows


def begin_again(scenario: Scenario, swarm: Swarm, agent: int, restart: int, step: int) -> None:
    """Put a new process in an agent's body, which stands still; this is its n-th `restart`."""
    kept = {name: swarm.agents[agent][name] for name in ("id", "x_m", "y_m")}
    swarm.agents[agent] = _rows(_made(scenario, [agent], restart))[0]
    for name, value in kept.items():
        swarm.agents[agent][name] = value
    swarm.agents[agent]["began"] = step
    swarm.recruits.until[agent] = 0
    swarm.commands.relays[agent] = 0
    swarm.air.newest[agent] = NONE


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
        "learns": agent.experience is not None,
        "tries": agent.bandit is not None,
        "ask_every_step": scenario.run.ask_every_step,
        "forget_sender": round(FORGET_SENDER_S / shared.step_s),
        "is_modelled": False,
        "loss": 0.0,
    }
    for name in layout.SETTINGS.names or ():
        made[name] = values[name] if name in values else getattr(timers, name)
    return made


def events_in_order(scenario: Scenario, environment: Environment, redraw: Redraw = None) -> np.ndarray:
    """Return all events of a run, each with the step in which it arrives, in the order of arrival."""
    step_s, steps, arrivals = scenario.run.step_s, scenario.run.steps, environment._arrivals
    found = []
    for step in range(steps):
        if redraw is not None and step == redraw[0]:
            arrivals.redraw(redraw[1], (step - 1) * step_s)
        found += [(arrival, step) for arrival in arrivals.until(step * step_s)]
    found += [(arrival, steps) for arrival in arrivals.until((steps - 1) * step_s + step_s)]
    events = np.zeros(len(found), layout.EVENT)
    for name in ("sensed_s", "told_s", "worked_s", "completed_s"):
        events[name] = math.nan
    for row, (arrival, step) in zip(events, found, strict=True):
        row["id"], row["x_m"], row["y_m"], row["arrived_s"], row["step"] = *arrival, step
    return events
