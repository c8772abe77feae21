"""All cores of a run in one process, without Zenoh: for debuggers, property tests and sweeps.

The only file that combines the parts. It makes the same bytes in the same order as real processes do, so the digest is
the same.
"""

import gc
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from logging import ERROR, WARNING
from pathlib import Path

from deltaswarm_agent.controller import Controller, ControllerError, make_controller
from deltaswarm_agent.core.agent_core import AgentCore, StepOutput
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.reconfigure import reconfigure
from deltaswarm_operator.core.script import Scripted as Scripted  # for those that make a branch's script
from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_operator.io.action_log import ActionLog
from deltaswarm_orchestrator.base.exits import Reporter
from deltaswarm_orchestrator.processes.entry_point import GC_THRESHOLD
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results.outcome import READ, SHOWN, Outcome
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.controller_metrics import declared
from deltaswarm_wire.keys import WORLD
from deltaswarm_wire.messages import Frame
from deltaswarm_wire.operator_messages import Clock, Status, Workload
from deltaswarm_wire.orders import START
from deltaswarm_wire.plugin_errors import PluginError, blamed
from deltaswarm_wire.plugins import find_controller
from deltaswarm_wire.settings import AgentSettings
from deltaswarm_world.core.turns import AWAITED, OFF
from deltaswarm_world.core.world import WorldCore

STATUS_EVERY_STEPS = 500

SWARM = "the run"
"""Whose traceback it is, if a plug-in of no agent raised."""


def ignore(_: PluginError) -> None:
    """Tell nobody of a failure."""


@dataclass
class Cores:
    """The state of a run between two steps: all that decides what comes next."""

    world: WorldCore
    agents: dict[int, AgentCore]
    """Those that are in the run."""
    restarts: Counter[int]
    """How often each agent was started again."""
    operator: WorkloadMeter
    console: Console | None


@dataclass
class Begun:
    """A run that goes on after some steps: its state, and what these steps recorded."""

    cores: Cores
    step_records: list[StepRecord]
    workloads: list[Workload]
    table_bytes: Mapping[str, int] = field(default_factory=dict)
    """The lengths of the console's tables."""


class InProcess:
    """A whole run as one object; `step` runs a step of world and agents, and `close_step` closes it at the operator.

    With a folder, the tables of a scripted or simulated operator are written there. `on_failure` gets the error of each
    controller that fails, and `failed` its newest text by agent, also if that ends the run. With `begun` the run goes
    on from there; `listens`: whether there is a console though nobody is at it.
    """

    def __init__(
        self,
        scenario: Scenario,
        folder: Path | None = None,
        on_failure: Callable[[PluginError], None] = ignore,
        failed: dict[int, str] | None = None,
        begun: Begun | None = None,
        *,
        listens: bool = False,
    ) -> None:
        self.scenario = scenario
        self.failed = {} if failed is None else failed
        cores = begun.cores if begun else None
        names = [one.name for one in declared(scenario.control.mode)]
        self.world = cores.world if cores else WorldCore(scenario, metrics=names)
        self._restarts: Counter[int] = cores.restarts if cores else Counter()
        self._make_controller: Callable[[int, AgentSettings, int], Controller] = make_controller
        if scenario.run.bound != "none":
            from deltaswarm_orchestrator.run.bounds import knowing_controllers  # needs scipy

            self._make_controller = knowing_controllers(scenario, self.world)
        there = cores.agents if cores else {}
        self.agents = [there.get(agent) or self._agent(agent) for agent in range(scenario.agents.count)]
        self.operator = cores.operator if cores else WorkloadMeter(scenario.operator, scenario.run.step_s)
        self.console: Console | None = cores.console if cores else None
        """The scripted or simulated operator, if the scenario has one."""
        if self.console is None and (scenario.has_console or listens):
            self.console = Console(self.briefing)
            self.console.start(time.monotonic())
        self._tables: ActionLog | None = None
        if self.console is not None and folder is not None:
            self._tables = ActionLog(folder, begun.table_bytes if begun else None)
        self.agents_s = 0.0
        """Wall time spent in the agents' controllers and their encoding [s]."""
        self.traces: dict[str, str] = {}
        """The traceback of each agent whose controller raised."""
        self._on_failure = on_failure
        self.exchanged: list[tuple[int, Frame, StepOutput]] = []
        """(agent, its frame, its answer) of each agent asked in the last step."""

    @property
    def briefing(self) -> Briefing:
        """The configuration of the operator's console."""
        return self.scenario.for_operator(forms_of(find_controller(self.scenario.control.mode)), 0.0)

    @property
    def cores(self) -> Cores:
        """The state between two steps, which belongs to this run: pickle it to go on from it elsewhere."""
        there = {agent: self.agents[agent] for agent in sorted(self.world.participants.present)}
        return Cores(self.world, there, self._restarts, self.operator, self.console)

    @property
    def tables(self) -> dict[str, bytes]:
        """What the console's tables hold so far, by name."""
        if (tables := self._tables) is None:
            return {}
        return {name: (tables.folder / name).read_bytes()[:size] for name, size in tables.sizes.items()}

    def go_on_with(self, scenario: Scenario, commands: Sequence[Scripted], rule_drops: int = 0) -> None:
        """Between two steps, go on by the settings of another scenario at the operator, and by other commands.

        Agents, world and air keep theirs; `restart` gives the agents the new ones. The console is one that has listened
        from the beginning. See `script.go_on_with`.
        """
        self.scenario = self.world.scenario = scenario
        self.world.turns.mode = AWAITED if scenario.has_commander else OFF
        self.operator.go_on_with(scenario.operator)
        if self.console is None:
            return
        reconfigure(self.console, self.briefing, commands, rule_drops)
        for number in [scripted.number for scripted in commands if scripted.is_dropped and scripted.number is not None]:
            self.console.command_log.withdraw(number)
            self.world.turns.withdraw(number)

    def restart(self, step: int, seed: int | None = None) -> None:
        """Before a step, start all agents of the run anew, by the present scenario, with bodies as they are.

        With a seed, they draw as the agents of a run with that seed.
        """
        drawn = self.scenario if seed is None else replace(self.scenario, seed=seed)
        for agent in sorted(self.world.participants.present):
            self._restarts[agent] += 1
            self.agents[agent] = self._agent(agent, drawn)
            self.world.expect_new_process(agent, step)

    def _agent(self, agent: int, scenario: Scenario | None = None) -> AgentCore:
        settings = (scenario or self.scenario).for_agent(agent)
        try:
            controller = self._make_controller(agent, settings, self._restarts[agent])
        except ControllerError as error:
            self.failed[agent] = str(error)
            raise
        return AgentCore(agent, settings.step_s, controller)

    def _inject(self, step: int, sink: Sink | None) -> None:
        """Inject the faults due before a step. Dead and frozen agents need no more than to get no frame."""
        for order in self.world.inject(step):
            if order.action == START:
                self._restarts.update(order.agents)
                for agent in order.agents:
                    self.agents[agent] = self._agent(agent)
            if sink is not None:
                sink.log(WARNING, WORLD, order.text, order.time_s)

    def step(self, step: int, last: bool, sink: Sink | None = None) -> StepRecord:
        """Run one step of the world and of all agents, in agent order."""
        frames = self.begin(step, last, sink)
        began = time.perf_counter()
        answers = []
        for agent, frame in frames:
            try:
                answers.append((agent, frame, self.agents[agent].step(frame)))
            except ControllerError as error:  # treated as the end of the agent's process
                self.failed[agent] = str(error)
                self._note(f"agent {agent}", error, time_s=step * self.scenario.run.step_s, sink=sink)
                self.world.participants.token_gone(agent)
        self.agents_s += time.perf_counter() - began
        return self.end(step, answers, sink)

    def begin(self, step: int, last: bool, sink: Sink | None = None) -> list[tuple[int, Frame]]:
        """Begin a step: inject faults, and return a frame for each agent with something to decide."""
        self._inject(step, sink)
        return list(self.world.begin(step, last))

    def end(self, step: int, answers: list[tuple[int, Frame, StepOutput]], sink: Sink | None = None) -> StepRecord:
        """Give the world the agents' answers, as in `exchanged`; end the step."""
        world, self.exchanged = self.world, answers
        for agent, _, (act, act_bytes, counter, radio, report, report_bytes) in self.exchanged:
            if radio is not None:
                world.intake.accept_radio(agent, counter, radio)
                if sink is not None:
                    sink.radio(step, agent, radio)
            if report is not None and report_bytes is not None:
                world.intake.accept_report(agent, report, report_bytes)
                if sink is not None:
                    sink.report_bytes(step, agent, report_bytes)
            world.intake.accept_act(agent, act, act_bytes)
        record = world.end()
        for forwarded in world.forwarded:
            self.operator.count_forwarded(forwarded)
        return record

    def _note(self, name: str, error: PluginError, time_s: float, sink: Sink | None) -> None:
        if error.trace:
            self.traces[name] = error.trace
        if sink is not None:
            sink.log(ERROR, name, error.report, time_s)
        self._on_failure(error)

    def close_step(self, clock: Clock) -> Workload:
        """Close the step at the operator, and give the world the operator's turn."""
        workload = self.operator.close_step(clock, 0)
        if self.console is not None:
            reports = self.operator.reports_of_closed_step
            self.world.turns.accept(self.console.close_step(clock, workload, reports, time.monotonic()))
            if self._tables is not None:
                self._tables.write(self.console)
            self.console.actions.clear()
        return workload

    def finish(self, outcome: Outcome, wall_s: float) -> None:
        """Complete the outcome, which has all steps, and the operator's tables."""
        complete = len(outcome.step_records) == self.scenario.run.steps
        outcome.traces |= self.traces
        outcome.events = self.world.environment.states()
        outcome.world = self.world.totals(complete) | {"wall_s": wall_s}
        outcome.operator = {"complete": complete, "digest": self.operator.digest_hex, **self.operator.totals}
        outcome.told_s = self.operator.told_s
        if self.console is not None and self.scenario.has_console:
            self.console.probes.close()
            if self._tables is not None:
                self._tables.close(self.console)
            outcome.operator |= self.console.totals
            outcome.shown_s, outcome.read_s = (outcome.operator.get(moment.column) for moment in (SHOWN, READ))


@contextmanager
def rare_garbage_collections() -> Iterator[None]:
    """Let Python collect garbage as rarely as in the parts' own processes.

    A step makes no reference cycles, and a collection takes the longer the more agents there are.
    """
    thresholds = gc.get_threshold()
    gc.set_threshold(GC_THRESHOLD)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


def densest_places(scenario: Scenario) -> Callable[[float], tuple[float, float] | None]:
    """Return a function from a time [s] to the place where events are densest then [m]; None if there is none."""
    return WorldCore(scenario).environment.density.densest_m


@rare_garbage_collections()
def run_in_process(
    scenario: Scenario,
    sink: Sink | None = None,
    reporter: Reporter | None = None,
    stopped: Callable[[], object] = lambda: None,
    folder: Path | None = None,
    on_failure: Callable[[PluginError], None] = ignore,
    begun: Begun | None = None,
    before: Callable[[InProcess, int], None] = lambda swarm, step: None,
    *,
    listens: bool = False,
) -> Outcome:
    """Do a run, or the rest of one that has `begun`, until its end or until `stopped` returns something true.

    Return its outcome. With a folder, the tables of a scripted or simulated operator are written there. `on_failure`
    gets the error of each plug-in that fails; `before` gets the run before each step; `listens`: see `InProcess`.
    """
    reporter = reporter or Reporter()
    outcome = Outcome(list(begun.step_records), [], list(begun.workloads)) if begun else Outcome()

    def note(error: BaseException, time_s: float) -> None:
        """Note the failure of a plug-in that ends the run; raise any other error again."""
        if (plugin := blamed(error)) is None:
            raise error
        if str(plugin) not in outcome.causes.values():  # else its agent is named
            outcome.messages.append(str(plugin))
        outcome.traces[SWARM] = plugin.trace
        if sink is not None:
            sink.log(ERROR, SWARM, plugin.report, time_s)
        on_failure(plugin)

    try:
        swarm = InProcess(scenario, folder, on_failure, outcome.causes, begun, listens=listens)
    except BaseException as error:
        note(error, 0.0)
        outcome.messages += _failures(outcome)
        return outcome
    steps = scenario.run.steps
    began = time.monotonic()
    for step in range(len(outcome.step_records), steps):
        try:
            before(swarm, step)
            last = step == steps - 1 or bool(stopped())
            record = swarm.step(step, last, sink)
            last = swarm.world.is_last  # also if no agent is left
            workload = swarm.close_step(Clock(step, record.time_s, last))
        except BaseException as error:  # of a plug-in, or of an agent that is restarted
            note(error, step * scenario.run.step_s)
            break
        outcome.step_records.append(record)
        outcome.workloads.append(workload)
        if sink is not None:
            sink.step(swarm.world.truth(record), swarm.operator.reports_of_closed_step)
            sink.workload(workload)
        if last or step % STATUS_EVERY_STEPS == 0:
            status = Status(
                step,
                steps,
                record.time_s,
                record.agents_alive,
                record.agents_in_trees,
                swarm.world.environment.mean_waiting_s(),
                record.events_open,
                record.events_completed,
                "ended" if last else "running",
            )
            reporter.update(status, workload.rate_60s_hz)
        if last:
            break
    outcome.messages += _failures(outcome)
    try:
        swarm.finish(outcome, time.monotonic() - began)
    except BaseException as error:  # of dynamics that are asked for their totals
        note(error, scenario.run.duration_s)
    return outcome


def _failures(outcome: Outcome) -> list[str]:
    return [f"agent {agent}: {cause}" for agent, cause in outcome.causes.items()]
