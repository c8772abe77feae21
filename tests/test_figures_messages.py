"""Operator messages against messages within the swarm: points, and ellipses of one standard deviation."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from deltaswarm_orchestrator.figures import style
from deltaswarm_orchestrator.figures.messages import FRAMES_RECEIVED, FRAMES_SENT, OPERATOR_MESSAGES, ellipse, messages

VARIANTS = ["decentralised", "hierarchical", *(f"hybrid {delta}" for delta in range(2, 11))]


def table(runs: int = 20) -> pd.DataFrame:
    """Messages that scatter, aslant, around a mean that differs by variant."""
    rng = np.random.default_rng(5)
    rows = []
    for place, variant in enumerate(VARIANTS):
        for run in range(runs):
            x, y = rng.multivariate_normal([10 + place, 4 + place / 2], [[1.0, 0.5], [0.5, 0.6]])
            rows.append({"variant": variant, "replicate": run, FRAMES_SENT: x, OPERATOR_MESSAGES: y})
    return pd.DataFrame(rows).assign(**{FRAMES_RECEIVED: lambda rows: 5 * rows[FRAMES_SENT]})


def points(rows: pd.DataFrame, variant: str, x: str = FRAMES_SENT) -> np.ndarray:
    return rows.loc[rows["variant"] == variant, [x, OPERATOR_MESSAGES]].to_numpy()


def ellipses(figure: Figure) -> list[Ellipse]:
    return [patch for patch in figure.axes[0].patches if isinstance(patch, Ellipse)]


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_every_replicate_of_every_variant_is_a_point() -> None:
    """In the order of the table, with the look of the variant."""
    rows = table()
    figure = messages(rows)
    drawn = figure.axes[0].collections
    assert len(drawn) == len(VARIANTS)
    for collection, variant in zip(drawn, VARIANTS, strict=True):
        assert np.array_equal(collection.get_offsets(), points(rows, variant))
    assert legend(figure) == [style.shown(variant) for variant in VARIANTS]


def test_ellipses_have_the_covariances_eigenvalues() -> None:
    """Centre at the mean; half axes the square roots; the long one along its eigenvector."""
    rows = table()
    found = ellipses(messages(rows))
    assert len(found) == len(VARIANTS)
    for patch, variant in zip(found, VARIANTS, strict=True):
        of_variant = points(rows, variant)
        covariance = np.cov(of_variant.T)
        assert patch.center == pytest.approx(of_variant.mean(axis=0))
        small, large = np.linalg.eigvalsh(covariance)
        assert [(patch.width / 2) ** 2, (patch.height / 2) ** 2] == pytest.approx([large, small])
        along = np.array([np.cos(np.radians(patch.angle)), np.sin(np.radians(patch.angle))])
        assert covariance @ along == pytest.approx(large * along)


def test_the_ellipse_is_one_standard_deviation() -> None:
    """Its outline lies at a Mahalanobis distance of 1, and it holds 39 % of a normal cloud."""
    cloud = np.random.default_rng(6).multivariate_normal([0, 0], [[4, -1.5], [-1.5, 1]], size=20_000)
    width, height, angle = ellipse(cloud)
    turn = np.radians(angle)
    along = cloud @ [np.cos(turn), np.sin(turn)] / (width / 2)
    across = cloud @ [-np.sin(turn), np.cos(turn)] / (height / 2)
    assert np.mean(along**2 + across**2 < 1) == pytest.approx(1 - np.exp(-0.5), abs=0.01)


def test_points_on_a_line_have_a_flat_ellipse() -> None:
    """A decentralised agent reports what it broadcasts: rounding must not make a variance negative."""
    line = np.array([[9.0, 9.0], [9.7, 9.7], [10.3, 10.3]])
    width, height, angle = ellipse(line)
    assert angle % 180 == pytest.approx(45)
    assert height == pytest.approx(0, abs=1e-6)
    assert width == pytest.approx(2 * np.sqrt(2) * np.std(line[:, 0], ddof=1))


def test_one_replicate_has_no_ellipse() -> None:
    """A point, and no spread that nobody measured."""
    figure = messages(table(runs=1))
    assert not ellipses(figure)
    assert len(figure.axes[0].collections) == len(VARIANTS)


def test_the_horizontal_axis_is_a_parameter() -> None:
    """Frames received in place of frames sent."""
    rows = table()
    sent, received = messages(rows), messages(rows, FRAMES_RECEIVED, variants=["hybrid 3"])
    assert np.array_equal(received.axes[0].collections[0].get_offsets(), points(rows, "hybrid 3", FRAMES_RECEIVED))
    assert "sent" in sent.axes[0].get_xlabel()
    assert "received" in received.axes[0].get_xlabel()


def test_replicates_without_a_value_are_counted() -> None:
    """In the legend; a variant that has none at all is named."""
    rows = table()
    rows.loc[0, FRAMES_SENT] = np.nan
    figure = messages(rows, variants=["decentralised", "hybrid 3"])
    assert legend(figure)[0] == "decentralised\n(n = 19 of 20)"
    assert len(figure.axes[0].collections[0].get_offsets()) == 19
    rows.loc[rows["variant"] == "hybrid 7", OPERATOR_MESSAGES] = np.nan
    with pytest.raises(ValueError, match="'hybrid 7' has no value"):
        messages(rows)


def test_equal_points_do_not_hide_one_another() -> None:
    """A high delta behaves as decentralised to the message: later points are smaller and lie above."""
    sizes = [float(drawn.get_sizes()[0]) for drawn in messages(table()).axes[0].collections]
    assert sizes == sorted(sizes, reverse=True)
    assert len(set(sizes)) == len(sizes)


def test_all_is_within_the_axes() -> None:
    """No ellipse and no point is cut off, and the legend is on the page."""
    figure = messages(table())
    with style.drawing():
        figure.draw_without_rendering()
    axes = figure.axes[0]
    for patch in ellipses(figure):
        box = patch.get_window_extent()
        assert axes.bbox.x0 <= box.x0
        assert box.x1 <= axes.bbox.x1
        assert axes.bbox.y0 <= box.y0
        assert box.y1 <= axes.bbox.y1
    assert figure.legends[0].get_window_extent().x1 <= figure.bbox.x1
    assert figure.legends[0].get_window_extent().x0 >= axes.bbox.x1
