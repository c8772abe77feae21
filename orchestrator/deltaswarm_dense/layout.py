"""The arrays of a run: one record per agent, event, radio frame and branch of a tree. Positions in m, arena frame.

Integers are int64 except in tables, since arithmetic on them must not overflow or change their type.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from deltaswarm_agent.controllers.paper.bandit import ARMS
from deltaswarm_agent.controllers.paper.frames import MAX_EVENTS, MAX_GONE, MAX_PATH, Averages, Tried
from deltaswarm_agent.controllers.paper.policy import INPUTS
from deltaswarm_agent.controllers.paper.returning import MAX_PLACES
from deltaswarm_wire.envelope import MAX_COMMANDS

WORDS = 624

MAX_ORDERS = 4096
"""Orders of the operator in a run."""

NONE = -1
"""No event, no order, no step."""

ORDER_FIELDS = 5
LEAF, ORDER_X_CM, ORDER_Y_CM, ORDER_NUMBER, TTL = range(ORDER_FIELDS)

ROW_FIELDS = 5
AGENT_ID, PARENT, ROW_X_CM, ROW_Y_CM, SCORE = range(ROW_FIELDS)
"""A row of a member's table (`frames.Descendant`)."""


def record(
    floats: str = "",
    whole: str = "",
    flags: str = "",
    words: int = 0,
    float_arrays: Mapping[str, int] | None = None,
    **arrays: int,
) -> np.dtype[np.void]:
    """Return the type of a record with these fields, and with arrays of floats and of whole numbers of some lengths."""
    kinds: tuple[tuple[str, Any], ...] = ((floats, np.float64), (whole, np.int64), (flags, np.bool_))
    fields: list[Any] = [(name, kind) for names, kind in kinds for name in names.split()]
    fields += [(name, np.float64, (length,)) for name, length in (float_arrays or {}).items()]
    fields += [(name, np.int64, (length,)) for name, length in arrays.items()]
    return np.dtype(fields + ([("words", np.uint32, (words,))] if words else []), align=True)


SETTINGS = record(
    floats="""
    step_s width_m height_m speed_mps sensing_range_m sensing_m2 gone_m2 near_cm2 range_m range_m2 reach_m reach_m2
    d_min_m2 at_place_m2 at_event_m2 leg_max_s leg_exponent gamma_max patience_finds own_weight report_every_s
    work_agent_s loss two half
    """,
    whole="""
    first_interval longest_interval answered forget_sender recruit_every silence stall freshness previous_tree leaving
    orphan_strict orphan arrival_strict arrival contested order memory gone trail find_memory
    """,
    flags="""
    recruitment dissolution any_place idle_root_leaves root_succession observes_all report_members
    report_finds ask_every_step has_finds returns has_delta learns tries is_modelled
    """,
)
"""The scenario's keys and what follows from them. Squares are Python's own, so that comparisons are the same ones.

`two` and `half` are exponents: a power with a constant exponent would be compiled as a product or a root, which
Python's is not (`arithmetic.py`). Times are in steps. `own_weight` is that of an agent's own averages beside those of
one that it hears (`Finds._kept`); `has_finds` says whether a rule needs averages, `returns` whether places of finds,
`learns` whether agents have a policy, `tries` whether they have a bandit, `is_modelled` whether Python moves bodies and
carries frames (`modelled.py`).
"""

AGENT = record(
    floats="""
    x_m y_m vx_mps vy_mps target_x_m target_y_m leg_vx_mps leg_vy_mps gamma idle_s goal_x_m goal_y_m report_due_s
    busy back_x_m back_y_m rank price_s events_s sensing_s attending_heard members_heard reports_hz in_trees
    """,
    whole="""
    id role state target leg_ends until counter sequence used path_length pulse pulse_step parent_heard parents_rows
    heirs children contested_steps followed_order since leave_frames_left previous_root previous_pulse
    previous_pulse_step freed updates places delta noted noted_step leg averaged_step averaged_leg back_step found
    founds_at strategy_command knows began rule noted_until entered last_found changed arm arms_step
    """,
    flags="in_tree sensed_before has_order has_carried works attends was_in_tree arm_works takes_part sees has_status",
    words=WORDS,
    float_arrays={
        "finds": 2,
        "walked_s": 2,
        "found_x_m": MAX_PLACES,
        "found_y_m": MAX_PLACES,
        "inputs": len(INPUTS),
        "arm_s": len(ARMS),
        "arm_work_s": len(ARMS),
        "arm_messages": len(ARMS),
    },
    found_step=MAX_PLACES,
    path=MAX_PATH + 1,
    order=ORDER_FIELDS,
    carried=ORDER_FIELDS,
)
"""One agent: `agent.Agent`, its `Membership`, its walk, its counters and its generator, a Mersenne Twister of `words`
of which some are `used`. `target` is an event's number, or NONE. Of `Finds` it has the averages `finds`, `walked_s` and
`busy`, up to `averaged_step`, since which it `works` and is on the kind of leg `averaged_leg` (NONE: it does not walk);
of `FoundPlaces` the `found` first of its places, and the one to which its leg leads back (`back_step` NONE: to none).
`noted` events were sensed in `noted_step`; these are in `News.noted`. `founds_at` (NONE: it never
founds a tree), `attends`, `rule` and `price_s` follow the newest order, `strategy_command`; it `knows` so many. Of
`Experience` it has the averages, up to `noted_until` and `entered`, and the steps `last_found` and `changed`; `inputs`
are its policy's. Of `Bandit` it has the counts, up to `arms_step`, since which it follows `arm`. Its process `began`
before that step, and `takes_part` unless it is dead or frozen; `has_status` if it has acted since."""

EVENT = record("x_m y_m arrived_s sensed_s told_s worked_s completed_s work_agent_s", "id step")
"""One event, in the order of arrival; times are NaN until they come. It arrives in `step`."""

UPDATE = record(whole="event step")
PLACE = record(whole="event x_cm y_cm")
"""Entries of `beliefs.Beliefs`, in the order of Python's dictionaries."""

BRANCH = record(whole="child x_cm y_cm score heard rows")
"""A child in a tree (`membership.Branch`); its table is in `Swarm.branch_tables`."""

FRAME = record(
    whole="""
    kind x_cm y_cm path_length pulse score rows sightings departures event event_x_cm event_y_cm size_bytes items
    counter begins
    """,
    flags="orphan has_order",
    path=MAX_PATH,
    order=ORDER_FIELDS,
    sighting=4 * MAX_EVENTS,
    departure=2 * MAX_GONE,
    averages=len(Averages._fields) - 1,
    tried=len(Tried._fields),
    item=2 * MAX_COMMANDS,
)
"""A radio frame as its receivers decode it, and where in `Output.world` it `begins`; `kind` is NONE if it has no
payload. Its table is in `Air.tables`. An item is a command that it relays, with the remaining steps of its life."""

COMMAND = record("fraction share price_s", "delta life body_bytes", "sets_share sets_price")
"""An order to all agents: the delta of agents whose rank is not below `fraction` (of the others one more), and the
share of agents that work outside trees, if it `sets_share`; or the price of a message, if it `sets_price`. Its life is
in steps."""

RELAY = record(whole="standing ends latest_end send_at interval state")
"""A command that an agent knows (`core.commands._Known`)."""

UNKNOWN, KNOWN_COMMAND, FORGOTTEN = range(3)
"""Standings of a command with an agent; only a known one is relayed and acknowledged."""

COUNTS = record(
    "roots_from_densest_m",
    """
    asked in_trees roots covered_area_m2 frames_sent bytes_sent frames_received frames_lost reports refused_claims
    events_open events_completed deltas deltas_sum news world_end operator_end
    """,
)
"""What happened in one step; the last two are where its bytes end in the buffers of both digests.

`covered_area_m2` is NONE in steps in which it is not measured, `roots_from_densest_m` NaN where there is none.
"""


# n agents, e events, b branches per agent, r rows per table, k beliefs per agent, s sensed events.


class World(NamedTuple):
    """All events of a run, and what agents sense of them."""

    events: np.ndarray
    """(e,) EVENT"""
    active: np.ndarray
    """(e + 1,) events that have arrived and are not complete; the last item is their number."""
    arrived: np.ndarray
    """(2,) number of events that have arrived, and of those completed."""
    observers: np.ndarray
    """(e,) agents that work on each event in this step."""
    sensed: np.ndarray
    """(e,) scratch: events that an agent senses."""
    observed: np.ndarray
    """(e,) scratch: events that an agent works on."""


class Air(NamedTuple):
    """The radio frames of the last steps, and those that the air's models let through in this one."""

    frames: np.ndarray
    """(slots, n) FRAME: those sent in step s are in slot s % slots."""
    tables: np.ndarray
    """(slots, n, r, 5) rows of their tables."""
    senders: np.ndarray
    """(n + 1,) agents that sent a frame in the step before; the last item is their number."""
    arrived: np.ndarray
    """(n, 2) scratch: sender and slot of each frame that an agent receives."""
    heard: np.ndarray
    """(n,) scratch: senders of the frames that it reads."""
    slots: np.ndarray
    """(n,) scratch: the slots of these frames, by sender."""
    carried: np.ndarray
    """(receptions, 2) sender and slot of each frame that the models let through, by receiver."""
    begins: np.ndarray
    """(n + 1,) where each receiver's begin in `carried`."""
    draws: np.ndarray
    """Uniform draws of the loss of frames, one for each link in reach in each step."""
    drawn: np.ndarray
    """(1,) how many of them are used."""
    newest: np.ndarray
    """(n, n, 2) counter and step of the newest frame of each sender that each receiver has heard."""


class Trees(NamedTuple):
    """What agents know of their trees."""

    branches: np.ndarray
    """(n, b) BRANCH"""
    branch_tables: np.ndarray
    """(n, b, r, 5)"""
    children: np.ndarray
    """(n, b) places in `branches`, in the order of the children."""
    parents_tables: np.ndarray
    """(n, r, 5) the parent's table, if a lost root has a successor."""
    heirs: np.ndarray
    """(n, r + 2) heirs of a lost root."""
    table: np.ndarray
    """(r, 5) scratch: an agent's own table."""
    marks: np.ndarray
    """(n,) scratch: the agents that are marked by the present `stamp`, such as those that are in a table."""
    stamp: np.ndarray
    """(1,)"""


class Beliefs(NamedTuple):
    """What agents know of events."""

    updates: np.ndarray
    """(n, k) UPDATE"""
    places: np.ndarray
    """(n, k) PLACE"""
    sorted: np.ndarray
    """(k,) scratch: known places in the order of their events' ids."""


class News(NamedTuple):
    """What agents have just come upon (`Agent.note`, `learning.py`)."""

    noted: np.ndarray
    """(n, s) events that each agent sensed when it was last asked."""
    new: np.ndarray
    """(s + 1,) scratch: those that an agent did not sense in the step before; the last item is their number."""
    met_cm: np.ndarray
    """(n, 2) scratch: where agents that this one has met attend to events."""


class Recruits(NamedTuple):
    """What a root knows of the agents that it has recruited, and the search for their places."""

    until: np.ndarray
    """(n, n) until when the goal of each agent that a root recruited is taken; 0: it is not."""
    goals_m: np.ndarray
    """(n, n, 2) these goals."""
    members_m: np.ndarray
    """(r + 1, 2) scratch: positions of a tree's members."""
    scores: np.ndarray
    """(columns, rows) scratch: how many known events are sensed from each cell of the arena."""
    cells: np.ndarray
    """(c, 2) offsets of the cells that can be within sensing range of an event (`recruitment._cells_within`)."""


class Measures(NamedTuple):
    """What series tell of trees and no agent knows."""

    densest_m: np.ndarray
    """(steps, 2) where events are densest; NaN where they are equally dense everywhere."""
    distances_m: np.ndarray
    """(n,) scratch: distances of roots from there."""
    coverage_every: np.ndarray
    """(1,) steps between two measurements of the covered area."""
    is_covered: np.ndarray
    """(columns, rows) scratch: the stamp of the step in which a cell was covered last."""


class Commands(NamedTuple):
    """The operator's orders: c numbers from 0."""

    given: np.ndarray
    """(c,) COMMAND"""
    bodies: np.ndarray
    """(c, bytes) uint8: as they are encoded."""
    sent: np.ndarray
    """(1,) how many have left the base."""
    relays: np.ndarray
    """(n, c) RELAY"""
    base: np.ndarray
    """(2 i + 1,) the items of the base's frame in this step, as in a FRAME; the last item is their number."""
    reached: np.ndarray
    """(n,) whether each agent hears that frame."""
    new: np.ndarray
    """(k + 1,) scratch: numbers of the commands that an agent has to carry out; the last item is their number."""


class Output(NamedTuple):
    """The bytes that the digests are made of."""

    world: np.ndarray
    """uint8 buffer of the acts and radio frames of some steps, with the heads of the digest."""
    operator: np.ndarray
    """The same of reports."""
    ends: np.ndarray
    """(2,) where the next byte goes in these."""
    payload: np.ndarray
    """uint8 scratch: the payload of one radio frame."""
    bits: tuple[np.ndarray, np.ndarray]
    """(1,) float64, and the same as uint64: the bytes of a float."""


class Swarm(NamedTuple):
    """All arrays of a run."""

    settings: np.ndarray
    """(1,) SETTINGS"""
    agents: np.ndarray
    """(n,) AGENT"""
    trail_m: np.ndarray
    """(trail, n, 2) positions of the last steps; that of step s is in s % trail."""
    world: World
    air: Air
    trees: Trees
    beliefs: Beliefs
    news: News
    recruits: Recruits
    measures: Measures
    commands: Commands
    policy: np.ndarray
    """(w,) the numbers of the agents' policy; none without one."""
    output: Output
    trouble: np.ndarray
    """(1,) why the run cannot go on here; see `TROUBLE`."""


TROUBLE = (
    "",
    "too many children",
    "too many known events",
    "a radio frame above the limit",
    "more sensed or heard than an agent's frame has room for",
    "too many bytes or frames at once",
    "a radio frame that arrives too late",
)
CHILDREN, KNOWN, FRAME_SIZE, FRAME_ROOM, BUFFER, OLD_FRAME = range(1, 7)
