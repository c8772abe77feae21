"""A figure against a swept number: a line per group, whiskers as given, and tables that cannot be drawn."""

import numpy as np
import pandas as pd
import pytest

from deltaswarm_orchestrator.figures import style
from deltaswarm_orchestrator.figures.lines import DODGE, lines

MODES = ["decentralised", "hierarchical", "hybrid"]


def table() -> pd.DataFrame:
    """Medians with uneven intervals, rows in no order."""
    rng = np.random.default_rng(8)
    rows = [
        {"radio.loss": loss, "control.mode": mode, "value": value, "low": value - below, "high": value + above}
        for place, mode in enumerate(MODES)
        for loss in (0.0, 0.1, 0.3, 0.5)
        for value, below, above in [(40 - 5 * place + rng.random(), rng.random(), 1 + rng.random())]
    ]
    return pd.DataFrame(rows).sample(frac=1, random_state=1)


def draw(rows: pd.DataFrame, **others: list[str]) -> list:
    """The error bars of each group: line, caps, bars."""
    figure = lines(rows, "radio.loss", "frames lost", "waiting time [s]", **others)
    return [container.lines for container in figure.axes[0].containers]


def test_one_line_per_group_through_its_values() -> None:
    """In the order of the swept number, in the looks of the modes."""
    rows = table()
    drawn = draw(rows, groups=MODES)
    assert len(drawn) == 3
    for (line, _, _), mode in zip(drawn, MODES, strict=True):
        own = rows[rows["control.mode"] == mode].sort_values("radio.loss")
        assert line.get_ydata() == pytest.approx(own["value"].to_numpy())
        assert line.get_xdata() == pytest.approx([0, 0.1, 0.3, 0.5], abs=2 * DODGE * 0.5)
        assert line.get_color() == style.MODES[mode].colour
        assert line.get_marker() == style.MODES[mode].marker


def test_whiskers_end_where_the_interval_does() -> None:
    """Also an uneven one."""
    rows = table()
    own = rows[rows["control.mode"] == "hybrid"].sort_values("radio.loss")
    ((_, _, (bars,)),) = draw(rows, groups=["hybrid"])
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    assert ends == pytest.approx(own[["low", "high"]].to_numpy())


def test_lines_stand_apart() -> None:
    """So that no whisker hides another; the middle one stands where it is."""
    first, middle, last = ([*line.get_xdata()] for line, _, _ in draw(table(), groups=MODES))
    assert middle == pytest.approx([0, 0.1, 0.3, 0.5])
    assert np.subtract(last, first) == pytest.approx(2 * DODGE * 0.5)


def test_a_point_without_interval_has_no_whisker() -> None:
    """It is still drawn."""
    rows = table()
    rows.loc[(rows["control.mode"] == "hybrid") & (rows["radio.loss"] == 0.3), ["low", "high"]] = np.nan
    ((line, _, (bars,)),) = draw(rows, groups=["hybrid"])
    assert np.isfinite(line.get_ydata()).all()
    assert [len(segment) for segment in bars.get_segments()].count(2) == 3


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("value", np.nan, "'hybrid': radio.loss and value must be finite"),
        ("radio.loss", np.inf, "'hybrid': radio.loss and value must be finite"),
        ("radio.loss", 0.1, "'hybrid' has more than one row for one radio.loss"),
        ("low", 99.0, "'hybrid': low <= value <= high"),
    ],
)
def test_what_cannot_be_drawn_is_named(column: str, value: float, message: str) -> None:
    """By group."""
    rows = table()
    rows.loc[(rows["control.mode"] == "hybrid") & (rows["radio.loss"] == 0.3), column] = value
    with pytest.raises(ValueError, match=message):
        draw(rows)


def test_groups_and_columns_that_are_not_there_are_named() -> None:
    """As are empty tables."""
    with pytest.raises(ValueError, match="'central' has no rows"):
        draw(table(), groups=["central"])
    with pytest.raises(ValueError, match="no column 'high'"):
        draw(table().drop(columns="high"))
    with pytest.raises(ValueError, match="no groups"):
        draw(table(), groups=[])
