"""How speed scales: scenarios of one density at any size, and each measurement in a process of its own."""

import itertools

import pytest

from deltaswarm_orchestrator.bench import bench, scale


@pytest.mark.parametrize(("agents", "tiles"), [(1, 1), (25, 1), (30, 1), (50, 2), (100, 4), (200, 8), (400, 16)])
def test_every_size_has_the_papers_density(agents: int, tiles: int) -> None:
    """Of agents and of events; each tile has its own gaussian, and all tiles are alike."""
    made = scale.scale_scenario(agents, 100)
    area_m2 = made.arena.width_m * made.arena.height_m
    assert made.agents.count == agents
    assert agents / area_m2 == pytest.approx(bench.AGENTS_PER_M2)
    assert made.events.rate_hz / agents == pytest.approx(0.05 / 25)
    assert made.run.steps == 100
    assert made.problems() == []
    means = [component.mean_m for component in made.events.density.components]
    assert len(set(means)) == tiles
    side_m = (area_m2 / tiles) ** 0.5
    for (x_m, y_m), (other_x_m, other_y_m) in itertools.combinations(means, 2):
        assert max(abs(x_m - other_x_m), abs(y_m - other_y_m)) > 0.999 * side_m


@pytest.mark.processes
def test_growth_is_measured_between_sizes() -> None:
    """Speed, trees and memory of each size, and the exponent of the time of a step; said in words too."""
    found = scale.measure_scale(sizes=(5, 20), steps=30, rounds=1)
    assert [row["agents"] for row in found["sizes"]] == [5, 20]
    for row in found["sizes"]:
        assert row["agent_steps_per_s"] == pytest.approx(row["agents"] * row["steps_per_s"])
        assert 0 <= row["share_in_trees"] <= 1
        assert 10 < row["peak_memory_mb"] < 1000
    assert 0 < found["step_time_exponent"] < 3
    assert f"{found['step_time_exponent']:.2f}" in scale.text(found)


@pytest.mark.parametrize(
    ("sizes", "steps", "rounds"), [((0, 25), 10, 1), ((25, 50), 0, 1), ((25, 50), 10, 0), ((25, 25), 10, 1), ((), 9, 1)]
)
def test_what_cannot_be_measured_is_refused(sizes: tuple[int, ...], steps: int, rounds: int) -> None:
    """Before anything is started."""
    with pytest.raises(ValueError, match="expected"):
        scale.measure_scale(sizes, steps, rounds)


@pytest.mark.parametrize(("agents", "steps"), [(0, 10), (-1, 10), (3, 0)])
def test_a_bench_of_nothing_is_refused(agents: int, steps: int) -> None:
    """Saying what is expected, and what was found."""
    with pytest.raises(ValueError, match=f"not {agents} and {steps}"):
        bench.measure(agents, steps)
