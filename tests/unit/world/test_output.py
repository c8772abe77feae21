"""The world's tables: which of them stay when it ends."""

from pathlib import Path

import pytest

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_world.core.world import WorldCore
from deltaswarm_world.io.files import EVENTS_SO_FAR, WorldOutput


@pytest.mark.parametrize("complete", [True, False])
@pytest.mark.parametrize("may_resume", [True, False])
def test_what_a_resumed_run_needs_stays(complete: bool, may_resume: bool, tmp_path: Path) -> None:
    """Also of a complete run, whose results may yet find the disk full."""
    with WorldOutput(tmp_path) as output:
        output.finish(WorldCore(load(Scenario, {})), complete, 0, may_resume=may_resume)
    assert (tmp_path / EVENTS_SO_FAR).exists() == (may_resume or not complete)
    assert (tmp_path / "events.csv").exists()
