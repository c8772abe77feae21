"""What every engine of runs in one process takes and gives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from deltaswarm_orchestrator.base.exits import Reporter
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.run.randomness import Randomness
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.plugin_errors import PluginError

if TYPE_CHECKING:
    from deltaswarm_orchestrator.run.at_station import Seat
    from deltaswarm_orchestrator.run.state import RunState


class Turn(NamedTuple):
    """Where a run from the beginning turns into a branch of it."""

    step: int
    """The step at whose end the operator decides what leaves the base in `at_step`."""
    at_step: int
    """The first step in which the world can differ."""
    scenario: Scenario
    """What holds at the operator from the turn on."""
    console: tuple[Sequence[Any], int] | None
    """The script from then on, and how many of the next orders of a rule are not sent; None: all stays."""
    randomness: Randomness | None = None
    """By which all draw from `at_step` on; None: as before."""


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
    seat: "Seat | None" = None
    """Where a person takes part; None: nowhere."""
    turn: Turn | None = None
    """For an engine that cannot go on from a state."""


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
