"""The engines of a run in one process: what each takes and gives, and which one does a run."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from deltaswarm_orchestrator.base.exits import CommandError, Reporter
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.extras import missing
from deltaswarm_wire.plugin_errors import PluginError
from deltaswarm_wire.plugins import IN_PROCESS_ENGINES, find

if TYPE_CHECKING:
    from deltaswarm_orchestrator.run.state import RunState

PYTHON, DENSE = "python", "dense"
ASKED = (PYTHON, DENSE)
"""What `--engine` insists on for runs in one process."""


@dataclass(frozen=True)
class Wanted:
    """What is wanted of a run besides its outcome."""

    sink: Sink | None = None
    """Gets frames, reports, truth and log lines."""
    folder: Path | None = None
    """Where the tables of a scripted or simulated operator are written."""
    reporter: Reporter = field(default_factory=Reporter)
    stopped: Callable[[], object] = lambda: None
    """The step after this returns something true is the last."""
    on_failure: Callable[[PluginError], object] = lambda error: None
    """Gets the error of each plug-in that fails."""
    listens: bool = False
    """Whether there is a console though nobody is at it, so that a branch can have an operator."""


NOTHING_MORE = Wanted()


class Engine(Protocol):
    """Does a run, or the rest of one from a state, and returns its outcome."""

    def __call__(
        self, scenario: Scenario, wanted: Wanted = NOTHING_MORE, state: "RunState | None" = None
    ) -> Outcome: ...


class UncoveredError(Exception):
    """The engine finds during a run that it cannot do it; the Python engine must."""


class CoveringEngine(Engine, Protocol):
    """An engine for some runs. May raise UncoveredError."""

    NEEDS: tuple[str, ...]
    """Modules that it imports."""

    def why_not(self, scenario: Scenario) -> str:
        """Return why the engine cannot do a run; empty if it can."""


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
        asked: one of `ASKED`; empty: the dense engine where it can.

    Raises:
        CommandError: the dense engine is asked for, and cannot do the run.
    """
    if asked == PYTHON:
        return DoneBy(PYTHON, "it was asked for")
    because = _why_not_dense(scenario, wanted, has_state)
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
    because: str = engine().why_not(scenario)
    return because


def run_here(
    scenario: Scenario, wanted: Wanted = NOTHING_MORE, state: "RunState | None" = None, *, asked: str = ""
) -> tuple[Outcome, DoneBy]:
    """Do a run in this process, by the dense engine where it can.

    Raises:
        CommandError: as in `planned_by`.
    """
    from deltaswarm_orchestrator.run.in_process import run_in_process  # imports numpy, which is slow

    by = planned_by(scenario, wanted, has_state=state is not None, asked=asked)
    if by.engine == DENSE:
        try:
            outcome: Outcome = find(IN_PROCESS_ENGINES, DENSE, "--engine")()(scenario, wanted)
            return outcome, by
        except UncoveredError as error:
            if asked == DENSE:
                raise CommandError(f"--engine dense cannot do this run: {error}") from None
            by = DoneBy(PYTHON, str(error))
    return run_in_process(scenario, wanted, state), by
