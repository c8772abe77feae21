"""Classes of events: they show in the jumps of sensed places alone."""

import math
from typing import Any

import numpy as np
import pytest

from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.task import TaskSettings
from deltaswarm_world.core.arrivals import EventClasses
from tests.swarms.test_checkpoint_cores import digests

SIZE_M = np.array([100.0, 100.0])
TASK = "operator.task={target_share=0.5, target_jump_m=0.5, decoy_jump_m=4, jump_every_s=3}"


def classes(seed: int = 0, **table: Any) -> EventClasses:
    return EventClasses(TaskSettings(**table), seed, SIZE_M)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_the_share_of_targets_is_as_asked(share: float) -> None:
    """And another seed has others."""
    one, other = (classes(seed, target_share=share) for seed in (1, 2))
    ids = range(2**62, 2**62 + 2000)
    targets = [one.is_target(event) for event in ids]
    assert sum(targets) / len(ids) == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / len(ids)))
    assert targets != [other.is_target(event) for event in ids]


def test_each_class_jumps_as_far_as_asked() -> None:
    """Along x and y, within an interval not at all, and never out of the arena."""
    one = classes(target_share=0.5, target_jump_m=0.3, decoy_jump_m=2.0, jump_every_s=10.0)
    for event in range(6):
        places_m = np.array([one.as_sensed(event, 50.0, 50.0, number)[1:] for number in range(1500)])
        jump_m = 0.3 if one.is_target(event) else 2.0
        assert places_m.std(axis=0) == pytest.approx(np.full(2, jump_m), rel=0.08)
        assert places_m.mean(axis=0) == pytest.approx(np.full(2, 50.0), abs=0.12 * jump_m)
        edge_m = np.array([one.as_sensed(event, 0.0, 100.0, number)[1:] for number in range(200)])
        assert edge_m.min() >= 0.0
        assert edge_m.max() <= 100.0
    assert [one.interval(time_s) for time_s in (0.0, 9.5, 10.0, 29.9, 30.0)] == [0, 0, 1, 2, 3]
    assert [classes(jump_every_s=0.3).interval(0.1 * step) for step in range(7)] == [0, 0, 0, 1, 1, 1, 2]


def test_a_run_with_classes_is_repeatable_and_goes_on_after_a_checkpoint() -> None:
    """Work is still done on all events; without classes nothing changes."""
    sets = ["run.duration_s=300", "control.mode=hybrid", "events.rate_hz=0.1", "events.work_agent_s=40"]
    plain, one, again = (run_in_process(load_scenario("smoke", [*sets, *more])) for more in ([], [TASK], [TASK]))
    assert one.digest == again.digest != plain.digest
    targets = one.world["targets"]
    assert plain.world["targets"] is None
    assert 0 < len(targets) < len(one.events)
    assert {event.event for event in one.events} > set(targets)
    assert sum(event.completed_s is not None for event in one.events) > 5
    with_classes = [*sets[1:], TASK]
    assert digests(with_classes, every=23) == digests(with_classes, every=301)
