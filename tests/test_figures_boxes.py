"""Box plots: a box per variant at its quartiles, a point per replicate, the paper beside, the missing counted."""

import itertools

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from deltaswarm_orchestrator.figures import paper, style
from deltaswarm_orchestrator.figures.boxes import MEDIAN_PT, UPRIGHT_AT_MOST, WAITING, boxes, jitter

VARIANTS = ["decentralised", "hierarchical", "hybrid 3"]


def table(variants: list[str], runs: int = 20) -> pd.DataFrame:
    """Waiting times around a mean that differs by variant."""
    rng = np.random.default_rng(1)
    return pd.DataFrame(
        {"variant": variant, "replicate": run, WAITING: rng.normal(40 - 5 * place, 3)}
        for place, variant in enumerate(variants)
        for run in range(runs)
    )


def values(rows: pd.DataFrame, variant: str) -> np.ndarray:
    return rows.loc[rows["variant"] == variant, WAITING].to_numpy()


def medians(figure: Figure) -> list[float]:
    """Heights of the lines drawn as medians: black and thick."""
    return [float(line.get_ydata()[0]) for line in figure.axes[0].lines if line.get_linewidth() == MEDIAN_PT]


def medians_of_lying(figure: Figure) -> list[float]:
    """The same of boxes that lie: values along x."""
    return [float(line.get_xdata()[0]) for line in figure.axes[0].lines if line.get_linewidth() == MEDIAN_PT]


def box_patches(figure: Figure) -> list[Rectangle]:
    return [patch for patch in figure.axes[0].patches if isinstance(patch, Rectangle)]


def names(figure: Figure) -> list[str]:
    return [label.get_text() for label in figure.axes[0].get_xticklabels()]


def test_boxes_stand_at_quartiles_and_medians() -> None:
    """One per variant, in the order asked for."""
    rows = table(VARIANTS)
    wanted = VARIANTS[::-1]
    figure = boxes(rows, variants=wanted)
    assert medians(figure) == pytest.approx([np.median(values(rows, variant)) for variant in wanted])
    patches = box_patches(figure)
    assert len(patches) == 3
    for patch, variant in zip(patches, wanted, strict=True):
        assert [patch.get_y(), patch.get_y() + patch.get_height()] == pytest.approx(
            np.percentile(values(rows, variant), [25, 75])
        )


def test_whiskers_reach_the_farthest_replicate_near_the_box() -> None:
    """Within 1.5 interquartile ranges; one beyond is a point alone."""
    rows = table(["hybrid 3"], runs=9)
    rows[WAITING] = [1.0, 10, 11, 12, 13, 14, 15, 16, 20]
    heights = {float(y) for line in boxes(rows).axes[0].lines for y in line.get_ydata()}
    assert heights == {10, 11, 13, 15, 20}


def test_every_replicate_is_a_point() -> None:
    """At its value, within its box's width, and in the same place each time."""
    rows = table(VARIANTS)
    points, again = (
        [np.asarray(collection.get_offsets()) for collection in boxes(rows).axes[0].collections] for _ in range(2)
    )
    for place, (variant, drawn, twice) in enumerate(zip(VARIANTS, points, again, strict=True), start=1):
        assert np.array_equal(drawn, twice)
        assert drawn[:, 1] == pytest.approx(values(rows, variant))
        assert np.abs(drawn[:, 0] - place).max() < 0.25
        assert len(np.unique(drawn[:, 0])) == 20


def test_jitter_is_spread_evenly() -> None:
    """No two of 20 points closer than a third of an even spacing, all within the width."""
    offsets = np.sort(jitter(20))
    assert offsets[0] >= -0.5
    assert offsets[-1] <= 0.5
    assert np.diff(offsets).min() > 1 / 20 / 3


def test_the_paper_stands_beside_each_box_that_it_speaks_of() -> None:
    """A diamond at its median with bars of one interquartile range in all, right of the box."""
    figure = boxes(table(["no recruitment", *VARIANTS]), paper=paper.WAITING_TIME_S)
    (container,) = figure.axes[0].containers
    line, _, (bars,) = container.lines
    assert list(line.get_ydata()) == [42.1, 34.0, 26.4]
    assert line.get_marker() == "D"
    lengths = [segment[1][1] - segment[0][1] for segment in bars.get_segments()]
    assert lengths == pytest.approx([4.7, 12.0, 8.8])
    half_box = box_patches(figure)[0].get_width() / 2
    assert (line.get_xdata() - [2, 3, 4] > half_box).all()


def test_without_the_paper_there_is_nothing_beside() -> None:
    """And no legend."""
    axes = boxes(table(VARIANTS)).axes[0]
    assert not axes.containers
    assert axes.get_legend() is None


def test_replicates_without_a_value_are_counted() -> None:
    """In the variant's name; the rest is drawn."""
    rows = table(VARIANTS)
    rows.loc[[0, 1], WAITING] = np.nan
    figure = boxes(rows)
    assert names(figure) == ["decentralised\nn = 18 of 20", "hierarchical\nn = 20", "hybrid $\\delta = 3$\nn = 20"]
    assert medians(figure)[0] == pytest.approx(np.nanmedian(values(rows, "decentralised")))


def test_none_counts_as_missing() -> None:
    """As a summary without any event gives it."""
    rows = table(["hybrid 3"]).astype({WAITING: object})
    rows.loc[0, WAITING] = None
    assert "n = 19 of 20" in names(boxes(rows))[0]


def test_a_variant_without_any_value_is_named() -> None:
    """Rather than left out."""
    rows = table(VARIANTS)
    rows.loc[rows["variant"] == "hierarchical", WAITING] = np.nan
    with pytest.raises(ValueError, match=r"'hierarchical' has no value of waiting_time_s\.mean in 20 runs"):
        boxes(rows)


def test_what_is_not_there_is_named() -> None:
    """Variants, columns with what was meant, and empty tables."""
    rows = table(VARIANTS)
    with pytest.raises(ValueError, match="'hybrid 4' has no rows; there are 'decentralised', 'hierarchical'"):
        boxes(rows, variants=["hybrid 4"])
    with pytest.raises(ValueError, match=r"no column 'waiting_time.mean'; did you mean 'waiting_time_s.mean'"):
        boxes(rows, "waiting_time.mean")
    with pytest.raises(ValueError, match="no rows"):
        boxes(rows[:0])
    with pytest.raises(ValueError, match="no variants"):
        boxes(rows, variants=[])


def test_many_boxes_lie() -> None:
    """First at the top, their values along x, their names in one line."""
    variants = [f"hybrid {delta}" for delta in range(2, 3 + UPRIGHT_AT_MOST)]
    rows = table(variants)
    figure = boxes(rows, label="wait [s]", paper=paper.WAITING_TIME_S)
    axes = figure.axes[0]
    assert axes.get_xlabel() == "wait [s]"
    assert axes.get_ylim()[0] > axes.get_ylim()[1]
    assert np.asarray(axes.collections[0].get_offsets())[:, 0] == pytest.approx(values(rows, variants[0]))
    assert axes.get_yticklabels()[0].get_text() == r"hybrid $\delta = 2$, n = 20"
    assert list(axes.containers[0].lines[0].get_xdata()) == [26.4]
    for patch, variant in zip(box_patches(figure), variants, strict=True):
        ends = [patch.get_x(), patch.get_x() + patch.get_width()]
        assert ends == pytest.approx(np.percentile(values(rows, variant), [25, 75]))


def test_more_boxes_than_looks_can_be_drawn() -> None:
    """Each has its name beside it."""
    variants = [f"loss {loss} %" for loss in range(0, 90, 10)]
    assert len(variants) > len(style.OTHERS)
    assert len(medians_of_lying(boxes(table(variants)))) == len(variants)


def test_looks_are_the_variants_own() -> None:
    """Colour and hatch of the mode, so that a box is known in every figure."""
    patch = box_patches(boxes(table(VARIANTS)))[1]
    look = style.MODES["hierarchical"]
    assert patch.get_hatch() == look.hatch
    assert style.mix(look.colour, look.colour, 0) == style.to_hex(patch.get_edgecolor())


def test_names_do_not_touch() -> None:
    """Side by side at the most, with long names: measured as drawn."""
    variants = ["decentralised", "hierarchical", "no recruitment", "no dissolution", "hybrid 10", "a rather long name"]
    assert len(variants) == UPRIGHT_AT_MOST
    figure = boxes(table(variants))
    with style.drawing():
        figure.draw_without_rendering()
    extents = [label.get_window_extent() for label in figure.axes[0].get_xticklabels()]
    assert all(one.x1 < other.x0 for one, other in itertools.pairwise(extents))
    assert extents[0].x0 >= 0
    assert extents[-1].x1 <= figure.bbox.x1
