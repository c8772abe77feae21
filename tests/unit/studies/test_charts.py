"""The figures of a study, by what they draw and not by their pixels."""

import re

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle, StepPatch

from deltaswarm_studies import style
from deltaswarm_studies.charts import ellipse, left_out
from deltaswarm_studies.drawing import Drawing, draw
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import courses_of, runs_of, windows_with_levels
from tests.support.studying import LEVELS, MODES, OWN, made, series, table

NONE = pd.DataFrame()


def drawn(figure: str, runs: pd.DataFrame | None = None) -> Figure:
    """The figure of a `[[figure]]` table."""
    return drawing(figure, runs).figure


def drawing(figure: str, runs: pd.DataFrame | None = None, study: Study | None = None) -> Drawing:
    """The figure of a `[[figure]]` table, with what its caption must say."""
    study = study or made(f'{OWN}[[figure]]\nname = "f"\n{figure}')
    settings = study.file.figure[0]
    windows = windows_with_levels(study, series(lambda level, mode, replicate, time_s: time_s + replicate))
    runs = runs_of(study, table(), NONE) if runs is None else runs
    return draw(settings, study, Evidence(study, runs, courses_of(study, windows), NONE))


def words(axes: Axes) -> list[str]:
    return [label.get_text() for label in axes.get_xticklabels()]


def boxes_in(figure: Figure) -> int:
    return sum(type(patch) is Rectangle for axes in figure.axes for patch in axes.patches)


def test_a_box_for_each_level_and_hue() -> None:
    """And a point for each replicate; the axis has words and a unit."""
    figure = drawn('x = "mode"\nhue = "loss"\nmetric = "waiting_all"\n')
    [axes] = figure.axes
    assert boxes_in(figure) == 6
    assert sum(len(points.get_offsets()) for points in axes.collections) == 60  # type: ignore[arg-type]
    assert words(axes) == [style.shown(mode) for mode in MODES]
    assert re.fullmatch(r"\w.*sensed.* \[s\]", axes.get_ylabel())
    assert axes.get_xlabel() == "control"


def test_levels_of_a_factor_that_is_left_out_are_no_replicates() -> None:
    """Each replicate is averaged over them first: ten points a mode, not thirty; the caption names the factor."""
    settings = 'x = "mode"\nmetric = "waiting_all"\ncaption = "All."\n'
    study = made(f'{OWN}[[figure]]\nname = "f"\n{settings}')
    runs = runs_of(study, table(), NONE)
    [axes] = drawn(settings).axes
    places = np.concatenate([points.get_offsets() for points in axes.collections])  # type: ignore[arg-type]
    expected = [
        np.mean([run.waiting_all for run in runs.itertuples() if (run.mode, run.replicate) == (mode, replicate)])
        for mode in MODES
        for replicate in range(10)
    ]
    assert sorted(places[:, 1]) == pytest.approx(sorted(expected))
    assert left_out(study.file.figure[0], study) == ["frames lost"]
    whole = made(f'{OWN}[[figure]]\nname = "f"\nfacet = "loss"\n{settings}')
    assert left_out(whole.file.figure[0], whole) == []
    runs.loc[(runs["replicate"] == 3) & (runs["loss"] == "loss=0.5"), "waiting_all"] = (
        np.nan
    )  # nothing is averaged over what is left of a replicate
    [axes] = drawn(settings, runs).axes
    assert sum(len(points.get_offsets()) for points in axes.collections) == 9 * len(MODES)  # type: ignore[arg-type]


def test_fewer_than_five_values_make_no_box() -> None:
    """Points only: the quartiles would be the points themselves."""
    runs = runs_of(made(OWN), table(), NONE)
    figure = drawn('x = "mode"\nhue = "loss"\nmetric = "waiting_all"\n', runs[runs["replicate"] < 4])
    assert boxes_in(figure) == 0
    faces = {to_hex(points.get_facecolor()[0]) for points in figure.axes[0].collections}  # type: ignore[index]
    assert faces == {look.colour for look in style.looks(LEVELS).values()}


def test_a_facet_is_a_panel_with_shared_axes() -> None:
    """One for each level, titled by it."""
    figure = drawn('x = "mode"\nfacet = "loss"\nmetric = "waiting_all"\n')
    assert [axes.get_title() for axes in figure.axes] == ["loss=0.0", "loss=0.5", "loss=0.9"]
    assert len({axes.get_ylim() for axes in figure.axes}) == 1


def test_a_swept_number_is_a_numeric_axis() -> None:
    """Points stand where their numbers are; labels of other factors stand evenly."""
    numeric = drawn('kind = "levels"\nx = "loss"\nhue = "mode"\nmetric = "waiting_all"\n').axes[0]
    places = np.concatenate([line.get_xdata() for line in numeric.lines if len(line.get_xdata()) == 3])  # type: ignore[arg-type]
    assert sorted(set(np.round(places, 1))) == [0.0, 0.5, 0.9]
    even = drawn('kind = "levels"\nx = "mode"\nhue = "loss"\nmetric = "waiting_all"\n').axes[0]
    assert words(even) == [style.shown(mode) for mode in MODES]


def test_a_value_is_drawn_over_the_window_that_it_is_of() -> None:
    """So that an effect does not start before its cause."""
    figure = drawn('kind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n')
    [step, *_] = [patch for patch in figure.axes[0].patches if isinstance(patch, StepPatch)]
    values, edges, _ = step.get_data()
    assert edges.tolist() == [100.0 * window for window in range(11)]
    assert values.tolist() == [100.0 * window + 4.5 for window in range(10)]


def test_a_span_says_what_it_is() -> None:
    """Beside the stretch of time that it marks."""
    spans = 'spans = [{ text = "jammed", from_s = 200.0, until_s = 400.0 }]\n'
    figure = drawn(f'kind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n{spans}')
    assert all("jammed" in [text.get_text() for text in axes.texts] for axes in figure.axes)


def test_the_plane_joins_the_medians_in_the_order_that_is_asked_for() -> None:
    """A point for each replicate, an ellipse for each level, a line labelled along the way."""
    path = 'path = ["loss=0.9, hybrid 3", "loss=0.0, hybrid 3"]\n'
    figure = drawn(f'kind = "plane"\nx = "waiting"\nmetric = "messages"\nhue = "mode"\n{path}')
    [axes] = figure.axes
    assert sum(isinstance(patch, Ellipse) for patch in axes.patches) == 2
    assert [text.get_text() for text in axes.texts] == ["loss=0.9, hybrid 3", "loss=0.0, hybrid 3"]


def test_a_frontier_joins_the_medians_of_each_path() -> None:
    """Each labelled with its number; other variants stand alone; whiskers are the intervals along both axes."""
    paths = 'paths = { loss = ["loss=0.0, hybrid 3", "loss=0.5, hybrid 3", "loss=0.9, hybrid 3"] }\n'
    alone = 'variants = ["loss=0.0, decentralised"]\n'
    runs = runs_of(
        made(OWN), table(messages=lambda level, mode, replicate: LEVELS.index(level) + 1.05**replicate), NONE
    )
    figure = drawn(f'kind = "frontier"\nx = "waiting_all"\nmetric = "messages"\n{paths}{alone}', runs)
    [axes] = figure.axes
    assert [text.get_text() for text in axes.texts] == ["3", "3", "3"]
    joined = [line for line in axes.lines if len(line.get_xdata()) == 3]  # type: ignore[arg-type]
    medians = [float(np.median(1.05 ** np.arange(10))) + place for place in range(3)]
    assert [list(line.get_ydata()) for line in joined] == [pytest.approx(medians)]
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {"loss", "loss=0.0, decentralised"}
    assert len(axes.containers) == 4


def test_the_ellipse_is_one_standard_deviation_wide() -> None:
    """Along its own axes, whichever way they point."""
    along = np.array([-3.0, -1.0, 1.0, 3.0])
    width, height, angle = ellipse(np.stack([along, along], axis=1))
    assert width == pytest.approx(2 * np.sqrt(2) * along.std(ddof=1))
    assert height == pytest.approx(0, abs=1e-6)
    assert angle % 180 == pytest.approx(45)


def test_the_legend_never_covers_the_axes() -> None:
    """It stands below them, in room of its own."""
    figure = drawn('x = "mode"\nhue = "loss"\nmetric = "waiting_all"\n')
    figure.draw_without_rendering()
    [legend] = figure.legends
    assert legend.get_window_extent().y1 <= figure.axes[0].get_tightbbox().y0 + 1  # type: ignore[union-attr]


def test_a_level_looks_the_same_in_every_figure() -> None:
    """Whichever levels a figure shows."""
    all_modes = drawn('kind = "levels"\nx = "loss"\nhue = "mode"\nmetric = "waiting_all"\n')
    one = drawn(
        'kind = "levels"\nx = "loss"\nhue = "mode"\nmetric = "waiting_all"\nvariants = ["loss=0.0, hybrid 3"]\n'
    )
    colours = {h.get_label(): h.get_color() for h in all_modes.legends[0].get_lines()}  # type: ignore[attr-defined]
    assert colours
    assert [line.get_color() for line in one.legends[0].get_lines()] == [style.MODES["hybrid"].colour]


def test_nothing_to_draw_is_said() -> None:
    """Rather than an empty figure."""
    runs = runs_of(made(OWN), table(), NONE).assign(waiting_all=np.nan)
    with pytest.raises(ValueError, match="waiting_all"):
        drawn('x = "mode"\nmetric = "waiting_all"\n', runs)
