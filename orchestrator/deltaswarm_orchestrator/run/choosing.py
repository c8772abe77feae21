"""Choose the engine of a run in one process: the dense one where it is installed and covers the run."""

from typing import Any, NamedTuple

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.processes.elsewhere import DENSE, PYTHON
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.engine import NOTHING_MORE, Engine, UncoveredError, Wanted
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.run.state import RunState
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.extras import missing
from deltaswarm_wire.plugins import IN_PROCESS_ENGINES, find

WORTH_AGENT_STEPS = 20_000
"""Agents times steps of a run from which on the dense engine, which takes a second to load, is worth it."""


class DoneBy(NamedTuple):
    """Which engine did a run, and why not the dense one."""

    engine: str
    because: str = ""

    @property
    def told(self) -> dict[str, Any]:
        """The same for JSON."""
        return {"by": self.engine, **({"because": self.because} if self.because else {})}


def planned_by(
    scenario: Scenario, wanted: Wanted = NOTHING_MORE, *, has_state: bool = False, asked: str = ""
) -> DoneBy:
    """Return which engine will do a run in one process.

    Args:
        scenario: of the run.
        wanted: what is wanted of it.
        has_state: whether it goes on from a state.
        asked: one of `elsewhere.IN_ONE_PROCESS`; empty: the dense engine where it can.

    Raises:
        CommandError: the dense engine is asked for, and cannot do the run.
    """
    if asked == PYTHON:
        return DoneBy(PYTHON, "it was asked for")
    because = _why_not_dense(scenario, wanted, has_state)
    if not because and asked != DENSE and scenario.agents.count * scenario.run.steps < WORTH_AGENT_STEPS:
        because = "the run is too short to be worth loading it"
    if asked == DENSE and because:
        raise CommandError(f"--engine dense cannot do this run: {because}")
    return DoneBy(PYTHON, because) if because else DoneBy(DENSE)


def _why_not_dense(scenario: Scenario, wanted: Wanted, has_state: bool) -> str:
    if DENSE not in IN_PROCESS_ENGINES.names():
        return "it is not installed"
    engine = find(IN_PROCESS_ENGINES, DENSE, "--engine")
    if needs := missing(*engine.NEEDS):
        return f"it {needs}"
    if wanted.sink is not None:
        return "a recording has the truth of every step, which only the Python engine keeps"
    if has_state:
        return "the run goes on from a state of the Python engine"
    because: str = engine().why_not(scenario) or (engine().why_not(wanted.turn.scenario) if wanted.turn else "")
    return because


def run_here(
    scenario: Scenario,
    wanted: Wanted = NOTHING_MORE,
    state: RunState | None = None,
    *,
    asked: str = "",
    in_python: Engine = run_in_process,
) -> tuple[Outcome, DoneBy]:
    """Do a run in this process, by the dense engine where it can.

    `in_python` does it where the dense engine cannot.

    Raises:
        CommandError: as in `planned_by`.
    """
    by = planned_by(scenario, wanted, has_state=state is not None, asked=asked)
    if by.engine == DENSE:
        try:
            outcome: Outcome = find(IN_PROCESS_ENGINES, DENSE, "--engine")()(scenario, wanted)
            return outcome, by
        except UncoveredError as error:
            if asked == DENSE:
                raise CommandError(f"--engine dense cannot do this run: {error}") from None
            by = DoneBy(PYTHON, str(error))
    return in_python(scenario, wanted, state), by
