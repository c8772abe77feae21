"""Speed and memory against the number of agents: logarithmic axes, medians, and the linear reference."""

import numpy as np
import pytest
from matplotlib.axes import Axes

from deltaswarm_orchestrator.report.plots.scale import LINEAR, ONLY, scale

COUNTS = [25, 50, 100, 400]
ROWS = [
    {
        "agents": count,
        "steps_per_s": 40_000 / count**1.2,
        "agent_steps_per_s": 40_000 / count**0.2,
        "rss_mb": 50 + count,
    }
    for count in COUNTS
]


def line(axes: Axes, name: str) -> np.ndarray:
    """What was drawn under a name (n, 2)."""
    return np.column_stack(next(line for line in axes.lines if line.get_label() == name).get_data())


def test_speed_and_memory_are_drawn_on_logarithmic_axes() -> None:
    """Steps per second on the left, memory on the right."""
    speed, memory = scale(ROWS).axes
    for axes, key in ((speed, "steps_per_s"), (memory, "rss_mb")):
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        assert line(axes, ONLY) == pytest.approx(np.array([[row["agents"], row[key]] for row in ROWS]))


def test_the_reference_is_linear_cost_from_the_smallest_swarm_on() -> None:
    """Four times the agents: a quarter of the steps, four times the memory."""
    speed, memory = scale(ROWS).axes
    steps, mb = line(speed, LINEAR)[:, 1], line(memory, LINEAR)[:, 1]
    assert steps[0] == pytest.approx(ROWS[0]["steps_per_s"])
    assert mb[0] == pytest.approx(ROWS[0]["rss_mb"])
    assert (steps * COUNTS) == pytest.approx(steps[0] * COUNTS[0])
    assert mb / COUNTS == pytest.approx(mb[0] / COUNTS[0])


def test_repeated_measurements_give_their_median_and_are_all_drawn() -> None:
    """In any order of rows."""
    rows = [{**row, "steps_per_s": row["steps_per_s"] * share} for share in (1.3, 1.0, 0.5) for row in ROWS[::-1]]
    speed, _ = scale(rows).axes
    assert line(speed, ONLY)[:, 1] == pytest.approx([row["steps_per_s"] for row in ROWS])
    assert len(line(speed, "each")) == len(rows)


def test_variants_have_lines_and_names() -> None:
    """The linear reference is named once; without variants it is the only name."""
    rows = [{**row, "variant": "one process"} for row in ROWS] + [{**row, "variant": "swarm"} for row in ROWS[:2]]
    figure = scale(rows)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["one process", "swarm", LINEAR]
    assert len(line(figure.axes[0], "swarm")) == 2
    assert [text.get_text() for text in scale(ROWS).legends[0].get_texts()] == [LINEAR]


@pytest.mark.parametrize("value", [None, 0, float("nan"), float("inf"), "many"])
def test_values_that_no_logarithm_has_are_named(value: object) -> None:
    """With the number of agents."""
    with pytest.raises(ValueError, match=r"rss_mb = .* with 50 agents"):
        scale([ROWS[0], {**ROWS[1], "rss_mb": value}])


def test_no_rows_is_said() -> None:
    """Rather than an empty page."""
    with pytest.raises(ValueError, match="no rows"):
        scale([])


def test_close_numbers_of_agents_are_not_written_over_one_another() -> None:
    """All are drawn, those with room are written."""
    rows = [{**ROWS[0], "agents": count} for count in (10, 11, 12, 100, 105, 1000)]
    axes = scale(rows).axes[0]
    assert axes.get_xticks().tolist() == [10, 100, 1000]
    assert len(line(axes, ONLY)) == 6
