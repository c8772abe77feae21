"""The settings of a run, with the paper's values as defaults.

`source` says where a default comes from: "paper", or "our reading" where the paper is silent.
"""

import hashlib
import json
import re
from copy import deepcopy
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from deltaswarm_scenario.density import DensitySettings, density_problems, room_problems
from deltaswarm_scenario.fault import FaultSettings, fault_problems
from deltaswarm_scenario.operator_links import (
    CommandSettings,
    DownlinkSettings,
    UplinkSettings,
    downlink_problems,
    uplink_problems,
)
from deltaswarm_scenario.operator_settings import Briefing, OperatorSettings, begun_with
from deltaswarm_scenario.radio import RadioSettings, radio_problems
from deltaswarm_wire.checked import OURS, PAPER, Problem, key, plain, rest
from deltaswarm_wire.codec import MAX_STEP
from deltaswarm_wire.commands import BASE_ID, CommandForm
from deltaswarm_wire.obstacles import ObstacleSettings, obstacle_problems
from deltaswarm_wire.plugins import DYNAMICS, find, is_reading
from deltaswarm_wire.settings import AgentSettings, ControlSettings

CLOCKS = ("lockstep", "realtime")
MAX_SEED = 2**63 - 1

RECORDS = ("off", "views", "wire")

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,47}")
"""Shorter than a run's name (64), to leave room for what distinguishes runs of one scenario."""


BOUNDS = ("none", "density", "everything")
"""Everything: the density, and every event from its arrival. A bound is computed in one process only."""


MAX_AREA_M2 = 1e8
"""Greatest area of the arena, on which densities and covered areas are computed by the square metre."""


@dataclass(frozen=True)
class RunSettings:
    """Duration and pace."""

    duration_s: float = key(9000.0, "simulated time of a run [s]", source=PAPER, above=0, high=1e8)
    step_s: float = key(1.0, "length of a step [s]", source="paper (implied)", low=0.01, high=60)
    clock: str = key("lockstep", "as fast as possible, or paced by the wall clock", choices=CLOCKS)
    real_time_factor: float = key(1.0, "simulated seconds per wall second, with clock realtime", above=0, high=1e4)
    bound: str = key(
        "none", "replaces the controller by a planner with perfect communication that also knows this", choices=BOUNDS
    )
    ask_every_step: bool = key(False, "ask every agent in every step, even if its last act still holds")
    step_timeout_s: float = key(
        5.0, "wall time after which the world continues without an agent [s]", low=0.05, high=3600
    )
    start_timeout_s: float = key(60.0, "wall time within which all processes must be up [s]", low=1, high=3600)
    accept_lost: float = key(
        0.0,
        "agents that may fail or hang in a valid run: a share of them below 1, else their number; faults do not count",
        low=0,
        high=10_000,
    )

    def accepts_lost(self, lost: int, agents: int) -> bool:
        """Whether a run is valid if `lost` of its agents fail or hang."""
        return lost <= (self.accept_lost if self.accept_lost >= 1 else self.accept_lost * agents + 1e-9)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return round(self.duration_s / self.step_s)

    def problems(self) -> list[Problem]:
        """Check that a run has a whole number of steps, and that a number of agents is whole."""
        problems = []
        if self.steps < 1 or abs(self.steps * self.step_s - self.duration_s) > 1e-9 * self.duration_s:
            allowed = f"must be a whole number of steps of {self.step_s:.15g} s"
            problems.append(Problem("duration_s", f"{self.duration_s:.15g}", allowed))
        if self.accept_lost > 1 and not self.accept_lost.is_integer():
            allowed = "must be a share below 1 or a whole number of agents"
            problems.append(Problem("accept_lost", f"{self.accept_lost:.15g}", allowed))
        return problems


@dataclass(frozen=True)
class ArenaSettings:
    """The bounded environment Q (Experimental Setup), a rectangle from (0, 0)."""

    width_m: float = key(100.0, "extent along x [m]", source=PAPER, low=1, high=1e5)
    height_m: float = key(100.0, "extent along y [m]", source=PAPER, low=1, high=1e5)
    obstacles: tuple[ObstacleSettings, ...] = key(
        (), "obstacles to motion, sensing and radio, as tables of corners_m, attenuation_db"
    )


@dataclass(frozen=True)
class EventSettings:
    """Events that arrive, wait, and are observed until complete."""

    rate_hz: float = key(0.05, "Poisson arrivals per second", source=OURS, low=0, high=1000)
    rates_hz: tuple[float, ...] = key((), "other rates that follow in the run [1/s]", low=0, high=1000)
    rates_s: tuple[float, ...] = key((), "time from which each of rates_hz holds [s]", above=0, high=1e8)
    work_agent_s: float = key(200.0, "work to complete an event", source=PAPER, above=0)
    density: DensitySettings = key(DensitySettings, "their spatial density")

    def problems(self) -> list[Problem]:
        """Each later rate has a time, and the times are in order."""
        if len(self.rates_s) != len(self.rates_hz):
            counts = f"{len(self.rates_s)} for {len(self.rates_hz)} rates"
            return [Problem("rates_s", counts, "must have one time for each of rates_hz")]
        return [
            Problem(f"rates_s[{index}]", f"{later:.15g}", f"must be above the time before it, {earlier:.15g} s")
            for index, (earlier, later) in enumerate(pairwise(self.rates_s), 1)
            if later <= earlier
        ]


@dataclass(frozen=True)
class MetricsSettings:
    """How a run is measured."""

    horizon_s: float = key(
        600.0,
        "time for which each event is followed [s]; longer times count as this, and events later than this before the "
        "end do not count",
        source=OURS,
        above=0,
    )


@dataclass(frozen=True)
class SwarmSettings:
    """The agents' number and bodies."""

    count: int = key(25, "number of agents", source=PAPER, low=1, high=10_000)
    speed_mps: float = key(1.0, "maximum speed [m/s]", source=PAPER, above=0, high=100)
    sensing_range_m: float = key(5.0, "sensing range for events [m]", source="paper (scalability)", above=0)


@dataclass(frozen=True)
class WorldSettings:
    """How bodies move; the dynamics' `Settings` class checks its options."""

    dynamics: str = key("point", "how bodies move: point, an entry point, or module:Class", source=PAPER)
    options: dict[str, Any] = rest("the dynamics' own options")

    @property
    def radius_m(self) -> float:
        """The radius of a body [m]; 0 for points."""
        return float(self.options.get("radius_m", 0.0))

    @property
    def to_process(self) -> bool:
        """Whether bodies can crash, which ends the processes of their agents."""
        return bool(getattr(find(DYNAMICS, self.dynamics, "world.dynamics"), "to_process", False))


@dataclass(frozen=True)
class Scenario:
    """A whole experiment. Every key can be given in TOML and by `--set key=value`."""

    schema: int = key(1, "version of this table", low=1, high=1)
    name: str = key("unnamed", "part of the run folder's name")
    seed: int = key(1, "seed for all randomness", low=0, high=MAX_SEED)
    record: str = key("views", "what is recorded: nothing, what viewers show, or also every raw frame", choices=RECORDS)
    run: RunSettings = key(RunSettings, "duration and pace")
    arena: ArenaSettings = key(ArenaSettings, "the bounded environment")
    events: EventSettings = key(EventSettings, "events in the arena")
    agents: SwarmSettings = key(SwarmSettings, "the swarm")
    world: WorldSettings = key(WorldSettings, "how bodies move")
    radio: RadioSettings = key(RadioSettings, "radio between agents")
    control: ControlSettings = key(ControlSettings, "the agents' controller")
    operator: OperatorSettings = key(OperatorSettings, "the operator and its workload")
    metrics: MetricsSettings = key(MetricsSettings, "how the run is measured")
    uplink: UplinkSettings = key(UplinkSettings, "radio from agents to the operator")
    downlink: DownlinkSettings = key(DownlinkSettings, "radio from the operator to agents")
    command: tuple[CommandSettings, ...] = key((), "timeline of a scripted operator's commands")
    fault: tuple[FaultSettings, ...] = key((), "timeline of faults")

    @property
    def has_commander(self) -> bool:
        """Whether a script, a simulated person or the system may give commands, so that turns are waited for."""
        return bool(self.command) or self.operator.commands

    @property
    def has_console(self) -> bool:
        """Whether a script or a simulated person is at the operator's console."""
        return self.has_commander or self.operator.person.is_on

    def problems(self) -> list[Problem]:
        """Check what involves several keys."""
        problems = []
        if not NAME.fullmatch(self.name):
            problems.append(Problem("name", repr(self.name[:64]), "must be 1 to 48 ASCII letters, digits, '-' or '_'"))
        if self.run.steps > MAX_STEP:
            problems.append(Problem("run.duration_s", f"{self.run.steps}", f"must be at most {MAX_STEP} steps"))
        if self.run.accept_lost > self.agents.count:
            allowed = f"must be at most the number of agents, {self.agents.count}"
            problems.append(Problem("run.accept_lost", f"{self.run.accept_lost:.15g}", allowed))
        if self.run.bound != "none" and (self.arena.obstacles or self.fault or self.world.dynamics != "point"):
            allowed = "must be none with obstacles, faults or dynamics other than point"
            problems.append(Problem("run.bound", repr(self.run.bound), allowed))
        if self.run.bound != "none" and (self.events.rates_hz or self.operator.autonomy.commands):
            allowed = "must be none with events.rates_hz, since it knows one rate, and with orders by the system"
            problems.append(Problem("run.bound", repr(self.run.bound), allowed))
        problems += fault_problems(self.fault, self.agents.count, self.run.steps, self.run.step_s, self.world.dynamics)
        size_m = (self.arena.width_m, self.arena.height_m)
        if (area_m2 := self.arena.width_m * self.arena.height_m) > MAX_AREA_M2:
            problems.append(Problem("arena", f"{area_m2:g} m2", f"must have an area of at most {MAX_AREA_M2:g} m2"))
        problems += obstacle_problems(self.arena.obstacles, size_m)
        problems += radio_problems(self.radio, size_m, self.agents.count, self.run.step_s)
        problems += uplink_problems(self.uplink, size_m, self.run.step_s)
        problems += downlink_problems(self.downlink, self.uplink.base_m, size_m)
        if not is_reading():  # older versions did runs with questions that never came
            for technique in self.operator.probes.techniques:
                problems += technique.problems_within(self.run.duration_s, self.run.step_s)
        places = size_m, self.arena.obstacles
        return problems + (room_problems(*places) or density_problems(self.events.density, *places))

    def for_agent(self, agent: int) -> AgentSettings:
        """Make the configuration of one agent: without the run's seed, events, or other agents."""
        from deltaswarm_wire.seeds import agent_seed  # hashing costs a board 4 MB, and no agent needs it

        return AgentSettings(
            seed=agent_seed(self.seed, agent),
            step_s=self.run.step_s,
            width_m=self.arena.width_m,
            height_m=self.arena.height_m,
            obstacles=self.arena.obstacles,
            speed_mps=self.agents.speed_mps,
            radius_m=self.world.radius_m,
            sensing_range_m=self.agents.sensing_range_m,
            range_m=self.radio.range_m,
            latency_s=self.radio.latency_s + self.radio.jitter_s,
            control=ControlSettings(self.control.mode, deepcopy(self.control.options)),  # a controller may change them
        )

    def for_operator(self, forms: tuple[CommandForm, ...], speed: float) -> Briefing:
        """Make the operator's configuration, with the commands that the controller accepts."""
        from deltaswarm_wire.seeds import agent_seed

        return Briefing(
            title=f"{self.name}, {self.control.mode}",
            mode=self.control.mode,
            seed=agent_seed(self.seed, BASE_ID),
            duration_s=self.run.duration_s,
            step_s=self.run.step_s,
            width_m=self.arena.width_m,
            height_m=self.arena.height_m,
            obstacles=self.arena.obstacles,
            base_m=self.uplink.base_m,
            range_m=self.uplink.range_m,
            agents=self.agents.count,
            radius_m=self.world.radius_m,
            operator=self.operator,
            forms=begun_with(forms, self.control.options),
            command=self.command,
            speed=speed,
        )


def content_of(scenario: Scenario) -> dict[str, Any]:
    """All effective keys as a table, with the digest of the density's file, if there is one, in place of its name.

    Raises:
        OSError: the file cannot be read.
    """
    table = plain(scenario)
    density = table["events"]["density"]
    if density["kind"] == "grid":
        density["file"] = hashlib.sha256(Path(density["file"]).read_bytes()).hexdigest()
    return table


def scenario_digest(scenario: Scenario) -> str:
    """Digest of `content_of`, in hexadecimal digits. Raises OSError."""
    return hashlib.sha256(json.dumps(content_of(scenario), sort_keys=True).encode()).hexdigest()
