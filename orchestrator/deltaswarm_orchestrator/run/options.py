"""How to do a run, what can be checked before it starts, and its result."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, OK, CommandError, Reporter
from deltaswarm_orchestrator.base.inputs import Inputs
from deltaswarm_orchestrator.base.paths import check_out, check_ports
from deltaswarm_orchestrator.base.signals import Stop
from deltaswarm_orchestrator.live.foxglove_server import HOST as LIVE_HOST
from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer, LiveError, check_installed
from deltaswarm_orchestrator.live.observers import LiveObserver
from deltaswarm_orchestrator.processes.boards import Boards
from deltaswarm_orchestrator.processes.elsewhere import DENSE, Placement, RunEngine
from deltaswarm_orchestrator.processes.station import StationChannel
from deltaswarm_orchestrator.results.folder import RunFolder, check_target
from deltaswarm_orchestrator.results.resume import Resumed
from deltaswarm_orchestrator.run.ending import Ending
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.extras import missing
from deltaswarm_wire.plugins import DYNAMICS, find, find_controller

if TYPE_CHECKING:
    from deltaswarm_orchestrator.run.at_station import Seat

STOPPED_BY = "stopped by"


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How to do a run; what to run is the scenario."""

    out: Path
    in_process: bool = False
    in_process_engine: str = ""
    """One of `elsewhere.IN_ONE_PROCESS`; empty: the dense engine where it can do the run."""
    force: bool = False
    debug: bool = False
    """In one process: stop in the debugger where a plug-in raises."""
    listen: str = "tcp/127.0.0.1:0"
    zenoh: tuple[tuple[str, str], ...] = ()
    boards: Boards | None = None
    """Agents that are started by hand on other machines."""
    engine: RunEngine | None = None
    """Where the agents are started; None: on this machine."""
    checkpoint_steps: int = 0
    """Steps between checkpoints, from which the run can be resumed; 0: no checkpoints."""
    station: StationChannel | None = None
    """The page of the person who watches and commands; None: no station."""
    conductor: StationChannel | None = None
    """The conductor's page, if the station's is served elsewhere, too."""
    seat: "Seat | None" = None
    """The same for a run in one process."""
    researcher: bool = False
    """Whether to serve another page, which shows the truth."""
    researcher_page: StationChannel | None = None
    """Where that page is; None: at a new address."""
    inputs: Inputs | None = None
    """The files that decide the run, if they were identified with those of other runs; None: when the run begins."""
    resume: bool = False
    """Resume the interrupted run in `out` from its newest checkpoint."""
    live_port: int | None = None
    """Port on which to show the run live to Foxglove; 0: any free port; None: do not show it."""
    observer: str = ""
    """Name of the observer, besides Foxglove, to which the run is shown live; empty: none."""
    live_connect: str = ""
    """Where that observer is reached; empty: where it is by default."""
    kept: tuple[str, ...] = ()
    """Options of the command line that count when the run is resumed, for the advice to do so."""


@dataclass(eq=False)
class RunContext:
    """What a run in progress works with, and how it ends."""

    scenario: Scenario
    options: RunOptions
    reporter: Reporter
    stop: Stop
    folder: RunFolder
    inputs: Inputs
    """The files that decide the run, as they were identified."""
    placement: Placement | None = None
    """The places of agents on other machines; None if they run here."""
    viewer: FoxgloveServer | None = None
    """The server for live viewers, if the run has them."""
    observers: list[LiveObserver] = field(default_factory=list)
    """All that look at the run, the viewer among them."""
    resumed: Resumed | None = None
    """Where the run is resumed; None if it begins with the first step."""
    checkpoint_steps: int = 0
    ending: Ending = field(default_factory=Ending)


@dataclass(frozen=True)
class RunResult:
    """The result of a run that has ended."""

    folder: Path
    summary: dict[str, Any]
    exit_reason: str
    messages: tuple[str, ...]
    """Messages for the user: what went wrong, the last lines of logs, and how to resume."""

    @property
    def code(self) -> int:
        """The exit code that tells how the run ended."""
        if self.summary["valid"]:
            return OK
        return INTERRUPTED if self.exit_reason.startswith(STOPPED_BY) else FAILED


def _endpoints(options: RunOptions) -> dict[str, str]:
    found = {} if options.live_port is None else {"--live-port": f"tcp/{LIVE_HOST}:{options.live_port}"}
    if options.station:
        found["--station-listen"] = f"tcp/{options.station.listen}"
        if ":" in options.station.markers:  # else LSL, or none
            found["--markers"] = f"tcp/{options.station.markers}"
    if not options.in_process:
        found["--listen"] = options.boards.listen if options.boards else options.listen
    return found


def check_packages(scenario: Scenario) -> None:
    """Check that packages are installed which only some scenarios import, and only once they run.

    Raises:
        SettingsError: one is not.
    """
    mode, bound = scenario.control.mode, scenario.run.bound
    modules = {
        ("control.mode", mode): getattr(find_controller(mode), "NEEDS", ()),
        ("run.bound", bound): () if bound == "none" else ("scipy",),
    }
    lacking = {key: needs for key, names in modules.items() if (needs := missing(*names))}
    if lacking:
        raise SettingsError([Problem(path, repr(value), needs) for (path, value), needs in lacking.items()])


def unsaved(scenario: Scenario) -> str:
    """Return why the bodies of a run cannot be saved between two steps; "" if they can."""
    why: str = getattr(find(DYNAMICS, scenario.world.dynamics, "world.dynamics"), "UNSAVED", "")
    return why


def _check_engine(scenario: Scenario, options: RunOptions) -> None:
    from deltaswarm_orchestrator.run.choosing import planned_by  # imports numpy, which is slow

    if options.in_process_engine == DENSE and (scenario.record != "off" or options.live_port is not None):
        must = "must be given with --record off and without --live: only the Python engine keeps every step"
        raise CommandError(f"--engine dense {must}")
    if options.in_process_engine == DENSE and options.debug:
        raise CommandError("--engine dense must be given without --debug: it calls no plug-in")
    planned_by(scenario, asked=options.in_process_engine)


def check(scenario: Scenario, options: RunOptions) -> None:
    """Check what can be checked of a run before anything is started or written."""
    if scenario.run.bound != "none" and not options.in_process:
        reason = "no agent can know what a bound knows; do it in one process (run --in-process)"
        allowed = f"must be none for a run of processes: {reason}"
        raise SettingsError([Problem("run.bound", repr(scenario.run.bound), allowed)])
    check_packages(scenario)
    if options.checkpoint_steps and (why := unsaved(scenario)):
        allowed = f"must have bodies that can be saved with --checkpoint: {why}"
        raise SettingsError([Problem("world.dynamics", repr(scenario.world.dynamics), allowed)])
    if options.in_process_engine:
        _check_engine(scenario, options)
    if options.boards:
        options.boards.check(scenario)
    if options.engine:
        options.engine.check(scenario)
    if options.live_port is not None:
        check_installed()
    check_ports(_endpoints(options))
    if options.observer and scenario.record == "off":
        raise LiveError(
            f"--live {options.observer} must be given without --record off, since then nothing collects the truth"
        )
    if not options.resume:
        check_target(options.out, options.force)
    check_out(options.out, is_ours=False)
