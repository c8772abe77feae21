"""The numbers of claims, fits and plans against SciPy and sums done by hand."""

import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats as scipy_stats

from deltaswarm_studies import plan as planning
from deltaswarm_studies.claims import claims_of, vacuous_claims
from deltaswarm_studies.contrasts import smallest_effects
from deltaswarm_studies.evidence import Evidence, fits_of, grids_of, recovery_of
from deltaswarm_studies.tables import ORIGIN, windows_with_levels
from tests.support.studying import FAST, OWN, SAME, SLOW, SWEEP, made, series, spread, table
from tests.support.tiers import in_one_test
from tests.support.verdicts import NOISE, ONE, TWO_CLAIMS, noisy, runs_with, walsh


def test_every_number_of_a_claims_row() -> None:
    """Of an order, in a family of one; then of a value with the source's own spread."""
    order = TWO_CLAIMS.format(
        "o", 'source = "s"\nsays = "more"\nless = "loss=0.0, hybrid 3"\nmore = "loss=0.9, hybrid 3"'
    )
    study = made(OWN + order + 'at_least = 1.1\nexpect = "undecided"\nwhy = "luck"\n')
    row = claims_of(study, runs_with(study, noisy)).iloc[0]
    averages = walsh(np.array(NOISE))
    p = scipy_stats.wilcoxon(np.array(NOISE) - math.log(1.1)).pvalue
    assert row[["claim", "text", "source", "says", "metric"]].tolist() == ["o", "t", "s", "more", "waiting_all"]
    assert (row["criterion"], row["scale"], row["n"], row["family"]) == ("at least 1.1 times", "ratio", 10, 1)
    assert (row["p"], row["p_holm"], row["confidence"]) == pytest.approx((p, p, 0.95))
    assert row["estimate"] == pytest.approx(math.exp(np.median(averages)))
    assert (row["low"], row["high"]) == pytest.approx((math.exp(averages[8]), math.exp(averages[-9])))
    assert row["effect"] == pytest.approx(1 - 4 * scipy_stats.wilcoxon(NOISE).statistic / 110)
    assert row[["verdict", "expect", "why"]].tolist() == ["undecided", "undecided", "luck"]

    value = TWO_CLAIMS.format(
        "v", 'kind = "value"\nof = "loss=0.0, hybrid 3"\nwithin = [20.0, 30.0]\niqr = 6.745\nn = 25'
    )
    study = made(OWN + value)
    row = claims_of(study, runs_with(study, noisy)).iloc[0]  # 20 to 29: median 24.5, by order statistics 21 to 28
    half = math.hypot(3.5, 1.959964 * 1.2533)
    assert (row["estimate"], row["low"], row["high"]) == pytest.approx((24.5, 24.5 - half, 24.5 + half))
    assert (row["criterion"], row["scale"], row["effect"]) == ("20 to 30", "", None)
    assert row["verdict"] == "holds"


@in_one_test(
    ("text", "criterion"),
    [
        (f'less = "{FAST}"\nmore = "{SLOW}"', "more"),
        (f'kind = "alike"\na = "{FAST}"\nb = "{SLOW}"\nmargin = 1.25', "within 1.25 times"),
        (f'kind = "value"\nof = "{FAST}"\nabove = 2.5', "above 2.5"),
        ('kind = "predicts"\nless = "messages"\nmore = "waiting"\nat_least = 2.0', "at least 2 times"),
    ],
)
def test_a_criterion_in_words(text: str, criterion: str) -> None:
    study = made(OWN + TWO_CLAIMS.format("c", text))
    assert claims_of(study, runs_with(study, spread))["criterion"].tolist() == [criterion]


@in_one_test(
    ("within", "verdict"),
    [("[21.0, 28.0]", "holds"), ("[21.1, 28.0]", "undecided"), ("[21.0, 27.9]", "undecided"),
     ("[28.1, 40.0]", "refuted"), ("[28.0, 40.0]", "undecided"), ("[1.0, 20.9]", "refuted"),
     ("[1.0, 21.0]", "undecided")],
)  # fmt: skip
def test_a_value_is_judged_by_where_its_interval_lies(within: str, verdict: str) -> None:
    """That of the ten values 20 to 29 is 21 to 28."""
    study = made(OWN + TWO_CLAIMS.format("v", f'kind = "value"\nof = "{SAME}"\nwithin = {within}'))
    assert claims_of(study, runs_with(study, noisy))["verdict"].tolist() == [verdict]


@in_one_test(
    ("within", "p"),
    [("[20.0, 29.0]", 2 / 1024), ("[21.0, 28.0]", 22 / 1024), ("[28.5, 40.0]", 22 / 1024), ("[24.4, 24.6]", 1.0)],
)
def test_the_p_of_a_value_is_that_of_the_widest_interval_that_decides(within: str, p: float) -> None:
    """The k-th order statistics of ten hold the median but for twice the binomial tail below k."""
    study = made(OWN + TWO_CLAIMS.format("v", f'kind = "value"\nof = "{SAME}"\nwithin = {within}'))
    runs = runs_with(study, noisy)
    assert claims_of(study, runs)["p"].tolist() == pytest.approx([p])
    none = claims_of(study, runs[runs["variant"] != SAME]).iloc[0]
    assert (none["verdict"], none["n"], none["p"]) == ("no data", 0, None)


@pytest.mark.parametrize(("at_least", "verdict"), [(1.0, "holds"), (2.0, "undecided"), (3.0, "refuted")])
def test_an_order_of_values_that_may_be_0_is_one_of_differences(at_least: float, verdict: str) -> None:
    """More than r times as much: more minus r times less is above 0."""
    study = made(OWN + TWO_CLAIMS.format("o", f'less = "{SAME}"\nmore = "loss=0.5, hybrid 3"\nat_least = {at_least}'))
    runs = runs_with(
        study, lambda level, _, r: 2.0 * r + (-1) ** r * 0.1 * (r + 1) if level == "loss=0.5" else float(r)
    )
    row = claims_of(study, runs).iloc[0]
    assert (row["scale"], row["verdict"]) == ("difference", verdict)
    assert row["about"] == f"loss=0.5, hybrid 3 over {f'{at_least:g} times ' * (at_least != 1)}{SAME}"
    differences = [2 * r + (-1) ** r * 0.1 * (r + 1) - at_least * r for r in range(10)]
    assert row["p"] == pytest.approx(scipy_stats.wilcoxon(differences, method="exact").pvalue, abs=1e-9)


@in_one_test(
    ("text", "is_vacuous"),
    [
        (f'kind = "value"\nof = "{FAST}"\nwithin = [10.0, 110.0]', False),  # ten times as wide as the runs differ
        (f'kind = "value"\nof = "{FAST}"\nwithin = [10.0, 110.1]', True),
        (f'kind = "value"\nof = "{FAST}"\nwithin = [-90.0, 20.0]', True),
        (f'kind = "value"\nof = "{FAST}"\nwithin = [10.1, 150.0]', False),
        (f'kind = "value"\nof = "{FAST}"\nwithin = [-150.0, 19.9]', False),
        (f'kind = "value"\nof = "{FAST}"\nabove = 1.0', False),
        (f'kind = "alike"\na = "{FAST}"\nb = "{SLOW}"\nmargin = 2.0', False),  # the widest ratio of two runs
        (f'kind = "alike"\na = "{FAST}"\nb = "{SLOW}"\nmargin = 2.1', True),
        (f'less = "{FAST}"\nmore = "{SLOW}"\nat_least = 0.5', False),
        (f'less = "{FAST}"\nmore = "{SLOW}"\nat_least = 0.49', True),
    ],
)
def test_a_claim_is_vacuous_from_ten_times_the_range_on(text: str, is_vacuous: bool) -> None:
    """All runs lie between 10 and 20."""
    study = made(OWN + TWO_CLAIMS.format("c", text))
    runs = runs_with(study, lambda level, mode, r: 10.0 + r + (1 if level == "loss=0.9" else 0))
    expected = ["the claim 'c' is vacuous: no run of any variant could contradict it"] if is_vacuous else []
    assert vacuous_claims(study, runs) == expected


def test_predictors_are_compared_by_spearmans_correlation_of_each_replicate() -> None:

    def outcome(level: str, mode: str, replicate: int) -> float:
        return (1.0 + float(level[-1]) + (mode == "hybrid 3") * 0.3) * (10 + replicate)

    def vague(level: str, mode: str, replicate: int) -> float:
        return outcome(level, mode, replicate) * (1 + 0.9 * ((replicate * 7 + len(mode) + int(level[-1]) * 3) % 4))

    text = 'kind = "predicts"\nless = "messages"\nmore = "waiting"'
    study = made(OWN + TWO_CLAIMS.format("p", text))
    runs = runs_with(study, outcome, messages=vague)
    row = claims_of(study, runs).iloc[0]
    by_replicate = [group for _, group in runs.groupby("replicate")]
    better, worse = (
        [abs(scipy_stats.spearmanr(group[name], group["waiting_all"]).statistic) for group in by_replicate]
        for name in ("waiting", "messages")
    )
    differences = np.array(better) - np.array(worse)
    assert row["n"] == 10
    if min(worse) > 0:
        assert row["estimate"] == pytest.approx(math.exp(np.median(walsh(np.log(better) - np.log(worse)))))
    else:
        assert row["estimate"] == pytest.approx(np.median(walsh(differences)))
    assert row["verdict"] == "holds"


# Evidence


def test_a_fits_numbers_by_hand() -> None:
    """Medians 24.5 and 12.25 against 20 and 12, in units of 3 and 0.5: 1.5 and 0.5, so 2.5 in all."""
    fit = (
        '[[fit]]\ntext = "f"\nfactor = "mode"\ntargets = [\n'
        '{ level = "hybrid 3", metric = "waiting_all", says = 20.0, iqr = 3.0 },\n'
        '{ level = "decentralised", metric = "messages", says = 12.0, iqr = 0.5 },\n]\n'
    )
    study = made(OWN + fit)
    runs = runs_with(study, lambda level, _, r: 20.0 + r + 100 * (level != "loss=0.5"), messages=lambda *_: 12.25)
    found = fits_of(study, runs)
    assert found["within"].tolist() == ["loss=0.5"] * 2 + ["loss=0.0"] * 2 + ["loss=0.9"] * 2
    first = found.iloc[:2]
    assert first[["fit", "level", "metric"]].to_numpy().tolist() == [
        ["f", "hybrid 3", "waiting_all"],
        ["f", "decentralised", "messages"],
    ]
    assert first["distance"].tolist() == pytest.approx([1.5, 0.5])
    assert first["sum"].tolist() == pytest.approx([2.5, 2.5])
    assert first["without"].tolist() == pytest.approx([0.25, 2.25])  # without waiting, without messages
    assert found["closest"].tolist() == [1, 1, 0, 0, 0, 0]
    assert found["verdict"].tolist() == ["closest"] * 2 + ["farther"] * 4


def test_a_grids_numbers_by_hand() -> None:
    grid = '[[grid]]\ntext = "g"\nmetric = "waiting_all"\nrows = "loss"\nfactor = "mode"\n'
    study = made(OWN + grid + 'columns = { best = ["hybrid 3", "decentralised"] }\n')
    runs = runs_with(study, lambda level, mode, r: 20.0 + r + (5 if (level, mode) == ("loss=0.0", "hybrid 3") else 0))
    found = grids_of(study, runs[(runs["loss"] != "loss=0.9") | (runs["mode"] == "hybrid 3")])
    assert found.drop(columns="mcse").to_dict("records") == [
        {"grid": "g", "metric": "waiting_all", "row": row, "column": "best", "level": level, "n": 10, "median": 24.5,
         "low": 21.0, "high": 28.0}
        for row, level in (("loss=0.0", "decentralised"), ("loss=0.5", "decentralised"), ("loss=0.9", "hybrid 3"))
    ]  # fmt: skip


def test_the_mean_in_a_window_weighs_events_not_runs() -> None:
    """A replicate with 90 events at 30 s and one with 10 at 20 s wait 29 s, which is 1.45 times 20: not back."""
    own = '[[recovery]]\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\nafter_s = 0.0\nwindows = 1\n'
    told = series(lambda level, mode, replicate, time_s: 30.0 if level == "loss=0.5" and replicate % 2 else 20.0)
    told.loc[told["variant"].str.startswith("loss=0.5"), "events_followed"] = told["replicate"].map(
        lambda replicate: 9.0 if replicate % 2 else 1.0
    )
    for tolerance, back_s in ((1.44, math.inf), (1.46, 100.0)):
        study = made(OWN + own + f"tolerance = {tolerance}\n")
        found = recovery_of(study, windows_with_levels(study, told))
        assert found["back_s"].tolist() == [back_s] * 2
        assert found[["metric", "level", "reference", "within"]].iloc[0].tolist() == [
            "waiting_all", "loss=0.5", "loss=0.0", "decentralised",
        ]  # fmt: skip


def test_labels_that_look_like_numbers_and_truths_stay_texts_in_saved_tables(tmp_path: Path) -> None:
    own = OWN + (
        '[[contrast]]\nid = "modes"\nfactor = "mode"\nreference = "007"\n'
        '[[recovery]]\nfactor = "mode"\nlevel = "true"\nreference = "007"\nafter_s = 0.0\n'
        '[[figure]]\nname = "f"\nkind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n'
    )
    study = made(own, SWEEP.replace('label = ["decentralised", "hybrid 3"]', 'label = ["007", "true"]'))
    renamed = {"variant": {"decentralised": "007", "hybrid 3": "true"}}
    rows, courses = table(lambda level, mode, r: 20.0 + r), series(lambda *_: 20.0)
    found = Evidence.of_sweep(study, rows.replace(renamed, regex=True), courses.replace(renamed, regex=True))
    found.save(tmp_path)
    again = Evidence.of_folder(study, tmp_path)
    for name in ("runs", "courses", "recovery", "estimates", "contrasts"):
        was, now = (getattr(side, name).drop(columns=[*ORIGIN], errors="ignore") for side in (found, again))
        pd.testing.assert_frame_equal(was, now, check_dtype=False)
    assert again.recovery["level"].tolist() == ["true"] * 3
    assert again.runs["mode"].unique().tolist() == ["007", "true"]


# Plans


def test_a_plan_in_words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    claims = "".join(
        TWO_CLAIMS.format(name, f'{source}less = "{SAME}"\nmore = "{SLOW}"')
        for name, source in (("a", 'source = "Kelly"\n'), ("b", 'source = "Kelly"\n'), ("c", ""))
    )
    study = made(OWN + ONE + claims, SWEEP.replace("repeats = 10", "repeats = 6"))
    monkeypatch.setattr(planning, "_run_s", lambda scenario: 2.0)
    planned = planning.plan(study, tmp_path, 4)
    assert planning.wall_s(study) == 2.0 * 6 * 6
    assert planned["wall_s"] == 18.0
    assert [planned[name] for name in ("study", "variants", "repeats", "workers")] == ["made-up", 6, 6, 4]
    first, *rest = planned["families"]
    assert first == {
        "name": "contrast 'c', waiting_all", "tests": 2, "smallest_p": 0.0625, "repeats": 6,
        "repeats_needed": 7, "shows": None,
    }  # fmt: skip
    assert [(family["name"], family["tests"]) for family in rest] == [("claims of 'Kelly'", 2), ("claims", 1)]
    assert planning.too_few(study) == [
        "made-up: 2 of 3 families of tests can show nothing with 6 replicates; 7 are needed (`deltaswarm study "
        "--plan` lists the families)"
    ]
    assert planning.too_few(made(OWN + ONE)) == []
    predicts = '[[claim]]\nid = "p"\ntext = "p"\nkind = "predicts"\nmetric = "waiting_all"\n'
    over_all = made(
        OWN + predicts + 'less = "messages"\nmore = "waiting"\n', SWEEP.replace("repeats = 10", "repeats = 3")
    )
    assert "with 3 replicates" in planning.too_few(over_all)[0]
    lines = planning.text(planned).splitlines()
    assert lines[1] == "  about 0:00:18 on 4 cores, by the speed of the first steps of each variant"
    two = "2 tests in a family, smallest corrected p 0.062: can show nothing, 7 replicates are needed"
    assert lines[3:] == [
        f"  contrast 'c', waiting_all: {two}",
        f"  claims of 'Kelly': {two}",
        "  claims: 1 tests in a family, smallest corrected p 0.031",
        f"  no {tmp_path}/runs.csv: with a pilot (--pilot FOLDER) also the smallest effects that could be shown are "
        "told",
    ]
    assert planning.plan(made(OWN), tmp_path, 1)["note"] is None
    single = planning.plan(made(OWN + ONE, SWEEP.replace("repeats = 10", "repeats = 1")), tmp_path, 4)
    assert single["families"][0]["smallest_p"] == 1.0


def test_a_plan_needs_no_pandas(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It says what is missing for the effects of a pilot; with it, each line ends with the effect."""
    study = made(OWN + ONE)
    runs_with(study, noisy).to_csv(tmp_path / "runs.csv", index=False)
    monkeypatch.setattr(planning, "_run_s", lambda scenario: 2.0)
    [effect] = smallest_effects(study, tmp_path / "runs.csv").values()
    assert (
        planning.text(planning.plan(study, tmp_path, 4))
        .splitlines()[3]
        .endswith(f"smallest corrected p 0.0039; shows {effect} with a probability of 80 %")
    )
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "deltaswarm_studies.contrasts", None)
        with pytest.raises(ModuleNotFoundError):
            planning.plan(study, tmp_path, 4)
        patched.delitem(sys.modules, "deltaswarm_studies.contrasts")
        patched.setitem(sys.modules, "pandas", None)
        note = planning.plan(study, tmp_path, 4)["note"]
    assert note == "to tell the smallest effects that could be shown needs pandas: pip install 'deltaswarm[study]'"


def test_a_plan_measures_at_most_24_variants(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every second of 48, every third of 49 to 72; their mean stands for all."""
    measured: list[float] = []
    monkeypatch.setattr(planning, "_run_s", lambda scenario: measured.append(scenario.radio.loss) or 1.0)  # type: ignore[func-returns-value]
    for count, expected in ((24, 24), (25, 13), (48, 24), (49, 17)):
        losses = str([index / 100 for index in range(count)])
        one = SWEEP.partition("[[sweep.paired]]")[0].replace("[0.0, 0.5, 0.9]", losses)
        study = made(OWN.replace(', mode = "control"', ""), one)
        measured.clear()
        assert planning.wall_s(study) == count * 10
        assert len(measured) == expected
        assert measured[1] == pytest.approx(math.ceil(count / 24) / 100)


def test_a_plan_says_which_engine_does_the_runs() -> None:
    """The dense one where it covers them; and why not the others."""
    sweep = SWEEP.replace("1000.0", "4000.0").replace("radio.loss", "downlink.jitter_s")
    assert planning.engines_of(made(OWN.replace("loss =", "jitter_s ="), sweep)) == {
        "dense": 20,
        "python": 40,
        "because": ["downlink.jitter_s = 0.5", "downlink.jitter_s = 0.9"],
    }


def test_the_time_of_a_run_is_that_of_its_first_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.1 s a step, measured for 0.4 s, of 1000 steps: 100 s."""
    clock = itertools.count(7.0, 0.05)
    monkeypatch.setattr(planning.time, "monotonic", lambda: next(clock))
    scenario = made().sweep.variants[0].scenario
    assert scenario.run.steps == 1000
    assert planning._run_s(scenario) == pytest.approx(0.05 * 10 / 9 * 1000)
