"""Power by resampling: it agrees with closed forms and with numbers worked out by hand."""

import math

import numpy as np
import pytest
from scipy import stats as scipy_stats

from deltaswarm_sessions import power
from deltaswarm_sessions.power import (
    ADJUSTED,
    MAX_PARTICIPANTS,
    RESAMPLES,
    SIGNED_RANK,
    T_TEST,
    Array,
    Pilot,
    fit,
    powers,
    signed_rank_rejects,
    t_rejects,
)
from deltaswarm_studies.stats import contrast
from tests.support.tiers import in_one_test

NORMAL = np.asarray(scipy_stats.norm.ppf((np.arange(400) + 0.5) / 400))
"""A large pilot whose differences are normal with a standard deviation of nearly 1."""


def a_fit(differences: Array, others: Array | None = None) -> Pilot:
    found = fit(differences, others)
    assert found
    return found


def test_a_mean_has_its_error_and_interval() -> None:
    """3 of 1, 2, 3 and 6: the squares of the residuals add up to 14, with 3 degrees of freedom."""
    found = a_fit(np.array([1.0, 2.0, 3.0, 6.0]))
    assert [*found.residuals] == pytest.approx([-2, -1, 0, 3])
    assert (found.mean, found.degrees, found.parameters) == (pytest.approx(3), 3, 1)
    assert (found.deviation, found.error) == pytest.approx((2.160247, 1.080123))
    assert found.interval == pytest.approx((-0.437435, 6.437435), abs=1e-5)


def test_what_position_adds_is_removed() -> None:
    """10 and 2 for each position; residuals of 1 with 2 degrees of freedom. Redundant columns change nothing."""
    position = np.array([[1.0], [1.0], [-1.0], [-1.0]])
    for others in (position, np.hstack([position, -position, 3 * position])):
        found = a_fit(np.array([13.0, 11.0, 9.0, 7.0]), others)
        assert (found.mean, found.degrees, found.parameters) == (pytest.approx(10), 2, 2)
        assert [*found.residuals] == pytest.approx([1, -1, 1, -1])
        assert (found.deviation, found.error) == pytest.approx((math.sqrt(2), math.sqrt(0.5)))
        assert found.interval == pytest.approx((10 - 3.042435, 10 + 3.042435))


def test_what_cannot_be_fitted_is_none() -> None:
    """One order alone is the condition itself; as many parameters as differences leave nothing."""
    assert fit(np.arange(4.0), np.ones((4, 1))) is None
    assert fit(np.arange(4.0), np.full((4, 1), -2.0)) is None
    assert fit(np.array([1.0])) is None
    assert fit(np.array([1.0, 2.0])) is not None
    assert fit(np.arange(2.0), np.array([[1.0], [-1.0]])) is None
    assert fit(np.arange(3.0), np.array([[1.0], [-1.0], [1.0]])) is not None


@in_one_test(
    ("drawn", "effect", "is_rejected"),
    [
        ((2, 2), 1.0, False),  # t = 1 / (sqrt(4/3) / 2) = 1.73
        ((2, 2), 2.0, True),  # t = 3.46, above 3.18
        ((2, 2), -2.0, True),
        ((3, 1), 2.0, False),  # t = (2 - 0.5) / (1 / 2) = 3
        ((3, 1), -2.0, True),  # t = -5
        ((1, 3), -2.0, False),
        ((4, 0), 1e6, False),  # all are equal
    ],
)
def test_a_t_test_rejects_from_its_limit_on(drawn: tuple[int, int], effect: float, is_rejected: bool) -> None:
    """Of four differences, which are the effect less or more 1, at 5 % with 3 degrees of freedom."""
    found = t_rejects(np.array([drawn], dtype=float), np.array([-1.0, 1.0]), effect, 0.05, 3)
    assert [*found] == [is_rejected]


@in_one_test(
    ("drawn", "effect", "is_rejected"),
    [
        ((6, 0), 5.0, True),  # all six are positive: p = 2/64
        ((5, 0), 5.0, False),  # p = 2/32
        ((0, 6), -5.0, True),
        ((5, 1), 1.5, True),  # 0.5 five times and 2.5: all six are positive
    ],
)
def test_a_signed_rank_test_rejects_from_its_limit_on(drawn: tuple[int, int], effect: float, is_rejected: bool) -> None:
    """At 5 %, five differences of one sign are not enough, six are."""
    found = signed_rank_rejects(np.array([drawn], dtype=float), np.array([-1.0, 1.0]), effect, 0.05)
    assert [*found] == [is_rejected]


def test_the_signed_rank_test_is_that_of_studies() -> None:
    """Row by row, with ties and zeros: it rejects exactly where the p-value of a contrast is at most alpha."""
    rng = np.random.default_rng(3)
    residuals = rng.integers(-6, 7, 9).astype(float)
    drawn = rng.multinomial(12, np.full(9, 1 / 9), size=200).astype(float)
    rejected = signed_rank_rejects(drawn, residuals, 3.0, 0.05)
    assert 10 < rejected.sum() < 190
    for times, is_rejected in zip(drawn, rejected, strict=True):
        differences = np.repeat(residuals + 3.0, times.astype(int))
        assert is_rejected == (contrast(differences, np.zeros(12), "difference").p() <= 0.05)


@in_one_test(
    ("least", "group", "tried"),
    [
        (28, 4, [4, 8, 16, 24, 28, 32]),
        (4, 4, [4]),
        (7, 6, [6, 12]),
        (10**6, 12, [12, 24, 48, 96, 192, 384, 768, 996]),
        (980, 12, [12, 24, 48, 96, 192, 384, 768, 876, 936, 960, 972, 984, 996]),
    ],
)
def test_the_search_doubles_and_then_closes_in(
    least: int, group: int, tried: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the least multiple that has the wanted power, or on the largest that is allowed; errors are binomial."""
    some = Pilot(1.0, 1.0, (0.0, 2.0), np.array([1.0, -1.0]), 1)
    monkeypatch.setattr(power, "_power", lambda pilot, effect, n, *_: 0.8 if n >= least else 0.5)
    found = powers(some, 1.0, group=group, wanted=0.8, alpha=0.05, test=T_TEST, seed=1)
    errors = {0.5: pytest.approx(0.005), 0.8: pytest.approx(0.004)}
    assert found == [(n, share, errors[share]) for n in tried for share in [0.8 if n >= least else 0.5]]


@in_one_test(
    ("test", "alpha", "expected"),
    [
        (T_TEST, 0.05, [0.1258, 0.6286, 0.9226, 0.9896]),
        (ADJUSTED, 0.05, [0.1258, 0.6286, 0.9226, 0.9896]),
        (SIGNED_RANK, 0.05, [0.0, 0.6785, 0.8392, 0.9740]),
        (T_TEST, 0.01, [0.0139, 0.1623, 0.5290, 0.8406]),
    ],
)
def test_the_power_for_a_small_pilot(test: str, alpha: float, expected: list[float]) -> None:
    """Within six standard errors for 4, 8, 12 and 16 participants; the same seed gives the same numbers."""
    found = a_fit(np.array([1.0, 2.0, 3.0, 6.0]))
    tried, again, other = (
        powers(found, 2.0, group=4, wanted=0.8, alpha=alpha, test=test, seed=seed) for seed in (7, 7, 8)
    )
    assert [one.participants for one in tried] == [4, 8, 12, 16]
    assert [one.power for one in tried] == pytest.approx(expected, abs=0.03)
    assert tried == again
    assert tried != other


def t_power(effect: float, n: int, alpha: float) -> float:
    """The power of the paired t-test for normal differences with a standard deviation of 1."""
    limit = scipy_stats.t.isf(alpha / 2, n - 1)
    shifted = scipy_stats.nct(n - 1, effect * math.sqrt(n))
    return float(shifted.sf(limit) + shifted.cdf(-limit))


@pytest.mark.parametrize(("effect", "alpha"), [(0.5, 0.05), (-1.0, 0.01)])
def test_the_power_of_the_t_test_is_the_known_one(effect: float, alpha: float) -> None:
    """Within four standard errors, for every number tried; the answer is a multiple of the group within one of it."""
    deviation = float(np.std(NORMAL, ddof=1))
    tried = powers(a_fit(NORMAL), effect * deviation, group=4, wanted=0.8, alpha=alpha, test=T_TEST, seed=1)
    assert len(tried) > 3
    for n, found, error in tried:
        expected = t_power(effect, n, alpha)
        assert abs(found - expected) < 4 * max(error, math.sqrt(expected * (1 - expected) / RESAMPLES))
    answer = next(one.participants for one in tried if one.power >= 0.8)
    known = next(n for n in range(4, 400, 4) if t_power(effect, n, alpha) >= 0.8)
    assert abs(answer - known) <= 4


def test_without_an_effect_the_tests_keep_their_level() -> None:
    """No number of participants is enough. Opposite differences count for neither sign in the signed-rank test."""
    symmetric = np.asarray(scipy_stats.norm.ppf((np.arange(51) + 0.5) / 51))
    for test, least in ((T_TEST, 0.04), (SIGNED_RANK, 0.02)):
        tried = powers(a_fit(symmetric), 0.0, group=100, wanted=0.8, alpha=0.05, test=test, seed=1)
        assert tried[-1].participants == MAX_PARTICIPANTS
        assert all(least < one.power < 0.06 for one in tried)


def test_too_few_participants_pass_no_test() -> None:
    """Four, however large the effect: the least p-value is 1/8. Equal differences pass no t-test."""
    tried = powers(a_fit(NORMAL), 1e3, group=2, wanted=0.9, alpha=0.05, test=SIGNED_RANK, seed=1)
    assert [one.participants for one in tried if one.power == 0] == [2, 4]
    assert tried[-1].power == 1
    two = powers(a_fit(np.array([0.0, 1.0])), 10.0, group=2, wanted=0.99, alpha=0.05, test=T_TEST, seed=1)
    assert two[0].power == pytest.approx(0.5, abs=0.02)


def test_the_power_of_adjusted_differences_is_that_of_fewer_degrees_of_freedom() -> None:
    """Of a normal population; as many participants as parameters have no power."""
    others = np.resize([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]], (400, 2))
    pilot = a_fit(NORMAL + others @ [3.0, 7.0], others)
    tried = powers(pilot, pilot.deviation, group=3, wanted=0.9, alpha=0.05, test=ADJUSTED, seed=1)
    assert (tried[0].participants, tried[0].power) == (3, 0.0)
    for n, found, error in tried[1:]:
        limit = scipy_stats.t.isf(0.025, n - 3)
        # The variance is that of n resamples, which has n - 1 degrees of freedom; the limit is that of n - 3.
        expected = scipy_stats.nct(n - 1, math.sqrt(n)).sf(limit)
        assert abs(found - expected) < 4 * error + 0.01
    tried = powers(pilot, 50 * pilot.deviation, group=4, wanted=0.5, alpha=0.05, test=ADJUSTED, seed=1)
    assert tried[0].participants == 4, "one more has some"
