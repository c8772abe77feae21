"""Where a run is shown live besides its own views: to Foxglove, and to the tools of ROS 2."""

from collections.abc import Iterator
from contextlib import contextmanager

from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer
from deltaswarm_orchestrator.live.observers import LiveObserver
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.run.reporter import Reporter
from deltaswarm_scenario.scenario import Scenario


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
def ros2_publisher(scenario: Scenario, options: RunOptions, reporter: Reporter) -> Iterator[LiveObserver | None]:
    """Yield the publisher for ROS 2's tools, or None if the run has none."""
    if not options.live_ros2:
        yield None
        return
    from deltaswarm_orchestrator.live.ros2_publisher import TOPICS, Ros2Publisher  # no other run needs ROS 2's messages

    with Ros2Publisher(options.live_ros2, scenario) as publisher:
        reporter.say(f"live: {' and '.join(TOPICS.values())} in ROS 2; they show the truth")
        yield publisher
