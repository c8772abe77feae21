"""Test a controller of yours: its decisions on percepts of your choice, a small swarm in memory, equal digests.

For a study by link, `Recruiter` stands in for a service that recruits people.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from deltaswarm.arguments import COUNTS, SEEDS, public
from deltaswarm.errors import one_error
from deltaswarm.keys import name_of, overrides
from deltaswarm.recruiting import Recruiter as Recruiter
from deltaswarm.runs import IN_PROCESS, PROCESSES, run
from deltaswarm_agent.controller import Controller, Percept, make_controller
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.checked import MAX_NUMBER
from deltaswarm_wire.codec import MAX_STEP
from deltaswarm_wire.commands import Command
from deltaswarm_wire.envelope import decode_sample
from deltaswarm_wire.messages import Act, Event, Pose
from deltaswarm_wire.operator_messages import Report
from deltaswarm_wire.plugin_errors import PluginError

SCENARIO = "smoke"
"""The scenario whose keys a test changes: 6 agents in 40 m by 40 m."""


@public(seed=SEEDS)
def controller(cls: type, keys: Mapping[Any, Any] | None = None, *, agent: int = 0, seed: int = 1) -> Controller:
    """Make a controller as a run of the scenario `smoke` with these keys makes it.

    Args:
        cls: its class.
        keys: scenario keys, such as `{"control.exponent": 1.5, "radio.range_m": 10.0}`.
        agent: the agent's id.
        seed: of the run, from which the agent's random generator is derived.

    Raises:
        Error: the class is not a controller, or the keys have mistakes.
        ControllerError: its constructor raised.
    """
    return make_controller(agent, _scenario(cls, keys, seed).for_agent(agent))


@public(step=(0, MAX_STEP), step_s=(1e-9, MAX_NUMBER))
def percept(
    step: int = 0,
    pose: Pose = (20.0, 20.0),
    *,
    events: Iterable[Pose | Event] = (),
    heard: Mapping[int, bytes] | Iterable[tuple[int, bytes]] = (),
    commands: Iterable[Command] = (),
    poses: Iterable[Pose] = (),
    step_s: float = 1.0,
) -> Percept:
    """Make what an agent senses and hears in a step; nothing but its position by default.

    Args:
        step: the number of the step; `time_s` is that times `step_s` [s].
        pose: its position [m].
        events: sensed events, or their positions [m], which get the ids 1, 2 and so on.
        heard: (sender, payload) of received frames, or payloads by sender.
        commands: the operator's commands that are new to it.
        poses: where it was in the steps between its last percept and this one, oldest first [m].
        step_s: length of a step [s].
    """
    sensed = (one if isinstance(one, Event) else Event(number, *one) for number, one in enumerate(events, 1))
    known = sorted(dict(heard).items())
    return Percept(step, step * step_s, pose, tuple(poses), tuple(sensed), known, tuple(commands))


class Swarm:
    """A swarm in memory: the world, the air, and agents with one class of controller; it takes no clock and no network.

    Attributes:
        controllers: the agents' controllers, by id.
        acts: what agents that were asked in the newest step do, by id.
        payloads: what they broadcast, as it was given, by id.
        reports: their reports to the operator, by id.
    """

    @public(agents=COUNTS, seed=SEEDS)
    def __init__(self, cls: type, keys: Mapping[Any, Any] | None = None, *, agents: int = 3, seed: int = 1) -> None:
        """Make a swarm in the scenario `smoke` with these keys.

        Raises:
            Error: the class is not a controller, or the keys have mistakes.
            ControllerError: a controller's constructor raised.
        """
        scenario = _scenario(cls, {"agents.count": agents, **(keys or {})}, seed)
        self._swarm = InProcess(scenario, Wanted(on_failure=_fail))
        self._steps = self._swarm.steps(MAX_STEP)
        self.controllers = [core.controller for core in self._swarm.agents]
        self.acts: dict[int, Act] = {}
        self.payloads: dict[int, bytes] = {}
        self.reports: dict[int, Report] = {}

    @property
    def positions_m(self) -> list[Pose]:
        """The agents' positions, by id [m]."""
        return [(x_m, y_m) for x_m, y_m in self._swarm.world.environment.positions_m.tolist()]

    def step(self) -> StepRecord:
        """Do one step; return the world's record of it, the row of `series.csv`.

        Raises:
            ControllerError: a controller raised, or returned an invalid decision.
        """
        record = next(self._steps).record
        outputs = {agent: output for agent, _, output in self._swarm.exchanged}
        self.acts = {agent: output.act for agent, output in outputs.items()}
        payloads = {agent: decode_sample(one.radio).payload for agent, one in outputs.items() if one.radio is not None}
        self.payloads = {agent: payload for agent, payload in payloads.items() if payload is not None}
        self.reports = {agent: one.report for agent, one in outputs.items() if one.report is not None}
        return record


@public(seed=SEEDS)
def digests(cls: type, keys: Mapping[Any, Any] | None = None, *, seed: int = 1) -> tuple[str | None, str | None]:
    """Return the digests of a run in one process and of the same by processes, which must be equal.

    The class must be in a module. The run is that of `smoke` with these keys.

    Raises:
        Error: a run could not be done.
    """
    given = {"control.mode": cls, "record": "off", **(keys or {})}
    one, other = (run(SCENARIO, given, seed=seed, engine=by, progress=False) for by in (IN_PROCESS, PROCESSES))
    return one.digest, other.digest


def _scenario(cls: type, keys: Mapping[Any, Any] | None, seed: int) -> Scenario:
    with one_error("deltaswarm.testing"):
        return load_scenario(SCENARIO, overrides({"control.mode": name_of(cls, "cls"), **(keys or {})}), seed)


def _fail(error: PluginError) -> None:
    raise error
