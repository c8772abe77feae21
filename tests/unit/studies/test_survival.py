"""Times until a moment: by hand, against a product-limit of its own, and with intervals over runs, not over events."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import CensoredData, logrank

from deltaswarm_orchestrator.results.outcome import COMPLETED, TOLD, percentile_95
from deltaswarm_studies.events import until
from deltaswarm_studies.survival import (
    Survival,
    differences,
    families_in,
    log_rank,
    mean_until_s,
    quantile_s,
    survival_of,
)
from tests.support.studying import OWN, made

END_S = 1000.0

Life = tuple[float, float | None]
"""When an event arrives, and after which time the operator is told; None: never [s]."""


def table(runs: Sequence[Sequence[Life]], variant: str = "a") -> pd.DataFrame:
    """A table of events: a list of lives for each run."""
    rows: list[dict[str, Any]] = [
        {
            "variant": variant,
            "replicate": replicate,
            "event": number,
            "from_densest_m": float(number),
            "arrived_s": arrived_s,
            "told_s": math.nan if after_s is None else arrived_s + after_s,
            "end_s": END_S,
        }
        for replicate, lives in enumerate(runs)
        for number, (arrived_s, after_s) in enumerate(lives)
    ]
    return pd.DataFrame(rows)


def survival(*runs: Sequence[Life], horizon_s: float = 100.0) -> Survival:
    return Survival.of(table(runs), "a", TOLD, horizon_s)


def early(*times_s: float | None) -> list[Life]:
    """Events that are followed for long: each with its time."""
    return [(0.0, time_s) for time_s in times_s]


def test_an_event_is_followed_until_its_moment_the_horizon_or_the_end() -> None:
    """Of an event 20 s before the end nothing is known but 20 s; what comes at the horizon itself has come."""
    lives = [(980.0, None), (980.0, 5.0), (0.0, 100.0), (0.0, 100.5), (0.0, None), (950.0, 50.0)]
    times = until(table([lives]), TOLD, 100.0)
    assert times["time_s"].tolist() == [20.0, 5.0, 100.0, 100.0, 100.0, 50.0]
    assert times["is_censored"].tolist() == [True, False, False, True, True, False]


def test_each_moment_has_its_own_times() -> None:
    rows = table([[(10.0, 5.0)]]).assign(completed_s=70.0)
    assert until(rows, COMPLETED, 100.0)["time_s"].tolist() == [60.0]
    assert until(rows, TOLD, 100.0)["time_s"].tolist() == [5.0]


def test_a_curve_by_hand() -> None:
    """10, 20 (censored), 30, 40 (censored): three quarters are left after 10, half of these after 30."""
    row = survival([(0.0, 10.0), (980.0, None), (0.0, 30.0), (960.0, None)], horizon_s=40.0).row()
    assert row["mean_s"] == pytest.approx(10 + 20 * 0.75 + 10 * 0.375)
    assert (row["median_s"], row["p95_s"], row["came"], row["events"]) == (30.0, math.inf, 2, 4)


def test_a_mean_to_a_time_up_to_which_nobody_was_followed_is_not_known() -> None:
    """Unless nothing is left to wait for."""
    lives = [(0.0, 10.0), (990.0, None), (970.0, 25.0), (960.0, None)]
    assert math.isnan(survival(lives, horizon_s=50.0).row()["mean_s"])
    assert survival(lives, horizon_s=40.0).row()["mean_s"] == pytest.approx(10 + 15 * 3 / 4 + 15 * 3 / 8)
    assert survival([(970.0, 10.0), (970.0, 20.0)], horizon_s=90.0).row()["mean_s"] == 15.0


TIMES = st.lists(st.integers(0, 120), min_size=1, max_size=30)


@given(TIMES, st.integers(1, 110))
def test_without_censoring_before_the_horizon_it_is_the_metric(times_s: list[int], horizon_s: int) -> None:
    """The restricted mean and the 95th percentile that a run's summary has; beyond the horizon there is no quantile."""
    row = survival(early(*map(float, times_s)), horizon_s=float(horizon_s)).row()
    assert row["mean_s"] == pytest.approx(np.minimum(times_s, horizon_s).mean())
    p95_s = percentile_95(times_s)
    assert p95_s is not None
    assert row["p95_s"] == (p95_s if p95_s <= horizon_s else math.inf)
    assert row["came"] == sum(time_s <= horizon_s for time_s in times_s)


def product_limit(times: list[tuple[int, bool]], at_s: float) -> Fraction:
    """Kaplan and Meier's estimate in exact numbers; events that come count before those censored at the same time."""
    left = Fraction(1)
    for time_s in sorted({time_s for time_s, is_censored in times if not is_censored and time_s <= at_s}):
        at_risk = sum(other >= time_s for other, _ in times)
        came = sum(other == time_s and not is_censored for other, is_censored in times)
        left *= 1 - Fraction(came, at_risk)
    return left


@given(st.lists(st.tuples(st.integers(0, 40), st.booleans()), min_size=1, max_size=20))
def test_it_is_the_product_limit(times: list[tuple[int, bool]]) -> None:
    """At every whole second, whatever is censored when; its area is the restricted mean."""
    lives = [(END_S - time_s, None) if is_censored else (0.0, float(time_s)) for time_s, is_censored in times]
    found = survival(lives, horizon_s=50.0)
    for at_s in range(51):
        assert found.curve.evaluate(at_s) == pytest.approx(float(product_limit(times, at_s)))
    area_s = sum(float(product_limit(times, at_s)) for at_s in range(50))
    is_known = product_limit(times, 50) == 0
    assert mean_until_s(found.curve, 50.0) == (
        pytest.approx(area_s) if is_known else pytest.approx(math.nan, nan_ok=True)
    )


def test_quantiles_are_reached_at_their_share_and_within_the_horizon() -> None:
    times_s, shares = np.array([1.0, 2.0, 3.0]), np.array([0.6, 0.5 + 1e-12, 0.1])
    assert quantile_s(times_s, shares, 0.5, 10.0) == 2.0
    assert quantile_s(times_s, shares, 0.9, 3.0) == 3.0
    assert quantile_s(times_s, shares, 0.9, 2.9) == math.inf


def test_the_interval_is_that_of_the_runs_means() -> None:
    """With as many events in each run, nothing censored: a t-interval of the means 10, 20 and 60, by hand."""
    row = survival(early(5.0, 15.0), early(20.0, 20.0), early(50.0, 70.0), horizon_s=200.0).row()
    half = 4.302653 * math.sqrt((20**2 + 10**2 + 30**2) / 2) / math.sqrt(3)
    assert row["mean_s"] == pytest.approx(30.0)
    assert row["mean_high_s"] == pytest.approx(30.0 + half)
    assert row["mean_low_s"] == 0.0  # no time is below 0
    assert survival(early(5.0, 15.0), early(20.0, 20.0), early(50.0, 70.0), horizon_s=80.0).row()["mean_high_s"] == 80.0


RUNS = st.lists(st.lists(st.integers(1, 90), min_size=2, max_size=6), min_size=3, max_size=5)


@given(RUNS, st.integers(2, 10))
def test_more_events_of_the_same_runs_narrow_no_interval(runs: list[list[int]], times: int) -> None:
    """Each event many times: as if the events of a run were one. Events pooled as if independent would narrow it."""
    once = survival(*(early(*map(float, run)) for run in runs))
    often = survival(*(early(*map(float, run * times)) for run in runs))
    for name, value in once.row().items():
        if name not in ("events", "came"):
            assert often.row()[name] == pytest.approx(value, nan_ok=True), name
    pd.testing.assert_frame_equal(once.band, often.band)


def test_a_band_needs_runs_that_differ() -> None:
    """Of one run there is no interval; of equal runs it has no width; it stays between nothing and all."""
    alone = survival(early(10.0, 50.0, None))
    assert alone.band[["low", "high"]].isna().all(axis=None)
    assert {math.isnan(alone.row()[f"{name}_low_s"]) for name in ("mean", "median", "p95")} == {True}
    twins = survival(early(10.0, 50.0, None), early(10.0, 50.0, None))
    for edge in ("low", "high"):
        assert twins.band[edge].tolist() == pytest.approx(twins.band["share"].tolist())
    wide = survival(early(10.0, 20.0), early(None, None)).band
    assert (wide["low"].min(), wide["high"].max()) == (0.0, 1.0)
    assert wide["high"].iloc[0] == wide["low"].iloc[0] == 1.0  # all wait at first
    assert wide["time_s"].tolist() == [number * 100.0 / 400 for number in range(401)]


def test_the_interval_of_a_median_is_where_the_band_meets_one_half() -> None:
    """Not beyond the horizon: there it is longer than that."""
    found = survival(early(10.0, 30.0), early(20.0, 40.0), early(60.0, None))
    row = found.row()
    at_s = np.array([10.0, 20.0, 30.0, 40.0, 60.0, 100.0])
    _, low, high = found.at(at_s)
    assert row["median_s"] == 30.0
    # After 10 s it is 5/6, without one of the runs 1, 3/4 and 3/4: an error of 1/6, and 4.3 of these below 5/6.
    assert low[0] == pytest.approx(5 / 6 - 4.302653 / 6)
    assert row["median_low_s"] == at_s[low <= 0.5][0] == 10.0
    assert row["median_high_s"] == math.inf
    assert high.min() > 0.5


@given(RUNS)
def test_an_interval_holds_its_estimate(runs: list[list[int]]) -> None:
    row = survival(*(early(*(time_s / 500 for time_s in run)) for run in runs)).row()
    for name in ("mean", "median", "p95"):
        assert row[f"{name}_low_s"] <= row[f"{name}_s"] <= row[f"{name}_high_s"], name


def test_the_log_rank_statistic_is_scipys_and_above_0_if_the_first_is_sooner() -> None:
    """Without any moment there is no statistic, and no warning."""
    sooner, later = (
        until(table([early(*times)]), TOLD, 100.0) for times in ((1.0, 2.0, 9.0, None), (5.0, 8.0, 20.0, None))
    )
    pooled = [CensoredData.right_censored(rows["time_s"], rows["is_censored"]) for rows in (sooner, later)]
    assert log_rank(sooner, later) == logrank(*pooled).statistic > 0
    never = until(table([early(None, None)]), TOLD, 100.0)
    assert math.isnan(log_rank(never, never))
    assert log_rank(sooner, never) > 0 > log_rank(never, sooner)


def test_differences_are_paired_by_replicate_and_in_seconds() -> None:
    """Ten seconds in every run, however much the runs differ; replicates of one side only do not count."""
    slow = [early(base + 10.0, base + 30.0) for base in (10.0, 25.0, 40.0)]
    quick = [early(base, base + 20.0) for base in (10.0, 25.0, 40.0, 55.0)]
    a, b = (Survival.of(table(runs), "a", TOLD, 100.0) for runs in (slow, quick))
    means, ranks = differences(a, b)
    assert (means.n, means.estimate, means.p()) == (3, pytest.approx(10.0), 0.25)
    assert (ranks.n, ranks.p()) == (3, 0.25)
    assert ranks.estimate is not None
    assert ranks.estimate < 0


LEVELS = ("loss=0.0, decentralised", "loss=0.5, decentralised", "loss=0.9, decentralised")
SURVIVAL = f"""
[[survival]]
text = "told"
variants = {list(LEVELS)}
reference = "{LEVELS[0]}"
"""


def lives_of(shift_s: float) -> list[list[Life]]:
    return [early(10.0 + replicate + shift_s, 40.0 + replicate + shift_s, None) for replicate in range(8)]


def test_the_table_compares_each_variant_with_the_reference() -> None:
    """Eight replicates that agree give p = 2 / 2^8, twice that by Holm; the reference itself is not compared."""
    events = pd.concat([table(lives_of(shift_s), name) for name, shift_s in zip(LEVELS, (0.0, 6.0, -6.0), strict=True)])
    rows = survival_of(made(OWN + SURVIVAL), events).set_index("variant")
    assert rows["horizon_s"].unique().tolist() == [100.0]  # the scenario's
    assert rows["difference"].tolist()[1:] == pytest.approx([4.0, -4.0])
    assert rows["difference_p_holm"].tolist()[1:] == pytest.approx([2 / 2**7] * 2)
    assert rows["log_rank_p_holm"].tolist()[1:] == pytest.approx([2 / 2**7] * 2)
    assert rows.loc[LEVELS[0], ["difference", "log_rank"]].isna().all()
    assert (rows["difference_low"] <= rows["difference"]).tolist()[1:] == [True, True]
    assert [np.sign(value) for value in rows["log_rank"].tolist()[1:]] == [-1, 1]


def test_unjudged_variants_are_described_and_not_compared() -> None:
    events = pd.concat([table(lives_of(float(place)), name) for place, name in enumerate(LEVELS[:2])])
    study = made(OWN + SURVIVAL)
    assert survival_of(study, events)["variant"].tolist() == list(LEVELS[:2])
    for unjudged in LEVELS[:2]:
        rows = survival_of(study, events, [unjudged])
        assert rows["mean_s"].notna().all()
        assert "difference" not in rows
    assert survival_of(study, pd.DataFrame()).empty


def test_a_table_without_variants_has_all_and_one_with_variants_has_its_reference_too() -> None:
    events = pd.concat([table(lives_of(float(place)), name) for place, name in enumerate(LEVELS)])
    study = made(f'{OWN}[[survival]]\nreference = "{LEVELS[0]}"\n')
    assert survival_of(study, events)["variant"].tolist() == list(LEVELS)
    study = made(f'{OWN}[[survival]]\nvariants = ["{LEVELS[2]}"]\nreference = "{LEVELS[0]}"\n')
    assert survival_of(study, events)["variant"].tolist() == [LEVELS[2], LEVELS[0]]
    assert survival_of(study, events)["difference_n"].tolist()[:1] == [8]
    assert families_in(survival_of(study, events)) == [1, 1]
    assert families_in(survival_of(made(f"{OWN}[[survival]]\n"), events)) == []


def test_a_table_may_state_another_horizon() -> None:
    events = pd.concat([table(lives_of(0.0), name) for name in LEVELS])
    rows = survival_of(made(OWN + SURVIVAL + "horizon_s = 12.0\n"), events)
    expected_s = np.mean([(min(10.0 + replicate, 12.0) + 12.0 + 12.0) / 3 for replicate in range(8)])
    assert rows["mean_s"].tolist() == pytest.approx([expected_s] * 3)
    assert rows["came"].tolist() == [3] * 3
