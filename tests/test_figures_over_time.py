"""Figures over time: means across replicates, their band, references and faults, and what is missing."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes

from deltaswarm_orchestrator.figures import style
from deltaswarm_orchestrator.figures.over_time import interval, over_time

WINDOW_S = 100.0


def series(runs: int = 8, windows: int = 12) -> pd.DataFrame:
    """Two variants that converge, by replicate and window, with rows in no order."""
    rng = np.random.default_rng(2)
    rows = [
        {
            "variant": variant,
            "replicate": run,
            "time_s": window * WINDOW_S,
            "agents_in_trees": high * (1 - np.exp(-window / 3)) + rng.random(),
        }
        for variant, high in (("25 agents", 12), ("100 agents", 33))
        for run in range(runs)
        for window in range(windows)
    ]
    return pd.DataFrame(rows).sample(frac=1, random_state=3)


def means(rows: pd.DataFrame, variant: str) -> np.ndarray:
    return rows[rows["variant"] == variant].groupby("time_s")["agents_in_trees"].mean().to_numpy()


def legend(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def band(axes: Axes, place: int) -> np.ndarray:
    """Lower and upper edge (2, windows) of a band."""
    vertices = axes.collections[place].get_paths()[0].vertices
    return np.array([[vertices[vertices[:, 0] == x][:, 1].min(), vertices[vertices[:, 0] == x][:, 1].max()]
                     for x in np.unique(vertices[:, 0])]).T  # fmt: skip


def test_lines_are_the_means_in_the_middle_of_the_windows() -> None:
    """Nothing is smoothed."""
    rows = series()
    axes = over_time(rows, variants=["25 agents", "100 agents"]).axes[0]
    for line, variant in zip(axes.lines, ["25 agents", "100 agents"], strict=True):
        assert line.get_xdata() == pytest.approx(np.arange(12) * WINDOW_S + WINDOW_S / 2)
        assert line.get_ydata() == pytest.approx(means(rows, variant))
    assert legend(axes) == ["25 agents, n = 8", "100 agents, n = 8"]
    assert axes.get_xlim() == (0, 12 * WINDOW_S)
    assert axes.get_ylim()[0] == 0


def test_the_band_is_the_bootstrap_interval_of_each_window() -> None:
    """It holds the mean, and is as wide as theory says: 1.96 standard errors, less a little for few replicates."""
    rows = series(runs=20)
    axes = over_time(rows, variants=["25 agents"]).axes[0]
    low, high = band(axes, 0)
    mean = means(rows, "25 agents")
    assert (low < mean).all()
    assert (mean < high).all()
    errors = rows[rows["variant"] == "25 agents"].groupby("time_s")["agents_in_trees"].sem().to_numpy()
    assert (high - low) / errors == pytest.approx(2 * 1.96, rel=0.15)


def test_the_interval_repeats_and_needs_two_values() -> None:
    """Equal values have an interval of no width; one value has none."""
    values = np.random.default_rng(4).normal(size=15)
    assert interval(values, 0.95) == interval(values, 0.95)
    low, high = interval(values, 0.5)
    assert interval(values, 0.95)[0] < low < high < interval(values, 0.95)[1]
    assert interval(np.array([2.0, 2.0]), 0.95) == (2.0, 2.0)
    assert np.isnan(interval(np.array([2.0]), 0.95)).all()


def test_one_replicate_has_a_line_and_no_band() -> None:
    """The legend says n = 1."""
    axes = over_time(series(runs=1)).axes[0]
    assert all(not collection.get_paths() for collection in axes.collections)
    assert {name.split(", ")[1] for name in legend(axes)} == {"n = 1"}


def test_windows_that_some_replicates_lack_are_counted() -> None:
    """The mean is that of the others; where all lack it there is a gap."""
    rows = series().sort_values(["variant", "replicate", "time_s"]).reset_index(drop=True)
    small = rows["variant"] == "25 agents"
    rows.loc[small & (rows["time_s"] == 500), "agents_in_trees"] = np.nan
    rows = rows[~(small & (rows["replicate"] == 0) & (rows["time_s"] >= 900))]
    axes = over_time(rows, variants=["25 agents"]).axes[0]
    drawn = axes.lines[0].get_ydata()
    assert len(drawn) == 12
    assert np.isnan(drawn).tolist() == [window == 5 for window in range(12)]
    assert drawn[-1] == pytest.approx(means(rows, "25 agents")[-1])
    assert legend(axes) == ["25 agents, n = 0 to 8"]


def test_references_and_faults_are_marked() -> None:
    """Dashed lines with their names outside the axes; a vertical line with the time."""
    axes = over_time(series(), references={"paper: 12": 12.0, "paper: 33": 33.0}, fault_s=450.0).axes[0]
    levels = [line.get_ydata()[0] for line in axes.lines if list(line.get_xdata()) == [0, 1]]
    assert levels == [12, 33]
    assert any(list(line.get_xdata()) == [450, 450] for line in axes.lines)
    assert [text.get_text() for text in axes.texts] == ["paper: 12", "paper: 33", "fault at 450 s"]
    assert [text.xy[0] for text in axes.texts[:2]] == [1.0, 1.0]


@pytest.mark.filterwarnings("error")
def test_a_reference_far_above_the_values_is_in_the_drawing() -> None:
    """As after a run too short for trees: else its name lay outside, and the axes had no room left."""
    low = series().assign(agents_in_trees=lambda rows: rows["agents_in_trees"] / 100)
    drawing = over_time(low, references={"paper: 33": 33.0})
    drawing.draw_without_rendering()
    bottom, top = drawing.axes[0].get_ylim()
    assert bottom == 0
    assert top > 33


def test_any_column_can_be_drawn() -> None:
    """With its own label, also below zero."""
    rows = series().assign(drift=lambda rows: -rows["agents_in_trees"])
    axes = over_time(rows, "drift", "drift [m]").axes[0]
    assert axes.get_ylabel() == "drift [m]"
    assert axes.get_ylim()[0] < -30


def test_what_cannot_be_drawn_is_named() -> None:
    """A variant with nothing, a replicate told twice, a column that is not there."""
    rows = series()
    empty = rows.assign(agents_in_trees=rows["agents_in_trees"].where(rows["variant"] != "100 agents"))
    with pytest.raises(ValueError, match="'100 agents' has no value of agents_in_trees in 8 runs"):
        over_time(empty)
    with pytest.raises(ValueError, match="'25 agents' has more than one row"):
        over_time(pd.concat([rows, rows]), variants=["25 agents"])
    with pytest.raises(ValueError, match="did you mean 'agents_in_trees'"):
        over_time(rows, "agents_in_tree")


def test_lines_differ_without_colour() -> None:
    """In their dashes."""
    axes = over_time(series()).axes[0]
    looks = style.looks(["25 agents", "100 agents"])
    assert len({str(look.line) for look in looks.values()}) == 2
    assert axes.lines[0].get_linestyle() != axes.lines[1].get_linestyle()
