"""Verdicts of claims: mirrored when sides are swapped, never at odds with their intervals."""

import itertools
import math

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_studies.claims import claims_of, vacuous_claims
from deltaswarm_studies.contrasts import contrasts_of
from deltaswarm_studies.tables import runs_of
from tests.support.studying import FAST, LEVELS, LIMIT, MODES, OWN, SAME, SLOW, made, spread, table, worse_at_90
from tests.support.tiers import in_one_test

NONE = pd.DataFrame()


def claim(text: str) -> pd.Series:
    study = made(OWN + f'[[claim]]\nid = "c"\ntext = "c"\nmetric = "waiting_all"\n{text}')
    return claims_of(study, runs_of(study, table(worse_at_90), NONE)).iloc[0]


@in_one_test(
    ("text", "verdict"),
    [
        (f'less = "{FAST}"\nmore = "{SLOW}"', "holds"),
        (f'less = "{SLOW}"\nmore = "{FAST}"', "refuted"),
        (f'less = "{FAST}"\nmore = "{SAME}"', "undecided"),
        (f'less = "{FAST}"\nmore = "{SLOW}"\nat_least = 1.5', "holds"),
        (f'less = "{FAST}"\nmore = "{SLOW}"\nat_least = 3.0', "refuted"),
        (f'kind = "alike"\na = "{FAST}"\nb = "{SAME}"\nmargin = 1.1', "holds"),
        (f'kind = "alike"\na = "{FAST}"\nb = "{SLOW}"\nmargin = 1.1', "refuted"),
        (f'kind = "alike"\na = "{FAST}"\nb = "{SLOW}"\nmargin = 2.0', "undecided"),
        (f'kind = "alike"\na = "{SLOW}"\nb = "{FAST}"\nratio = 2.0\nmargin = 1.1', "holds"),
        (f'kind = "alike"\na = "{FAST}"\nb = "{SLOW}"\nratio = 0.5\nmargin = 1.1', "holds"),
        (f'kind = "alike"\na = "{SLOW}"\nb = "{FAST}"\nratio = 1.5\nmargin = 1.1', "refuted"),
        (f'kind = "alike"\na = "{SLOW}"\nb = "{FAST}"\nratio = 4.0\nmargin = 2.0', "undecided"),
        (f'kind = "value"\nof = "{FAST}"\nwithin = [15.0, 40.0]', "holds"),
        (f'kind = "value"\nof = "{SLOW}"\nwithin = [15.0, 30.0]', "refuted"),
        (f'kind = "value"\nof = "{FAST}"\nwithin = [25.0, 26.0]', "undecided"),
    ],
)
def test_verdicts_are_symmetric(text: str, verdict: str) -> None:
    assert claim(text)["verdict"] == verdict


ORDERS = st.sampled_from([1.0, 1.25, 2.0, 4.0])
FACTORS = st.lists(st.floats(0.2, 5), min_size=6, max_size=6)
"""What the metric is multiplied with, by level and mode; replicates differ by what the noise adds."""
NOISE = st.lists(st.floats(0.5, 2), min_size=10, max_size=10)
VARIANTS = [f"{level}, {mode}" for level in LEVELS for mode in MODES]
SIDES = st.lists(st.tuples(st.sampled_from(VARIANTS), st.sampled_from(VARIANTS), ORDERS), min_size=1, max_size=6).map(
    lambda sides: [side for side in sides if side[0] != side[1]]
)


def judged(text: str, factors: list[float], noise: list[float], zero: bool = False) -> pd.DataFrame:

    def value(level: str, mode: str, replicate: int) -> float:
        index = LEVELS.index(level) * len(MODES) + MODES.index(mode)
        if zero and (index + replicate) % 7 == 0:
            return 0.0
        return 20.0 * factors[index] * noise[(replicate * (index + 1)) % len(noise)]

    study = made(OWN + text)
    return claims_of(study, runs_of(study, table(value), NONE))


MIRRORED = {"holds": "refuted", "refuted": "holds", "undecided": "undecided"}


@given(SIDES, FACTORS, NOISE, st.booleans())
def test_swapping_a_claims_sides_mirrors_its_verdict(
    sides: list[tuple[str, str, float]], factors: list[float], noise: list[float], zero: bool
) -> None:
    """With the inverse ratio: what held is refuted, what was refuted holds, and p is the same, in any family."""
    if not sides:
        return
    order = '[[claim]]\nid = "{}"\ntext = "c"\nmetric = "waiting_all"\nless = "{}"\nmore = "{}"\nat_least = {!r}\n'
    if zero:  # differences of multiples do not mirror exactly
        sides = [(less, more, 1.0) for less, more, _ in sides]
    forth = judged("".join(order.format(i, a, b, r) for i, (a, b, r) in enumerate(sides)), factors, noise, zero)
    back = judged("".join(order.format(i, b, a, 1 / r) for i, (a, b, r) in enumerate(sides)), factors, noise, zero)
    assert [MIRRORED[verdict] for verdict in forth["verdict"]] == back["verdict"].tolist()
    assert forth["p_holm"].tolist() == pytest.approx(back["p_holm"].tolist())


@given(SIDES, FACTORS, NOISE)
def test_two_variants_are_alike_whichever_is_named_first(
    sides: list[tuple[str, str, float]], factors: list[float], noise: list[float]
) -> None:
    if not sides:
        return
    alike = (
        '[[claim]]\nid = "{}"\ntext = "c"\nmetric = "waiting_all"\nkind = "alike"\na = "{}"\nb = "{}"\nmargin = {!r}\n'
    )
    forth = judged("".join(alike.format(i, a, b, r + 0.1) for i, (a, b, r) in enumerate(sides)), factors, noise)
    back = judged("".join(alike.format(i, b, a, r + 0.1) for i, (a, b, r) in enumerate(sides)), factors, noise)
    assert forth["verdict"].tolist() == back["verdict"].tolist()
    assert forth["p_holm"].tolist() == pytest.approx(back["p_holm"].tolist())


@given(FACTORS, NOISE, st.floats(1.02, 2), st.booleans())
def test_interval_p_and_verdict_never_contradict_each_other(
    factors: list[float], noise: list[float], margin: float, zero: bool
) -> None:
    text = LIMIT.replace("margin = 1.1", f"margin = {margin!r}")
    head = '[[claim]]\nid = "{}"\ntext = "c"\nmetric = "waiting_all"\n'
    text += "".join(
        head.format(f"{i}{kind}") + body
        for i, (a, b) in enumerate(itertools.pairwise(VARIANTS[2:]))
        for kind, body in (
            ("o", f'less = "{a}"\nmore = "{b}"\nat_least = {margin!r}\n'),
            ("a", f'kind = "alike"\na = "{a}"\nb = "{b}"\nmargin = {margin!r}\n'),
            ("v", f'kind = "value"\nof = "{a}"\nwithin = [10.0, {30 * margin!r}]\niqr = 4.0\nn = 20\n'),
        )
    )
    claims = judged(text, factors, noise, zero)
    for _, row in claims.iterrows():
        low, high = (end if pd.notna(end) else far for end, far in ((row["low"], -math.inf), (row["high"], math.inf)))
        least, most = {"o": (margin, math.inf), "a": (1 / margin, margin), "v": (10.0, 30 * margin)}[row["claim"][-1]]
        if row["scale"] == "difference":
            least, most = (0.0, math.inf) if row["claim"][-1] == "o" else (-math.inf, math.inf)
        is_decided = row["p_holm"] <= 0.05
        assert is_decided == (row["verdict"] in ("holds", "refuted"))
        if row["scale"] == "difference" and row["claim"][-1] == "a":
            continue  # its interval is one of differences, and its verdict one of ratios
        if row["verdict"] == "holds":
            assert least <= low * (1 + 1e-8)
            assert high <= most * (1 + 1e-8)
        elif row["verdict"] == "refuted":
            assert high <= least * (1 + 1e-8) or low * (1 + 1e-8) >= most
        else:
            assert low <= least * (1 + 1e-8) or high * (1 + 1e-8) >= most
    study = made(OWN + text)

    def value(level: str, mode: str, replicate: int) -> float:
        index = LEVELS.index(level) * len(MODES) + MODES.index(mode)
        return 20.0 * factors[index] * noise[(replicate * (index + 1)) % len(noise)] * (not zero or replicate > 0)

    for _, row in contrasts_of(study, runs_of(study, table(value), NONE)).iterrows():
        none = 1.0 if row["scale"] == "ratio" else 0.0
        low, high = (end if pd.notna(end) else far for end, far in ((row["low"], -math.inf), (row["high"], math.inf)))
        assert (row["p_holm"] <= 0.05) == ("er" in row["verdict"]) == (low > none or high < none), row
        assert ("higher" in row["verdict"]) == (low > none)
        assert ("lower" in row["verdict"]) == (high < none)
        if row["verdict"].startswith(("alike", "slightly")) and row["scale"] == "ratio":
            assert 1 / margin <= low * (1 + 1e-8)
            assert high <= margin * (1 + 1e-8)


def test_a_value_is_compared_with_the_sources_own_error() -> None:
    """The same number is decided where the source is exact, and not where it says how little it knows."""
    value = f'kind = "value"\nof = "{FAST}"\nwithin = [8.0, 43.0]\n'
    exact, vague = claim(value), claim(value + "iqr = 30.0\nn = 10\n")
    assert (exact["verdict"], vague["verdict"]) == ("holds", "undecided")
    assert vague["low"] < exact["low"] < exact["estimate"] == vague["estimate"] < exact["high"] < vague["high"]
    assert claim(f'kind = "value"\nof = "{SLOW}"\nabove = 30.0\n')["verdict"] == "holds"
    assert claim(f'kind = "value"\nof = "{FAST}"\nabove = 50.0\n')["verdict"] == "refuted"


def test_a_claim_without_values_or_of_predictors_is_not_called_vacuous() -> None:
    """Nothing is known of it; ratios of values below 1 are ratios as well."""
    text = f'kind = "alike"\na = "{FAST}"\nb = "{SAME}"\nmargin = 5.0'
    study = made(OWN + f'[[claim]]\nid = "c"\ntext = "c"\nmetric = "waiting_all"\n{text}')
    runs = runs_of(study, table(worse_at_90), NONE)
    assert vacuous_claims(study, runs.assign(waiting_all=math.nan)) == []
    assert vacuous_claims(study, runs.assign(waiting_all=runs["waiting_all"] / 1000)) != []
    assert vacuous_claims(study, runs.assign(waiting_all=runs["waiting_all"] - runs["waiting_all"].min())) == []
    predicts = '[[claim]]\nid = "c"\ntext = "c"\nkind = "predicts"\nmetric = "waiting_all"\n'
    study = made(OWN + predicts + 'less = "messages"\nmore = "waiting"\nat_least = 0.001\n')
    assert vacuous_claims(study, runs_of(study, table(worse_at_90), NONE)) == []


def test_an_interval_has_the_confidence_at_which_its_claim_is_tested() -> None:
    """95 % alone; in a family the first of Holm's tests has more."""
    text = f'less = "{FAST}"\nmore = "{SLOW}"\n'
    assert claim(text)["confidence"] == pytest.approx(0.95)
    study = made(OWN + "".join(f'[[claim]]\nid = "{name}"\ntext = "t"\n{text}' for name in "abcde"))
    found = claims_of(study, runs_of(study, table(spread), NONE))
    assert found["confidence"].tolist() == pytest.approx([0.99] * 5)


def test_holms_correction_is_over_the_claims_of_one_source() -> None:
    one = '[[claim]]\nid = "{}"\ntext = "t"\nsource = "{}"\nmetric = "waiting_all"\n'
    one += f'less = "{FAST}"\nmore = "{SLOW}"\n'
    study = made(OWN + "".join(one.format(name, source) for name, source in (("a", "x"), ("b", "x"), ("c", "y"))))
    found = claims_of(study, runs_of(study, table(worse_at_90), NONE)).set_index("claim")
    assert found["family"].to_dict() == {"a": 2, "b": 2, "c": 1}
    assert found.loc["a", "p_holm"] == pytest.approx(2 * found.loc["c", "p_holm"])


@pytest.mark.parametrize(
    ("less", "more", "verdict"), [("messages", "waiting", "holds"), ("waiting", "messages", "refuted")]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_the_better_of_two_predictors_is_found(less: str, more: str, verdict: str, sign: int) -> None:
    """Waiting of sensed events has the order of `waiting_all` or the reverse; messages do not."""

    def exact(level: str, mode: str, replicate: int) -> float:
        return spread(level, mode, replicate) * (1 + LEVELS.index(level) + 3 * MODES.index(mode))

    def vague(level: str, mode: str, replicate: int) -> float:
        return exact(level, mode, replicate) * (0.1 if replicate % len(LEVELS) == LEVELS.index(level) else 1.0)

    def sensed(level: str, mode: str, replicate: int) -> float:
        return float(exact(level, mode, replicate) ** sign)

    study = made(
        OWN + f'[[claim]]\nid = "c"\ntext = "c"\nkind = "predicts"\nmetric = "waiting_all"\n'
        f'less = "{less}"\nmore = "{more}"\n'
    )
    row = claims_of(study, runs_of(study, table(exact, vague, sensed), NONE)).iloc[0]
    assert (row["verdict"], row["n"]) == (verdict, 10)
