"""The scripted or simulated operator of a run in one process, and the tables of what it did."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.reconfigure import reconfigure
from deltaswarm_operator.core.rehearsal import plan_warning
from deltaswarm_operator.core.script import Scripted
from deltaswarm_operator.io.action_log import ActionLog
from deltaswarm_orchestrator.results.outcome import READ, SHOWN, Outcome
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.commands import Turn, forms_of
from deltaswarm_wire.files import write_whole
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_wire.plugins import find_controller
from deltaswarm_world.core.turns import Turns


def briefing_of(scenario: Scenario, speed: float = 0.0) -> Briefing:
    """Return the configuration of a run's console."""
    return scenario.for_operator(forms_of(find_controller(scenario.control.mode)), speed)


def question_warning(scenario: Scenario, speed: float) -> str | None:
    """Return a warning if the planned questions of a run do not fit into it; None if they do."""
    return plan_warning(briefing_of(scenario, speed))


class Operating:
    """A console that somebody simulated, a script or nobody is at.

    Args:
        scenario: of the run.
        folder: where the tables are written; None: nowhere.
        console: one that has been under way; None: it starts.
        tables: what its tables hold by then, by name.
    """

    def __init__(
        self,
        scenario: Scenario,
        folder: Path | None,
        console: Console | None = None,
        tables: Mapping[str, bytes] | None = None,
    ) -> None:
        if console is None:
            console = Console(briefing_of(scenario))
            console.start(time.monotonic())
        self.console = console
        self._log: ActionLog | None = None
        if folder is not None:
            tables = tables or {}
            for name, data in tables.items():
                write_whole(folder / name, data)
            self._log = ActionLog(folder, {name: len(data) for name, data in tables.items()})

    @property
    def tables(self) -> dict[str, bytes]:
        """What the tables hold so far, by name."""
        if (log := self._log) is None:
            return {}
        return {name: (log.folder / name).read_bytes()[:size] for name, size in log.sizes.items()}

    def close_step(self, clock: Clock, workload: Workload, reports: Sequence[Report]) -> Turn:
        """Take in a closed step, and write what was done; return the operator's turn."""
        turn = self.console.close_step(clock, workload, reports, time.monotonic())
        if self._log is not None:
            self._log.write(self.console)
        self.console.actions.clear()
        return turn

    def go_on_with(self, turns: Turns, scenario: Scenario, commands: Sequence[Scripted], rule_drops: int = 0) -> None:
        """Between two steps, go on by other settings and another script; take dropped commands back."""
        reconfigure(self.console, briefing_of(scenario), commands, rule_drops)
        for number in [scripted.number for scripted in commands if scripted.is_dropped and scripted.number is not None]:
            self.console.command_log.withdraw(number)
            turns.withdraw(number)

    def finish(self, outcome: Outcome) -> None:
        """Complete the tables, and the operator's part of an outcome."""
        self.console.probes.close()
        if self._log is not None:
            self._log.close(self.console)
        note_totals(outcome, self.console)


def note_totals(outcome: Outcome, console: Console) -> None:
    """Complete the operator's part of an outcome."""
    outcome.operator |= console.totals
    outcome.shown_s, outcome.read_s = (outcome.operator.get(moment.column) for moment in (SHOWN, READ))
