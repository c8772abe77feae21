"""The figures of a study, by what they draw and not by their pixels."""

import re
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle, StepPatch

from deltaswarm_studies import labels, looks, style
from deltaswarm_studies.captions import left_out
from deltaswarm_studies.drawing import Drawing, draw
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.planes import ellipse, path_labels
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import courses_of, runs_of, windows_with_levels
from tests.support.studying import LEVELS, MODES, OWN, SWEEP, built_in, made, series, table
from tests.support.tiers import in_one_test

NONE = pd.DataFrame()


def drawn(figure: str, runs: pd.DataFrame | None = None) -> Figure:
    return drawing(figure, runs).figure


def drawing(figure: str, runs: pd.DataFrame | None = None, study: Study | None = None) -> Drawing:
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
    figure = drawn('x = "mode"\nhue = "loss"\nmetric = "waiting_all"\n')
    [axes] = figure.axes
    assert boxes_in(figure) == 6
    assert sum(len(points.get_offsets()) for points in axes.collections) == 60  # type: ignore[arg-type]
    assert words(axes) == [style.shown(mode) for mode in MODES]
    assert re.fullmatch(r"\w.*sensed \[s\]", axes.get_ylabel().replace("\n", " "))
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
    assert faces == {look.colour for look in looks.of_levels(made(OWN), "loss").values()}


def test_a_facet_is_a_panel_with_shared_axes() -> None:
    figure = drawn('x = "mode"\nfacet = "loss"\nmetric = "waiting_all"\n')
    assert [axes.get_title() for axes in figure.axes] == [f"frames lost [share]: {loss}" for loss in (0.0, 0.5, 0.9)]
    assert len({axes.get_ylim() for axes in figure.axes}) == 1


def test_a_swept_number_is_a_numeric_axis() -> None:
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


def test_the_band_of_the_last_window_with_values_is_drawn() -> None:
    """Events that arrive late are not followed, so the last windows of every run have no mean of them."""
    study = made(f'{OWN}[[figure]]\nname = "f"\nkind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n')
    windows = windows_with_levels(
        study, series(lambda level, mode, replicate, time_s: np.nan if time_s > 700 else time_s + replicate)
    )
    windows.loc[windows["time_s"] > 700, "waiting_all"] = np.nan
    figure = draw(
        study.file.figure[0], study, Evidence(study, runs_of(study, table(), NONE), courses_of(study, windows), NONE)
    )
    figures_bands = [one for one in figure.figure.axes[0].patches if isinstance(one, StepPatch) and one.get_fill()]
    assert len(figures_bands) == len(MODES)
    for band in figures_bands:
        assert band.get_path().get_extents().x1 == 800.0


def test_the_plane_joins_the_medians_in_the_order_that_is_asked_for() -> None:
    path = 'path = ["loss=0.9, hybrid 3", "loss=0.0, hybrid 3"]\n'
    figure = drawn(f'kind = "plane"\nx = "waiting"\nmetric = "messages"\nhue = "mode"\n{path}')
    [axes] = figure.axes
    assert sum(isinstance(patch, Ellipse) for patch in axes.patches) == 2
    assert [text.get_text() for text in axes.texts if text.get_text()] == ["0.9", "0.0"]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["decentralised", "hybrid 3", "medians, by frames lost [share]"]


def test_a_frontier_joins_the_medians_of_each_path() -> None:
    """Each labelled with its number; other variants stand alone; whiskers are the intervals along both axes."""
    paths = 'paths = { loss = ["loss=0.0, hybrid 3", "loss=0.5, hybrid 3", "loss=0.9, hybrid 3"] }\n'
    alone = 'variants = ["loss=0.0, decentralised"]\n'
    runs = runs_of(
        made(OWN), table(messages=lambda level, mode, replicate: LEVELS.index(level) + 1.05**replicate), NONE
    )
    figure = drawn(f'kind = "frontier"\nx = "waiting_all"\nmetric = "messages"\n{paths}{alone}', runs)
    [axes] = figure.axes
    assert [text.get_text() for text in axes.texts if text.get_text()] == ["0.0", "0.5", "0.9"]
    joined = [line for line in axes.lines if len(line.get_xdata()) == 3]  # type: ignore[arg-type]
    medians = [float(np.median(1.05 ** np.arange(10))) + place for place in range(3)]
    assert [list(line.get_ydata()) for line in joined] == [pytest.approx(medians)]
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {
        "loss",
        "frames lost [share]: 0.0, decentralised",
    }
    assert len(axes.containers) == 4


def test_the_ellipse_is_one_standard_deviation_wide() -> None:
    along = np.array([-3.0, -1.0, 1.0, 3.0])
    width, height, angle = ellipse(np.stack([along, along], axis=1))
    assert width == pytest.approx(2 * np.sqrt(2) * along.std(ddof=1))
    assert height == pytest.approx(0, abs=1e-6)
    assert angle % 180 == pytest.approx(45)


def test_a_level_looks_the_same_in_every_figure() -> None:
    all_modes = drawn('kind = "levels"\nx = "loss"\nhue = "mode"\nmetric = "waiting_all"\n')
    one = drawn(
        'kind = "levels"\nx = "loss"\nhue = "mode"\nmetric = "waiting_all"\nvariants = ["loss=0.0, hybrid 3"]\n'
    )
    colours = {h.get_label(): h.get_color() for h in all_modes.legends[0].get_lines()}  # type: ignore[attr-defined]
    assert colours
    assert [line.get_color() for line in one.legends[0].get_lines()] == [style.MODES["hybrid"].colour]


ALL = 'x = "mode"\nhue = "loss"\nmetric = "waiting_all"\n'
ALONG = 'kind = "levels"\nx = "loss"\nhue = "mode"\nmetric = "waiting_all"\n'


def runs_with(**waiting: Any) -> pd.DataFrame:
    return runs_of(made(OWN), table(**waiting), NONE)


@pytest.mark.parametrize("figure", [ALL, ALONG, f'{ALONG}facet = "mode"\n'.replace('hue = "mode"\n', "")])
def test_a_caption_says_of_how_many_replicates_a_value_is(figure: str) -> None:
    assert "n = 10" in drawing(figure).notes[0]
    runs = runs_with()
    lost = (runs["mode"] == "hybrid 3") & (runs["loss"] == "loss=0.5")
    fewer = " ".join(drawing(figure, runs[~(lost & (runs["replicate"] < 3))]).notes)
    assert "n = 7 to 10" in fewer
    assert re.search(r"hybrid 3.*\(7 of 10\)", fewer)
    assert "0.5" in fewer
    none = drawing(figure, runs[~lost])
    assert re.search(r"No values: .*0\.5", " ".join(none.notes))
    assert [axes.get_xlim() for axes in none.figure.axes] == [axes.get_xlim() for axes in drawing(figure).figure.axes]


def test_where_there_is_no_interval_none_is_drawn() -> None:
    """Five replicates give none: a whisker of no length would look like certainty."""
    runs = runs_with()
    few = drawing(ALONG, runs[runs["replicate"] < 5])
    assert "Medians of n = 5 replicates, without intervals, which need 6." in few.notes[0]
    ends = [cap for line in few.figure.axes[0].containers for cap in line[1]]
    assert all(np.isnan(np.asarray(cap.get_ydata(), float)).all() for cap in ends)
    some = drawing(ALONG, runs[(runs["replicate"] < 5) | (runs["mode"] == "decentralised")])
    assert "with exact 95 % intervals where there are at least 6" in some.notes[0]


def test_an_ellipse_needs_as_many_points_as_a_box() -> None:
    """Through two points there is always one; it says nothing of a third."""
    runs = runs_with(messages=lambda level, mode, replicate: 1.0 + replicate % 3)
    figure = 'kind = "plane"\nx = "waiting"\nmetric = "messages"\nhue = "mode"\n'
    few = drawing(figure, runs[(runs["mode"] == "decentralised") | (runs["replicate"] < 4)])
    assert sum(isinstance(patch, Ellipse) for patch in few.figure.axes[0].patches) == 1
    assert "fewer than 5 points have none" in few.notes[0]


def test_a_mean_over_some_levels_is_no_mean_over_all() -> None:
    """A replicate without a run of one level that the figure leaves out is dropped, not averaged over the others."""
    runs = runs_with()
    lost = (runs["replicate"] == 3) & (runs["loss"] == "loss=0.5")
    [axes] = drawn('x = "mode"\nmetric = "waiting_all"\n', runs[~lost]).axes
    assert sum(len(points.get_offsets()) for points in axes.collections) == 9 * len(MODES)  # type: ignore[arg-type]


def test_the_legend_has_what_is_in_the_picture_and_the_reverse() -> None:
    runs = runs_with()
    runs.loc[runs["mode"] == "hybrid 3", "waiting_all"] = np.nan
    lines = 'lines = { limit = 12.0, "that of hybrid" = "loss=0.0, hybrid 3" }\n'
    found = drawing(f"{ALONG}{lines}", runs)
    assert [text.get_text() for text in found.figure.legends[0].get_texts()] == ["decentralised", "limit"]
    assert any("Lines of variants without values are missing: that of hybrid." in note for note in found.notes)
    heights = [line.get_ydata() for line in found.figure.axes[0].lines if line.get_linewidth() == 0.7]
    assert [12.0, 12.0] in [list(height) for height in heights]


def test_a_metric_at_its_ceiling_is_shown_as_such() -> None:
    """A line where it is, and how many values say only that they are no less; none near it, none said."""
    at = drawing(ALONG, runs_with(waiting=lambda level, mode, replicate: 100.0 if mode == "hybrid 3" else 30.0))
    assert "ceiling" in [text.get_text() for text in at.figure.legends[0].get_texts()]
    assert any("30 of 60 values are at the ceiling of 100 s" in note for note in at.notes)
    below = drawing(ALONG, runs_with(waiting=lambda level, mode, replicate: 90.0))
    assert not any("ceiling" in note for note in below.notes)
    unbounded = drawing(ALONG.replace("waiting_all", "messages"), runs_with(messages=lambda *_: 100.0))
    assert not any("ceiling" in note for note in unbounded.notes)


def test_a_swept_number_stands_in_a_legend_under_its_title() -> None:
    [legend] = drawn(ALL).legends
    assert legend.get_title().get_text() == "frames lost [share]"
    assert [text.get_text() for text in legend.get_texts()] == ["0.0", "0.5", "0.9"]


def test_a_number_is_that_of_the_scenario_not_of_the_label() -> None:
    """Labels of the form `key=value` that a study wrote itself place nothing on a numeric axis."""
    study = made(sweep=SWEEP.replace('["decentralised", "hybrid 3"]', '["a=1", "a=5"]'))
    assert study.numbers("mode") == {}
    assert study.level_name("mode", "a=5") == "a=5"
    assert study.numbers("loss") == {"loss=0.0": 0.0, "loss=0.5": 0.5, "loss=0.9": 0.9}


def test_labels_along_a_path_are_values_of_the_scenarios() -> None:
    """Whatever the variants are called; several things that vary leave only the names."""
    study = built_in("paper")
    assert path_labels(study, ["hierarchical", "rho 3", "rho 7"]) == (
        "rho",
        {"hierarchical": "2", "rho 3": "3", "rho 7": "7"},
    )
    mixed = ["hybrid 3", "rho 3"]
    assert path_labels(study, mixed) == ("", {name: name for name in mixed})
    swept = ["loss=0.0, hybrid 3", "loss=0.9, hybrid 3"]
    assert path_labels(made(OWN), swept) == ("frames lost [share]", dict(zip(swept, ["0.0", "0.9"], strict=True)))


def test_no_label_lies_on_another_or_on_a_point() -> None:
    with style.drawing():
        figure = style.new_figure(4, 3)
        axes = figure.add_subplot()
        places = [(1.0, 1.0), (1.0, 1.0), (1.01, 1.0), (1.0, 1.02), (2.0, 2.0), (0.0, 0.0)]
        axes.plot(*zip(*places, strict=True), "o")
    style.laid_out(figure)
    labels.place(figure, [labels.Label(axes, f"label {index}", *at) for index, at in enumerate(places)])
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts if text.get_text()]
    assert len(boxes) == len(places)
    for index, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[index + 1 :])
        assert not any(box.contains(*axes.transData.transform(at)) for at in places)
        assert axes.bbox.x0 <= box.x0 < box.x1 <= axes.bbox.x1


def test_no_word_of_an_axis_is_broken() -> None:
    name = "hierarchically"
    sweep = SWEEP.replace('"decentralised", "hybrid 3"', ", ".join(f'"{name} {index}"' for index in range(7)))
    sweep = sweep.replace('"decentralised", "hybrid"', ", ".join(['"hybrid"'] * 7))
    sweep = sweep.replace("[sweep.axes]\nradio.loss = [0.0, 0.5, 0.9]\n", "[sweep.axes]\nradio.loss = [0.0]\n")
    study = made(
        f'{OWN}[[figure]]\nname = "f"\nx = "mode"\nmetric = "messages"\n',
        sweep + "control.delta = [2, 3, 4, 5, 6, 7, 8]\n",
    )
    runs = pd.concat(
        [
            table()[table()["variant"] == "loss=0.0, hybrid 3"].assign(variant=f"loss=0.0, {name} {index}")
            for index in range(7)
        ]
    )
    [axes] = drawing("", runs_of(study, runs.reset_index(drop=True), NONE), study).figure.axes
    assert words(axes) == [f"{name} {index}" for index in range(7)]
    assert {label.get_rotation() for label in axes.get_xticklabels()} == {40.0}
    assert axes.bbox.height / axes.figure.dpi >= 1.5


@in_one_test(("levels", "marked"), [("", [True] * 3), (', levels = ["loss=0.5"]', [False, True, False])])
def test_a_span_says_what_it_is_where_it_is_so(levels: str, marked: list[bool]) -> None:
    spans = f'spans = [{{ text = "jammed", from_s = 200.0, until_s = 400.0{levels} }}]\n'
    figure = drawn(f'kind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n{spans}')
    assert ["jammed" in [text.get_text() for text in axes.texts] for axes in figure.axes] == marked


def test_axes_that_do_not_begin_at_zero_are_named() -> None:
    runs = runs_with(waiting=lambda level, mode, replicate: 500.0 + replicate, messages=lambda *_: 4.0)
    figure = 'kind = "plane"\nx = "waiting_all"\nmetric = "messages"\nhue = "mode"\n'
    assert "The horizontal and the vertical axis do not begin at 0." in drawing(figure, runs).notes
    assert drawing(ALONG, runs).figure.axes[0].get_ylim()[0] == 0


def test_a_variant_that_is_not_judged_is_named() -> None:
    study = made(f'{OWN}[[figure]]\nname = "f"\n{ALONG}')
    runs = runs_with()
    lost = (runs["variant"] == "loss=0.5, hybrid 3") & (runs["replicate"] < 4)
    invalid = [
        {"variant": row.variant, "replicate": row.replicate, "means": "processes", "reason": "too slow"}
        for row in runs[lost].itertuples()
    ]
    evidence = Evidence(study, runs[~lost], NONE, NONE, invalid)  # type: ignore[arg-type]
    notes = draw(study.file.figure[0], study, evidence).notes
    assert "Not judged, since too many runs are invalid: frames lost [share]: 0.5, hybrid 3." in notes
