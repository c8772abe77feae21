"""Where a run is shown live besides its own views: to Foxglove, and to the observers of other packages."""

from collections.abc import Iterator
from contextlib import contextmanager

from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer
from deltaswarm_orchestrator.live.observers import LiveObserver
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.run.reporter import Reporter
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.plugins import OBSERVERS, find


@contextmanager
def foxglove_viewer(scenario: Scenario, options: RunOptions, reporter: Reporter) -> Iterator[FoxgloveServer | None]:
    """Yield the server for live viewers, or None if the run has none."""
    if options.live_port is None:
        yield None
        return
    with FoxgloveServer(scenario.name, options.live_port, reporter.say) as server:
        reporter.say(f"live: open {server.url} in Foxglove; it shows the truth, which the operator does not know")
        yield server


@contextmanager
def named_observer(scenario: Scenario, options: RunOptions, reporter: Reporter) -> Iterator[LiveObserver | None]:
    """Yield the observer that `--live` names, or None if the run has none."""
    if not options.observer:
        yield None
        return
    with find(OBSERVERS, options.observer, "--live")(options.live_connect, scenario) as observer:
        reporter.say(f"live: {observer.shows}")
        yield observer
