"""A run with `--live ros2` is seen by nodes that others wrote."""

from pathlib import Path

import pytest

from tests.support.fields import endpoint, free_port
from tests.support.ros2_robots import session
from tests.support.scripted import Scripted, scripted
from tests.support.swarms import UNHURRIED, running, wait_until

pytestmark = [pytest.mark.processes, pytest.mark.slow]

AGENTS = 6


def test_markers_and_diagnostics_are_received(node: str, tmp_path: Path) -> None:
    router = free_port()
    live = ("--live", "ros2", "--live-connect", endpoint(router))
    with (
        session("router", endpoint(router)),
        scripted(Scripted, "tests.peers.watcher", node, router) as watcher,
        running(tmp_path / "run", "--set", "run.duration_s=300", *UNHURRIED, *live) as swarm,
    ):
        wait_until(lambda: any(row[0] for row in watcher.track), "markers")
        wait_until(lambda: any(row[1] for row in watcher.track), "diagnostics")
        swarm.end_well()
    assert {row[0] for row in watcher.track} == {0, AGENTS}
