"""All cores of a run in one process, without Zenoh: for debuggers, property tests and sweeps.

The only file that combines the parts. It makes the same bytes in the same order as real processes do, so the digest is
the same.
"""

import gc
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from logging import ERROR, WARNING
from typing import NamedTuple

from deltaswarm_agent.controller import Controller, ControllerError, make_controller
from deltaswarm_agent.core.agent_core import AgentCore, StepOutput
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.script import Scripted as Scripted  # for those that make a branch's script
from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_orchestrator.processes.entry_point import GC_THRESHOLD
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.at_station import AtStation
from deltaswarm_orchestrator.run.engine import NOTHING_MORE, Wanted
from deltaswarm_orchestrator.run.operating import Operating
from deltaswarm_orchestrator.run.state import Cores, RunState
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.controller_metrics import declared
from deltaswarm_wire.keys import WORLD
from deltaswarm_wire.messages import Frame
from deltaswarm_wire.operator_messages import Clock, Status, Workload
from deltaswarm_wire.orders import START
from deltaswarm_wire.plugin_errors import PluginError, blamed
from deltaswarm_wire.settings import AgentSettings
from deltaswarm_world.core.world import WorldCore

STATUS_EVERY_STEPS = 500

SWARM = "the run"
"""Whose traceback it is, if a plug-in of no agent raised."""

Answer = tuple[int, Frame, StepOutput]
"""(agent, its frame, its answer)."""


class Step(NamedTuple):
    """What the world and the operator recorded of one step."""

    record: StepRecord
    workload: Workload


class InProcess:
    """A whole run as one object, whose steps are made by `steps`.

    Args:
        scenario: its settings.
        wanted: what is wanted besides the outcome.
        state: the state to go on from; None: the run begins.
        causes: gets the newest error of each agent whose controller failed, also if the run cannot begin for it.
    """

    def __init__(
        self,
        scenario: Scenario,
        wanted: Wanted = NOTHING_MORE,
        state: RunState | None = None,
        causes: dict[int, str] | None = None,
    ) -> None:
        self.scenario = scenario
        self.outcome = Outcome(causes={} if causes is None else causes)
        """Filled in step by step."""
        if state is not None:
            self.outcome.step_records += state.step_records
            self.outcome.workloads += state.workloads
        cores = state.cores if state else None
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
        self._operating: Operating | None = None
        console = cores.console if cores else None
        if console is not None or scenario.has_console or wanted.listens:
            self._operating = Operating(scenario, wanted.folder, console, state.tables if state else None)
        self._at_station: AtStation | None = None
        if wanted.seat is not None:
            assert wanted.folder is not None
            self._operating = None
            self._at_station = AtStation(scenario, wanted.folder, wanted.seat, self.world.turns, wanted.stopped)
        self.agents_s = 0.0
        """Wall time spent in the agents' controllers and their encoding [s]."""
        self._wanted = wanted
        self.exchanged: list[Answer] = []
        """Those of all agents asked in the newest step."""

    @property
    def console(self) -> Console | None:
        """The console of a scripted or simulated operator; None without one."""
        return self._operating.console if self._operating else None

    @property
    def state(self) -> RunState:
        """The state between two steps; it belongs to this run, whose further steps change it."""
        there = {agent: self.agents[agent] for agent in sorted(self.world.participants.present)}
        cores = Cores(self.world, there, self._restarts, self.operator, self.console)
        tables = self._operating.tables if self._operating else {}
        return RunState(cores, self.outcome.step_records, self.outcome.workloads, tables)

    def steps(
        self,
        last_step: int | None = None,
        before: Callable[["InProcess", int], None] = lambda swarm, step: None,
    ) -> Iterator[Step]:
        """Make step after step, each closed at the operator, until the run ends.

        Args:
            last_step: the last one; None: that of the scenario.
            before: called with the run and the number of each step before that begins.
        """
        last_step = self.scenario.run.steps - 1 if last_step is None else last_step
        for step in range(len(self.outcome.step_records), last_step + 1):
            before(self, step)
            if self._at_station is not None and not self._at_station.wait(step):
                break
            record = self.step(step, step == last_step or bool(self._wanted.stopped()))
            yield Step(record, self.close_step(record))
            if self.world.is_last:  # also if no agent is left
                break
        if self._at_station is not None:
            self._at_station.answer_to_the_end()

    def go_on_with(self, scenario: Scenario, commands: Sequence[Scripted], rule_drops: int = 0) -> None:
        """Between two steps, go on by the settings of another scenario at the operator, and by other commands.

        Agents, world and air keep theirs; `restart` gives the agents the new ones. The console is one that has listened
        from the beginning. See `reconfigure`.
        """
        self.scenario = scenario
        self.world.go_on_with(scenario)
        self.operator.go_on_with(scenario.operator)
        if self._operating is not None:
            self._operating.go_on_with(self.world.turns, scenario, commands, rule_drops)

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
            self.outcome.causes[agent] = str(error)
            raise
        return AgentCore(agent, settings.step_s, controller)

    def _inject(self, step: int) -> None:
        """Inject the faults due before a step. Dead and frozen agents need no more than to get no frame."""
        for order in self.world.inject(step):
            if order.action == START:
                self._restarts.update(order.agents)
                for agent in order.agents:
                    self.agents[agent] = self._agent(agent)
            if self._wanted.sink is not None:
                self._wanted.sink.log(WARNING, WORLD, order.text, order.time_s)

    def step(self, step: int, last: bool) -> StepRecord:
        """Run one step of the world and of all agents, in agent order."""
        frames = self.begin(step, last)
        began = time.perf_counter()
        answers: list[Answer] = []
        for agent, frame in frames:
            try:
                answers.append((agent, frame, self.agents[agent].step(frame)))
            except ControllerError as error:  # treated as the end of the agent's process
                self.outcome.causes[agent] = str(error)
                self._note(f"agent {agent}", error, time_s=step * self.scenario.run.step_s)
                self.world.participants.token_gone(agent)
        self.agents_s += time.perf_counter() - began
        return self.end(step, answers)

    def begin(self, step: int, last: bool) -> list[tuple[int, Frame]]:
        """Begin a step: inject faults, and return a frame for each agent with something to decide."""
        self._inject(step)
        return list(self.world.begin(step, last))

    def end(self, step: int, answers: list[Answer]) -> StepRecord:
        """Give the world the agents' answers, as in `exchanged`; end the step."""
        world, sink, self.exchanged = self.world, self._wanted.sink, answers
        for agent, _, (act, act_bytes, counter, radio, report, report_bytes) in answers:
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

    def _note(self, name: str, error: PluginError, time_s: float) -> None:
        if error.trace:
            self.outcome.traces[name] = error.trace
        if self._wanted.sink is not None:
            self._wanted.sink.log(ERROR, name, error.report, time_s)
        self._wanted.on_failure(error)

    def close_step(self, record: StepRecord) -> Workload:
        """Close the step at the operator, give the world the operator's turn, and record both."""
        clock = Clock(record.step, record.time_s, self.world.is_last)
        workload = self.operator.close_step(clock, 0)
        reports = self.operator.reports_of_closed_step
        if self._operating is not None:
            self.world.turns.accept(self._operating.close_step(clock, workload, reports))
        if self._at_station is not None:
            self._at_station.close_step(clock, workload, reports)
        self.outcome.step_records.append(record)
        self.outcome.workloads.append(workload)
        if self._wanted.sink is not None:
            self._wanted.sink.step(self.world.truth(record), reports)
            self._wanted.sink.workload(workload)
        return workload

    @property
    def status(self) -> Status:
        """Where the run is after its newest step."""
        record, steps = self.outcome.step_records[-1], self.scenario.run.steps
        return Status(
            record.step,
            steps,
            record.time_s,
            record.agents_alive,
            record.agents_in_trees,
            self.world.environment.mean_waiting_s(),
            record.events_open,
            record.events_completed,
            "ended" if self.world.is_last else "running",
        )

    def finish(self, wall_s: float) -> None:
        """Complete the outcome, which has all steps, and the operator's tables."""
        outcome = self.outcome
        complete = len(outcome.step_records) == self.scenario.run.steps
        outcome.events = self.world.environment.states()
        outcome.world = self.world.totals(complete) | {"wall_s": wall_s}
        outcome.operator = {"complete": complete, "digest": self.operator.digest_hex, **self.operator.totals}
        outcome.told_s = self.operator.told_s
        if self._operating is not None and self.scenario.has_console:
            self._operating.finish(outcome)
        if self._at_station is not None:
            self._at_station.finish(outcome)


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
    wanted: Wanted = NOTHING_MORE,
    state: RunState | None = None,
    before: Callable[[InProcess, int], None] = lambda swarm, step: None,
) -> Outcome:
    """Do a run, or the rest of one from a state; an `Engine`. `before` gets the run before each step."""
    outcome = Outcome()

    def note(error: BaseException, time_s: float) -> None:
        """Note the failure of a plug-in that ends the run; raise any other error again."""
        if (plugin := blamed(error)) is None:
            raise error
        if str(plugin) not in outcome.causes.values():  # else its agent is named
            outcome.messages.append(str(plugin))
        outcome.traces[SWARM] = plugin.trace
        if wanted.sink is not None:
            wanted.sink.log(ERROR, SWARM, plugin.report, time_s)
        wanted.on_failure(plugin)

    try:
        swarm = InProcess(scenario, wanted, state, outcome.causes)
    except BaseException as error:
        note(error, 0.0)
        outcome.messages += _failures(outcome)
        return outcome
    outcome = swarm.outcome
    began = time.monotonic()
    try:
        for record, workload in swarm.steps(before=before):
            if swarm.world.is_last or record.step % STATUS_EVERY_STEPS == 0:
                wanted.reporter.update(swarm.status, workload.rate_60s_hz)
    except BaseException as error:  # of a plug-in, or of an agent that is restarted
        note(error, len(outcome.step_records) * scenario.run.step_s)
    outcome.messages += _failures(outcome)
    try:
        swarm.finish(time.monotonic() - began)
    except BaseException as error:  # of dynamics that are asked for their totals
        note(error, scenario.run.duration_s)
    return outcome


def _failures(outcome: Outcome) -> list[str]:
    return [f"agent {agent}: {cause}" for agent, cause in outcome.causes.items()]
