"""Comparisons that are averaged over the levels of a factor, with several rivals, or with the best of them."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats as scipy_stats

from deltaswarm_studies.claims import claims_of
from deltaswarm_studies.contrasts import contrasts_of
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.page import pages
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import made

CELLS = ("a", "b", "c", "d", "e", "f")
SWEEP = """
schema = 1
name = "made-up"
base = "smoke"

[scenario]
run.duration_s = 1000.0
metrics.horizon_s = 100.0

[sweep]
repeats = 20

[[sweep.paired]]
label = ["a", "b", "c", "d", "e", "f"]
events.rate_hz = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06]

[[sweep.paired]]
label = ["new", "two", "three", "four"]
control.delta = [5, 2, 3, 4]
"""
OWN = """
[study]
factors = { cell = "task", mode = "control" }
metrics = ["messages"]
"""

LOGS = {
    "two": (0.1, 0.3, 0.2, 0.25, 0.15, 0.35),
    "three": (0.4, -0.1, 0.2, 0.3, 0.0, 0.1),
    "four": (0.5, 0.6, 0.4, 0.5, 0.7, 0.5),
}
"""By cell, how much more rivals send than `new` does, as the logarithm of the ratio of the means."""


def value(cell: str, mode: str, replicate: int) -> float:
    """The ratios are those of the means; `three` is above its own in odd replicates and below it in even ones."""
    arrivals = 1.0 + 0.1 * (replicate % 5)
    ratio = math.exp(LOGS[mode][CELLS.index(cell)]) if mode != "new" else 1.0
    return 3.0 * arrivals * ratio * (1.0 if mode != "three" else 1.3 if replicate % 2 else 0.7)


def runs(study: Study) -> pd.DataFrame:
    rows = [
        {**levels, "variant": label, "replicate": replicate, "seed": 100 + replicate}
        | {"messages": value(levels["cell"], levels["mode"], replicate)}
        for label, levels in study.levels.items()
        for replicate in range(20)
    ]
    return pd.DataFrame(rows)


def claim(text: str) -> pd.Series:
    study = made(OWN + f'[[claim]]\nid = "c"\ntext = "c"\nmetric = "messages"\nless = "new"\n{text}', SWEEP)
    return claims_of(study, runs(study)).iloc[0]


def t_of(logs: tuple[float, ...]) -> tuple[float, float, float, float]:
    """The p-value of SciPy's t-test, the mean ratio and its interval."""
    found = scipy_stats.ttest_1samp(logs, 0.0)
    low, high = found.confidence_interval(0.95)
    return found.pvalue, math.exp(np.mean(logs)), math.exp(low), math.exp(high)


def test_a_mean_over_cells_is_that_of_their_log_ratios() -> None:
    """With Student's interval over the six cells; each cell counts once, whatever its messages."""
    row = claim('more = "two"\nover = "cell"')
    assert [row[name] for name in ("p", "estimate", "low", "high")] == pytest.approx(t_of(LOGS["two"]))
    assert (row["n"], row["verdict"], row["criterion"]) == (6, "holds", "more, mean over task")
    some = claim('more = "two"\nover = "cell"\ncells = ["a", "c", "f"]')
    assert some["estimate"] == pytest.approx(math.exp((0.1 + 0.2 + 0.35) / 3))


def test_a_claim_against_each_rival_is_that_against_the_closest() -> None:
    """Intersection-union: it is undecided since it is against `three`, though it holds against both others."""
    row = claim('every = ["two", "three", "four"]\nover = "cell"')
    assert row["about"] == "three over new"
    assert row["p"] == pytest.approx(t_of(LOGS["three"])[0], rel=1e-6)
    assert row["verdict"] == "undecided"
    clear = claim('every = ["two", "four"]\nover = "cell"')
    assert (clear["about"], clear["verdict"]) == ("two over new", "holds")
    assert clear["p"] == pytest.approx(t_of(LOGS["two"])[0])


def test_one_rival_refutes_a_claim_against_each_at_its_share_of_the_level() -> None:
    """At least 1.5 times as much: `two` sends less than that, by a p-value that counts twice."""
    row = claim('every = ["two", "four"]\nat_least = 1.5\nover = "cell"')
    one_sided = scipy_stats.ttest_1samp(LOGS["two"], math.log(1.5), alternative="less").pvalue
    assert (row["about"], row["verdict"]) == ("two over new", "refuted")
    assert row["p"] == pytest.approx(2 * 2 * one_sided)


def test_the_best_is_chosen_in_odd_replicates_and_compared_in_even_ones() -> None:
    """In odd ones of cell f, `two` is best, by 1.42 to 1.44; that `three` is far better in even ones does not count."""
    text = '[[claim]]\nid = "c"\ntext = "c"\nmetric = "messages"\nless = "{0}, new"\n'
    text += 'best_of = ["{0}, two", "{0}, three", "{0}, four"]\n'
    found = {}
    for cell in ("b", "f"):
        study = made(OWN + text.format(cell), SWEEP)
        found[cell] = claims_of(study, runs(study)).iloc[0]
    assert found["b"]["estimate"] == pytest.approx(0.7 * math.exp(-0.1))
    assert found["f"]["estimate"] == pytest.approx(math.exp(0.35))
    assert (found["b"]["n"], found["b"]["verdict"], found["f"]["verdict"]) == (10, "refuted", "holds")
    assert found["b"]["about"] == "the best of 3 over b, new"


def test_the_best_of_each_cell_over_all() -> None:
    """`three` is chosen in b, where it is best in odd replicates, `two` in the others."""
    row = claim('best_of = ["two", "three", "four"]\nover = "cell"')
    chosen = ["two", "three", "two", "two", "two", "two"]
    logs = [LOGS[mode][at] + (math.log(0.7) if mode == "three" else 0.0) for at, mode in enumerate(chosen)]
    assert row["estimate"] == pytest.approx(math.exp(np.mean(logs)))
    assert row["n"] == 6


CONTRAST = '[[contrast]]\nid = "all"\nfactor = "mode"\nreference = "new"\nover = "cell"\nmargin = 1.5\n'


def test_a_contrast_over_cells_has_a_row_for_each_level() -> None:
    study = made(OWN + CONTRAST, SWEEP)
    found = contrasts_of(study, runs(study)).set_index("level")
    assert list(found.index) == ["two", "three", "four"]
    p = {mode: t_of(logs)[0] for mode, logs in LOGS.items()}
    assert [found.loc[mode, "p"] for mode in LOGS] == pytest.approx([p[mode] for mode in LOGS], rel=1e-6)
    assert found.loc["four", "p_holm"] == pytest.approx(3 * p["four"])
    assert found["verdict"].tolist() == ["slightly higher", "alike", "higher"]
    assert found.loc["two", "within"] == "mean over task"
    assert found.loc["two", "mcse"] == pytest.approx(
        found.loc["two", "estimate"] * np.std(LOGS["two"], ddof=0) / math.sqrt(6), rel=0.1
    )


def test_a_replicate_counts_only_where_both_sides_have_it() -> None:
    """Of cell a, `two` has only the first replicate; messages of `new` in the others do not count."""
    study = made(
        OWN + '[[claim]]\nid = "c"\ntext = "c"\nmetric = "messages"\nless = "new"\nmore = "two"\nover = "cell"', SWEEP
    )
    rows = runs(study)
    lost = rows[~((rows["variant"] == "a, two") & (rows["replicate"] > 0))]
    assert claims_of(study, lost).iloc[0]["estimate"] == pytest.approx(math.exp(np.mean(LOGS["two"])))


FINDING = """
[[claim]]
id = "each"
text = "It sends less than each"
metric = "messages"
less = "new"
every = ["two", "four"]
over = "cell"
cells = ["a", "b", "c"]

[[claim]]
id = "best"
text = "And hardly more than the best"
metric = "messages"
less = "f, new"
best_of = ["f, two", "f, three"]
at_least = 0.95

[[finding]]
heading = "Found"
results = [{ claim = "each" }, { claim = "best" }, { contrast = "all" }]
"""


def test_a_page_tells_what_was_averaged_and_chosen() -> None:
    study = made(OWN + CONTRAST + FINDING, SWEEP)
    evidence = Evidence(study, runs(study), pd.DataFrame(), pd.DataFrame())
    markdown = pages(study, evidence, pd.DataFrame({"what": [], "value": []}))[1]
    for text in (
        "on average over task",
        "with the best of 2 as with new, with f (",
        "each of 2, mean over task",
        "a, b, c; without d, e, f",
    ):
        assert text in markdown, text


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('less = "new"\nmore = "two"\nover = "place"', r"claim\[0\].over"),
        ('less = "new"\nmore = "two"\nover = "cell"\ncells = ["z"]', r"claim\[0\].cells"),
        ('less = "a, new"\nmore = "two"\nover = "cell"', "a, new"),
        ('less = "new"\nmore = "two"\nevery = ["four"]\nover = "cell"', "more"),
        ('less = "new"\nmore = "new"\nover = "cell"', "more"),
        ('less = "a, new"\nmore = "a, two"\ncells = ["a"]', "over"),
        ('kind = "alike"\na = "a, new"\nb = "a, two"\nmargin = 1.1\nover = "cell"', "over"),
    ],
)
def test_mistakes_are_refused(text: str, where: str) -> None:
    with pytest.raises(SettingsError, match=where):
        made(OWN + f'[[claim]]\nid = "c"\ntext = "c"\nmetric = "messages"\n{text}', SWEEP)
