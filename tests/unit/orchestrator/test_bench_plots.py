"""Speed and memory against the number of agents: logarithmic axes and the linear reference."""

import numpy as np
import pytest
from matplotlib.axes import Axes

from benchmarks.plots import LINEAR, scale

COUNTS = [25, 50, 100, 400]
ROWS = [
    {
        "agents": count,
        "steps_per_s": 40_000 / count**1.2,
        "agent_steps_per_s": 40_000 / count**0.2,
        "peak_memory_mb": 50 + count,
    }
    for count in COUNTS
]


def line(axes: Axes, name: str) -> np.ndarray:
    """What was drawn under a name (n, 2)."""
    return np.column_stack(next(line for line in axes.lines if line.get_label() == name).get_data())


def test_speed_and_memory_are_drawn_on_logarithmic_axes() -> None:
    """Steps per second on the left, memory on the right."""
    speed, memory = scale(ROWS).axes
    for axes, key in ((speed, "steps_per_s"), (memory, "peak_memory_mb")):
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        assert line(axes, "measured") == pytest.approx(np.array([[row["agents"], row[key]] for row in ROWS]))


def test_the_reference_is_linear_cost_from_the_smallest_swarm_on() -> None:
    """Four times the agents: a quarter of the steps, four times the memory."""
    speed, memory = scale(ROWS).axes
    steps, mb = line(speed, LINEAR)[:, 1], line(memory, LINEAR)[:, 1]
    assert steps[0] == pytest.approx(ROWS[0]["steps_per_s"])
    assert mb[0] == pytest.approx(ROWS[0]["peak_memory_mb"])
    assert (steps * COUNTS) == pytest.approx(steps[0] * COUNTS[0])
    assert mb / COUNTS == pytest.approx(mb[0] / COUNTS[0])


def test_close_numbers_of_agents_are_not_written_over_one_another() -> None:
    """All are drawn, those with room are written."""
    rows = [{**ROWS[0], "agents": count} for count in (10, 11, 12, 100, 105, 1000)]
    axes = scale(rows).axes[0]
    assert axes.get_xticks().tolist() == [10, 100, 1000]
    assert len(line(axes, "measured")) == 6
