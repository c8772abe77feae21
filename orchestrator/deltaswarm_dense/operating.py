"""The operator of a run in arrays: the console takes in the reports of its steps, and its orders leave the base."""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from deltaswarm_dense.layout import MAX_ORDERS, Swarm
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.script import Scripted
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.engine import UncoveredError
from deltaswarm_orchestrator.run.operating import Operating
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_scenario.operator_settings import SYSTEM
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.commands import decode_command, decode_relayed
from deltaswarm_wire.digest import COMMAND, HEAD
from deltaswarm_wire.envelope import decode_sample
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.world import WorldCore


def messages_of(data: memoryview) -> Iterator[tuple[int, int, bytes]]:
    """Yield agent, kind and bytes of the messages that a digest hashes."""
    at = 0
    while at < len(data):
        _, agent, kind, size = HEAD.unpack_from(data, at)
        at += HEAD.size + size
        yield agent, kind, bytes(data[at - size : at])


class Operator:
    """Whoever is at the console of a run; `world` has the turns and the downlink of the Python engine."""

    def __init__(self, scenario: Scenario, world: WorldCore, folder: Path | None) -> None:
        self._world = world
        self._operating = Operating(scenario, folder)
        self._follow(scenario)
        self._numbers: dict[bytes, int] = {}
        """The number of each command that has left the base, by its bytes."""
        self.begin_step: Callable[[int], object] = lambda step: None
        """Called with the number of each step before the console takes it in."""

    @property
    def console(self) -> Console:
        return self._operating.console

    def _follow(self, scenario: Scenario) -> None:
        step_s = scenario.run.step_s
        self._scenario = scenario
        self._script = sorted(max(0, round(command.at_s / step_s) - FIRST_STEP) for command in scenario.command)
        """The steps after which a script gives its orders."""

    def go_on_with(self, scenario: Scenario, commands: Sequence[Scripted], rule_drops: int) -> None:
        """Between two steps, go on by another scenario at the operator, and by another script."""
        self._follow(scenario)
        self._world.go_on_with(scenario)
        self._operating.go_on_with(self._world.turns, scenario, commands, rule_drops)

    def steps_from(self, step: int, most: int) -> int:
        """Return how many steps may be made from this one on before the console takes them in, or the base sends."""
        if not self._scenario.has_commander:
            return most
        base = (self._world.turns.next_leaving_step, self._world.downlink.next_sending_step)
        until = [self._next_act(step) + FIRST_STEP, *(max(due, step + 1) for due in base if due is not None)]
        return min(most, min(until) - step)

    def _next_act(self, step: int) -> int:
        """Return the first step from this one on after which the console may give an order, or an earlier one."""
        operator, console, step_s = self._scenario.operator, self.console, self._scenario.run.step_s
        if operator.person.commands or operator.autonomy.sets_delta == SYSTEM or not console.command_log.has_room:
            return step
        acts = self._script[bisect_left(self._script, step) :][:1]
        if console.budget is not None:
            acts.append(int((console.budget.ordered_s + operator.budget.every_s) / step_s) - 1)
        return max(step, min(acts, default=self._scenario.run.steps))

    def begin(self, swarm: Swarm, step: int, positions_m: Floats, listening: Sequence[bool]) -> None:
        """Before a step, let orders leave the base, and tell the arrays who of the listening hears them."""
        if not self._scenario.has_commander:
            return
        world, step_s, commands = self._world, self._scenario.run.step_s, swarm.commands
        leaving = world.turns.leaving(step, step_s)
        for signed in leaving:
            self._add(swarm, signed.body)
        world.downlink.send(step, leaving)
        delivered = world.downlink.carry(step, step * step_s, positions_m, listening)
        if not delivered:
            return
        commands.reached[[agent for agent, _ in delivered]] = True
        data = delivered[0][1]
        items = [decode_relayed(item) for item in decode_sample(data).commands]
        for place, (left_steps, signed) in enumerate(items):
            commands.base[2 * place : 2 * place + 2] = self._numbers[signed.body], left_steps
        commands.base[-1] = len(items)
        told = b"".join(HEAD.pack(step, agent, COMMAND, len(data)) + data for agent, _ in delivered)
        swarm.output.world[: len(told)] = np.frombuffer(told, np.uint8)
        swarm.output.ends[0] = len(told)

    def _add(self, swarm: Swarm, body: bytes) -> None:
        command = decode_command(body)
        if command.number >= MAX_ORDERS:
            raise UncoveredError(f"more than {MAX_ORDERS} orders")
        number = self._numbers[body] = command.number
        least, fraction = divmod(float(command.arguments.get("delta", 0)), 1)
        share, price_s = command.arguments.get("working"), command.arguments.get("message_price")
        row = swarm.commands.given[number]
        row["delta"], row["fraction"], row["sets_share"] = least, fraction, share is not None
        row["share"] = 1.0 if share is None else share
        row["sets_price"], row["price_s"] = price_s is not None, price_s or 0.0
        row["life"] = max(1, round(command.life_s / self._scenario.run.step_s))
        row["body_bytes"] = len(body)
        swarm.commands.bodies[number, : len(body)] = np.frombuffer(body, np.uint8)
        swarm.commands.sent[0] = number + 1

    def end(self, workloads: Sequence[Workload], reports: Iterable[Sequence[Report]]) -> None:
        """Let the console take in the reports of some steps."""
        last_step = self._scenario.run.steps - 1
        for workload, arrived in zip(workloads, reports, strict=True):
            clock = Clock(workload.step, workload.time_s, workload.step == last_step)
            self.begin_step(workload.step)
            self._world.turns.accept(self._operating.close_step(clock, workload, arrived))

    def finish(self, outcome: Outcome) -> None:
        """Complete the operator's part of an outcome."""
        self._operating.finish(outcome)
