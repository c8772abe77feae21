"""From made-up runs to estimates, contrasts, verdicts and findings: what must come out is known."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from deltaswarm_studies.claims import claims_of, findings_of
from deltaswarm_studies.contrasts import contrasts_of, disagreements
from deltaswarm_studies.evidence import Evidence, fits_of, grids_of, recovery_of, too_few
from deltaswarm_studies.tables import (
    courses_of,
    estimates_of,
    invalid_of,
    missing_metrics,
    missing_runs,
    runs_of,
    same_arrivals,
    windows_with_levels,
)
from tests.support.studying import FAST, LIMIT, OWN, SAME, SLOW, SWEEP, made, series, spread, table, worse_at_90
from tests.support.tiers import in_one_test

NONE = pd.DataFrame()


def test_estimates_are_medians_by_variant() -> None:
    """With the level of each factor."""
    study = made()
    found = estimates_of(study, runs_of(study, table(worse_at_90), NONE))
    rows = found[found["metric"] == "waiting_all"].set_index("variant")
    assert rows.loc["loss=0.9, hybrid 3", "median"] == pytest.approx(2 * rows.loc["loss=0.5, hybrid 3", "median"])
    assert set(rows["loss"]) == {"loss=0.0", "loss=0.5", "loss=0.9"}
    assert (rows["n"] == 10).all()


def test_a_contrast_compares_levels_within_each_cell() -> None:
    """One family for each metric, and each verdict from its corrected p."""
    study = made(OWN + LIMIT)
    found = contrasts_of(study, runs_of(study, table(worse_at_90), NONE))
    waiting = found[found["metric"] == "waiting_all"].set_index(["level", "within"])
    assert waiting["verdict"].to_dict() == {
        ("loss=0.5", "decentralised"): "alike",
        ("loss=0.5", "hybrid 3"): "alike",
        ("loss=0.9", "decentralised"): "alike",
        ("loss=0.9", "hybrid 3"): "higher",
    }
    assert waiting.loc[("loss=0.9", "hybrid 3"), "estimate"] == pytest.approx(2)
    assert (waiting["family"] == 4).all()
    assert waiting.loc[("loss=0.9", "hybrid 3"), "p_holm"] == pytest.approx(4 * 2 / 2**10)


@in_one_test(("replicates", "is_told"), [(0, False), (1, True), (7, True), (8, False)])
def test_too_few_replicates_are_told(replicates: int, is_told: bool) -> None:
    """From one on, up to those that could show something of four comparisons; none at all are told elsewhere."""
    study = made(OWN + LIMIT)
    runs = runs_of(study, table(worse_at_90), NONE)
    found = contrasts_of(study, runs[runs["replicate"] < replicates])
    assert bool(too_few(found)) == is_told
    assert too_few(pd.DataFrame()) == []


def test_an_interaction_compares_changes() -> None:
    """Whether loss changes one mode more than the other."""
    own = LIMIT.replace("margin = 1.1\n", 'across = "mode"\nacross_pairs = [["hybrid 3", "decentralised"]]\n')
    study = made(OWN + own)
    found = contrasts_of(study, runs_of(study, table(worse_at_90), NONE))
    waiting = found[found["metric"] == "waiting_all"].set_index("level")
    assert waiting.loc["loss=0.9", "verdict"] == "higher"
    assert waiting.loc["loss=0.9", "estimate"] == pytest.approx(2)
    assert waiting.loc["loss=0.5", "verdict"] == "unclear"


def test_an_interaction_is_on_one_scale() -> None:
    """A missing value in one of the four cells costs that replicate, not the ratio; a 0 makes all rows differences."""
    own = LIMIT.replace("margin = 1.1\n", 'across = "mode"\nacross_pairs = [["hybrid 3", "decentralised"]]\n')
    study = made(OWN + own)
    whole = runs_of(study, table(worse_at_90), NONE)
    holed = whole.copy()
    is_one = (holed["variant"] == "loss=0.0, decentralised") & (holed["replicate"] == 3)
    holed.loc[is_one, "waiting_all"] = math.nan
    found = contrasts_of(study, holed).set_index(["metric", "level"])
    row = found.loc[("waiting_all", "loss=0.9")]
    assert (row["scale"], row["n"], row["missing"], row["verdict"]) == ("ratio", 9, 1, "higher")
    assert row["estimate"] == pytest.approx(2)
    holed.loc[is_one, "waiting_all"] = 0.0
    found = contrasts_of(study, holed).set_index(["metric", "level"])
    assert set(found.loc["waiting_all"]["scale"]) == {"difference"}
    assert set(found.loc["messages"]["scale"]) == {"ratio"}


def test_a_small_but_certain_difference_is_called_slight() -> None:
    """Alike says that none was found; within the margin it is named all the same."""
    study = made(OWN + LIMIT)

    def value(level: str, mode: str, replicate: int) -> float:
        return spread(level, mode, replicate) * (1.02 if level == "loss=0.5" else 0.97 if level == "loss=0.9" else 1)

    found = contrasts_of(study, runs_of(study, table(value), NONE))
    verdicts = found[found["metric"] == "waiting_all"].set_index("level")["verdict"]
    assert set(verdicts["loss=0.5"]) == {"slightly higher"}
    assert set(verdicts["loss=0.9"]) == {"slightly lower"}


def test_what_has_no_value_has_no_verdict() -> None:
    """A variant that was not run, a metric that the table lacks: no data, which is not undecided."""
    text = "".join(
        f'[[claim]]\nid = "{metric}{more[-1]}"\ntext = "c"\nmetric = "{metric}"\nless = "{SAME}"\nmore = "{more}"\n'
        for metric in ("waiting_all", "trees")
        for more in (SLOW, FAST)
    )
    study = made(OWN + LIMIT + text)
    runs = runs_of(made(OWN), table(worse_at_90), NONE)
    part = runs[(runs["variant"] != SLOW) & ~((runs["variant"] == FAST) & (runs["replicate"] > 6))]
    verdicts = claims_of(study, part).set_index("claim")["verdict"]
    assert verdicts.tolist() == ["no data", "undecided", "no data", "no data"]
    contrasts = contrasts_of(study, part).set_index(["metric", "level", "within"])
    assert contrasts.loc[("waiting_all", "loss=0.9", "hybrid 3"), "verdict"] == "no data"
    assert contrasts.loc[("waiting_all", "loss=0.9", "decentralised"), "n"] == 7
    assert missing_metrics(study, part) == ["The table of runs has no columns trees."]
    nothing = invalid_of(runs, [])
    assert missing_runs(study, part, nothing) == [
        f"13 of 60 runs are missing: {FAST} (replicates 7 to 9); {SLOW} (replicates 0 to 9)."
    ]
    assert missing_runs(study, runs, nothing) == []


def test_whether_compared_runs_saw_the_same_arrivals_is_said() -> None:
    """Times and places each, over the pairs that are compared; what was not recorded is not claimed."""
    study = made(OWN + LIMIT)
    runs = runs_of(study, table(), NONE)
    assert all("not recorded" in clause for clause in same_arrivals(study, runs))
    same = runs.assign(arrival_times="t" + runs["replicate"].astype(str), arrival_places="p")
    same.loc[same["variant"] == "loss=0.5, hybrid 3", "arrival_places"] = "q"
    times, places = same_arrivals(study, same)
    assert "in 40 of 40 pairs" in times
    assert "in 30 of 40 pairs" in places


def test_evidence_is_the_same_from_its_saved_tables(tmp_path: Path) -> None:
    """Rows of variants that the study no longer has are left out; a digest that is empty was not recorded."""
    study = made(OWN + LIMIT)
    runs = table(worse_at_90).assign(**{"arrivals.times": [f"t{row}" for row in range(60)], "arrivals.places": ""})
    more = runs.head(1).assign(variant="loss=0.7, hybrid 3")
    Evidence.of_sweep(study, runs, NONE).save(tmp_path)
    saved = pd.read_csv(tmp_path / "runs.csv")
    pd.concat([more[["variant", "replicate", "seed"]], saved]).to_csv(tmp_path / "runs.csv", index=False)
    found = Evidence.of_folder(study, tmp_path)
    assert (len(found.runs), found.runs.index[0], found.incomplete) == (60, 0, [])
    assert found.runs["digest"].isna().all()
    times, places = found.arrivals
    assert "in 0 of 40 pairs" in times
    assert "not recorded" in places
    pd.testing.assert_frame_equal(found.contrasts, contrasts_of(study, runs_of(study, runs, NONE)))
    saved.assign(variant="gone").to_csv(tmp_path / "runs.csv", index=False)
    with pytest.raises(ValueError, match=r"/runs\.csv must have runs of the study's variants, such as 'loss=0\.0, dec"):
        Evidence.of_folder(study, tmp_path)


def test_a_finding_that_is_no_longer_carried_is_named() -> None:
    """By the result that fails it; one that is carried is not."""
    own = OWN + LIMIT + (
        '[[finding]]\ntext = "carried"\nbecause = [{ contrast = "limit", metric = "waiting_all", level = "loss=0.9", '
        'within = "hybrid 3", is = "higher" }]\n'
        '[[finding]]\ntext = "not carried"\nbecause = [{ contrast = "limit", metric = "waiting_all", '
        'level = "loss=0.5", within = "hybrid 3", is = "higher" }]\n'
        '[[finding]]\ntext = "either"\nbecause = [{ contrast = "limit", metric = "waiting_all", '
        'level = ["loss=0.5", "loss=0.9"], within = "hybrid 3", is = ["alike", "higher"] }]\n'
        '[[finding]]\ntext = "one of two"\nbecause = [{ contrast = "limit", metric = "waiting_all", '
        'level = ["loss=0.5", "loss=0.9"], within = "hybrid 3", is = "higher" }]\n'
    )  # fmt: skip
    study = made(own)
    runs = runs_of(study, table(worse_at_90), NONE)
    results = {"claim": claims_of(study, runs), "contrast": contrasts_of(study, runs)}
    found = findings_of(study, results).set_index("text")["broken"]
    assert found["carried"] == found["either"] == ""
    assert "alike" in found["not carried"]
    assert "alike" in found["one of two"]


def test_a_ranking_that_turns_with_the_events_never_sensed_is_told() -> None:
    """A swarm that never finds the difficult events looks fast by those it did find."""

    def sensed(level: str, mode: str, replicate: int) -> float:
        return spread(level, mode, replicate) * (0.5 if level == "loss=0.9" else 1)

    study = made(OWN + LIMIT)
    assert not disagreements(study, runs_of(study, table(worse_at_90), NONE))
    told = disagreements(study, runs_of(study, table(worse_at_90, sensed=sensed), NONE))
    assert [line.split(" against")[0] for line in told] == ["loss=0.9"]
    assert "hybrid 3" in told[0]


def test_a_metric_may_be_taken_over_a_stretch_of_time() -> None:
    """Waiting by event, messages per second; events of other times do not count."""
    study = made(OWN.replace("window_s", "from_s = 500.0\nuntil_s = 700.0\nwindow_s"))
    waits = series(lambda level, mode, replicate, time_s: time_s)
    runs = runs_of(study, table(), waits)
    assert (runs["waiting_all"] == 550).all()
    assert (runs["messages"] == 4.0).all()


def test_numbers_per_step_are_told_per_second() -> None:
    """By the step of each variant, where steps differ; windows are counted in whole numbers, however they round."""
    steps = SWEEP.replace("[sweep.axes]\nradio.loss = [0.0, 0.5, 0.9]", "[sweep.axes]\nrun.step_s = [0.5, 1.0, 2.0]")
    own = OWN.replace("loss =", "step =").replace("window_s", "from_s = 500.0\nwindow_s")
    study = made(own.replace("waiting_all", "trees"), steps)
    waits = series(lambda *_: 20.0).assign(trees=1.0)
    waits["variant"] = waits["variant"].replace(
        {
            f"loss={loss}, {mode}": f"step_s={step}, {mode}"
            for loss, step in (("0.0", "0.5"), ("0.5", "1.0"), ("0.9", "2.0"))
            for mode in ("decentralised", "hybrid 3")
        }
    )
    runs = runs_of(study, waits.drop_duplicates(["variant", "replicate"])[["variant", "replicate", "seed"]], waits)
    assert runs.groupby("step")["messages"].unique().to_dict() == {
        "step_s=0.5": [8.0],
        "step_s=1.0": [4.0],
        "step_s=2.0": [2.0],
    }


def test_runs_shorter_than_a_window_have_no_windows() -> None:
    """Their table is empty, and whatever is drawn from it too."""
    study = made(OWN.replace("window_s = 100.0", "window_s = 2000.0"))
    windows = windows_with_levels(study, series(lambda *_: 20.0))
    assert windows.empty
    assert {"variant", "time_s", "loss"} <= {*windows}


def test_the_time_to_converge_is_read_off_the_running_mean() -> None:
    """Agents in trees grow to 12 at 600 s, and 90 % of it is at 540 s."""
    own = OWN.replace('"messages"]', '"converged"]')
    own += '[[metric]]\nname = "converged"\nkind = "time_to_converge"\nof = "agents_in_trees"\nsmooth_s = 100.0\n'
    study = made(own)
    runs = runs_of(study, table(), series(lambda *_: 20.0))
    assert (runs["converged"] == 600).all()


@pytest.mark.parametrize("after_s", [300.0, 350.0])
def test_recovery_is_when_windows_are_again_like_those_without_the_fault(after_s: float) -> None:
    """Waiting doubles from 200 to 500 s: back at 600 s, wherever a window begins; a swarm that stays slow is not."""
    own = OWN + "".join(
        f'[[recovery]]\nmetric = "waiting_all"\nfactor = "loss"\nlevel = "{level}"\nreference = "loss=0.0"\n'
        f"after_s = {after_s}\n"
        for level in ("loss=0.5", "loss=0.9")
    )

    def waiting(level: str, mode: str, replicate: int, time_s: float) -> float:
        is_slow = level == "loss=0.9" or (level == "loss=0.5" and 200 <= time_s < 500)
        return 20.0 * (2 if is_slow else 1) * 1.05**replicate

    study = made(own)
    found = recovery_of(study, windows_with_levels(study, series(waiting)))
    assert found.set_index(["level", "within"])["back_s"].to_dict() == {
        ("loss=0.5", "decentralised"): 600.0 - after_s,
        ("loss=0.5", "hybrid 3"): 600.0 - after_s,
        ("loss=0.9", "decentralised"): math.inf,
        ("loss=0.9", "hybrid 3"): math.inf,
    }


@in_one_test(
    ("loads", "back_s"),
    [
        ([4, 4, 4, 4, 4, 4], 100.0),
        ([9, 9, 4, 4, 4, 4], 300.0),
        ([1, 1, 1, 4, 4, 4], 400.0),
        ([1, 4, 1, 4, 9, 4], math.inf),
        ([5, 5, 5.1, 4, 4, 4], 100.0),
        ([4.9, 3.3, 5.1, 4, 4, 4], 100.0),
        ([5.1, 3.1, 4.9, 3.3, 4, 4], 300.0),
    ],
)
def test_a_swarm_that_says_too_little_is_not_back(loads: list[float], back_s: float) -> None:
    """Neither more nor less than 1.25 times as much, in as many windows in a row as asked for, is like the other."""
    study = made(
        OWN + '[[recovery]]\nmetric = "messages"\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\n'
        "after_s = 400.0\nwindows = 2\n"
    )
    told = series(lambda *_: 20.0)
    is_late = (told["variant"].str.startswith("loss=0.5")) & (told["time_s"] >= 400)
    by_time = dict(zip(range(400, 1000, 100), loads, strict=True))
    told.loc[is_late, "operator_messages"] = told.loc[is_late, "time_s"].astype(int).map(by_time)
    found = recovery_of(study, windows_with_levels(study, told))
    assert found["back_s"].tolist() == [back_s] * 2
    assert found["n"].tolist() == [10] * 2
    assert (found["low_s"] == found["back_s"]).all()
    assert (found["high_s"] == found["back_s"]).all()


@in_one_test(("fault", "reference", "back_s"), [(0, 0, 100.0), (0, 4, math.inf), (4, 0, math.inf), (1, 1, 100.0)])
def test_nothing_is_like_nothing_and_unlike_something(fault: float, reference: float, back_s: float) -> None:
    """Messages per step of the swarms with a fault and without it."""
    study = made(
        OWN + '[[recovery]]\nmetric = "messages"\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\n'
        "after_s = 400.0\nwindows = 3\n"
    )
    told = series(lambda *_: 20.0)
    told["operator_messages"] = told["variant"].str.startswith("loss=0.5").map({True: fault, False: reference})
    assert recovery_of(study, windows_with_levels(study, told))["back_s"].tolist() == [back_s] * 2


def test_means_over_events_are_compared_whatever_their_number() -> None:
    """Twice as many events with the same waiting is like the other swarm; one long wait among many counts once."""
    study = made(OWN + '[[recovery]]\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\nafter_s = 400.0\n')
    told = series(lambda *_: 20.0)
    is_fault = told["variant"].str.startswith("loss=0.5")
    told.loc[is_fault, "events_followed"] = 10.0
    assert recovery_of(study, windows_with_levels(study, told))["back_s"].tolist() == [100.0] * 2
    is_long = is_fault & (told["replicate"] == 0)
    told.loc[is_long, ["events_followed", "waiting_time_s"]] = [1.0, 400.0]
    assert recovery_of(study, windows_with_levels(study, told))["back_s"].tolist() == [100.0] * 2
    told.loc[is_long, "events_followed"] = 10.0
    assert recovery_of(study, windows_with_levels(study, told))["back_s"].tolist() == [math.inf] * 2


def test_less_waiting_is_no_fault() -> None:
    """What should be little may be as little as it likes; a single run has no interval, too few windows no answer."""
    own = '[[recovery]]\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\nafter_s = {}\n'
    study = made(OWN + own.format(400.0) + own.format(900.0))
    told = series(lambda level, *_: 20.0 if level == "loss=0.0" else 1.0)
    found = recovery_of(study, windows_with_levels(study, told))
    assert found["back_s"].fillna(-1.0).tolist() == [100.0, 100.0, -1.0, -1.0]
    alone = recovery_of(study, windows_with_levels(study, told[told["replicate"] == 0]))
    assert alone["n"].tolist() == [1] * 4
    assert alone["back_s"].fillna(-1.0).tolist() == [100.0, 100.0, -1.0, -1.0]
    assert alone[["low_s", "high_s"]].isna().all(axis=None)


def test_the_interval_of_a_recovery_is_that_of_the_replicates() -> None:
    """One replicate is slow for longer than the others: some resamples lack it, and are back earlier."""
    study = made(OWN + '[[recovery]]\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\nafter_s = 200.0\n')

    def waiting(level: str, mode: str, replicate: int, time_s: float) -> float:
        return 20.0 * (4 if level == "loss=0.5" and time_s < 300 + 100 * (replicate // 3) else 1)

    found = recovery_of(study, windows_with_levels(study, series(waiting)))
    assert found[["low_s", "back_s", "high_s"]].to_numpy().tolist() == [[400.0, 500.0, 500.0]] * 2


@pytest.mark.parametrize(
    ("window_s", "end_s", "known_s", "last_s"),
    [
        (100.0, 1000.0, 1000.0, 900.0),
        (300.0, 1000.0, 1000.0, 600.0),
        (100.0, 950.0, 1000.0, 800.0),
        (300.0, 850.0, 900.0, 300.0),
        (300.0, 1000.0, 800.0, 300.0),
    ],
)
@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_an_incomplete_last_window_is_left_out(
    window_s: float, end_s: float, known_s: float, last_s: float, step_s: float
) -> None:
    """Whether the series ends in it, or the run in the last one of the series; every other one has its means."""
    sweep = SWEEP.replace("run.duration_s = 1000.0", f"run.duration_s = {end_s}\nrun.step_s = {step_s}")
    study = made(OWN.replace("window_s = 100.0", f"window_s = {window_s}"), sweep)
    told = series(lambda level, mode, replicate, time_s: time_s, known_s)
    windows = windows_with_levels(study, told)
    one = windows[(windows["variant"] == SAME) & (windows["replicate"] == 3)]
    starts_s = [window_s * index for index in range(round(last_s / window_s) + 1)]
    assert one["time_s"].tolist() == starts_s
    assert one["waiting_all"].tolist() == pytest.approx([start_s + (window_s - 100) / 2 for start_s in starts_s])
    assert one["events"].tolist() == [5 * window_s / 100] * len(starts_s)
    assert one["messages"].tolist() == [4 / step_s] * len(starts_s)


def test_courses_are_means_over_the_replicates() -> None:
    """With an interval that holds them, a row per window, for what is drawn over time."""
    study = made(OWN + '[[figure]]\nname = "f"\nkind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n')
    windows = windows_with_levels(study, series(lambda level, mode, replicate, time_s: float(replicate)))
    found = courses_of(study, windows)
    assert (found["mean"] == 4.5).all()
    assert ((found["low"] < 4.5) & (found["high"] > 4.5)).all()
    assert len(found) == 6 * 10


def test_a_missing_series_is_named() -> None:
    """Rather than a column of nothing."""
    study = made(OWN.replace("window_s", "from_s = 500.0\nwindow_s"), SWEEP)
    with pytest.raises(ValueError, match="series_every_s"):
        runs_of(study, table(), NONE)


FIT = """
[[fit]]
text = "Which loss fits"
factor = "mode"
targets = [
    { level = "hybrid 3", metric = "waiting_all", says = 60.0, iqr = 10.0 },
    { level = "decentralised", metric = "messages", says = 25.0, iqr = 5.0 },
]
"""


def test_a_fit_ranks_combinations_by_their_distances() -> None:
    """In published interquartile ranges; the sum is of squares, and resamples say how sure the first place is."""
    finding = '[[finding]]\ntext = "{0}"\nbecause = [{{ fit = "Which loss fits", within = "{0}", is = "closest" }}]\n'
    study = made(OWN + FIT + finding.format("loss=0.9") + finding.format("loss=0.5"))
    runs = runs_of(study, table(worse_at_90), NONE)
    found = fits_of(study, runs)
    broken = findings_of(study, {"fit": found}).set_index("text")["broken"]
    assert broken["loss=0.9"] == ""
    assert "farther" in broken["loss=0.5"]
    medians = runs.groupby("variant")[["waiting_all", "messages"]].median()
    assert found["within"].tolist()[:2] == ["loss=0.9"] * 2
    first = found.iloc[0]
    assert first["distance"] == pytest.approx((medians.loc["loss=0.9, hybrid 3", "waiting_all"] - 60) / 10)
    assert first["sum"] == pytest.approx((found["distance"].iloc[:2] ** 2).sum())
    assert found.groupby("within")["closest"].first().sum() == pytest.approx(1.0)
    assert first["closest"] > 0.5
    assert found["sum"].is_monotonic_increasing


def test_a_fit_without_runs_is_infinitely_far() -> None:
    """It is no winner."""
    study = made(OWN + FIT)
    runs = runs_of(study, table(worse_at_90), NONE)
    found = fits_of(study, runs[runs["variant"] != "loss=0.9, hybrid 3"])
    assert found["within"].iloc[-1] == "loss=0.9"
    assert math.isinf(found["sum"].iloc[-1])
    assert found["closest"].iloc[-1] == 0


def test_a_grid_shows_the_lowest_median_of_a_columns_levels() -> None:
    """And which level it is."""
    own = '[[grid]]\ntext = "g"\nmetric = "waiting_all"\nrows = "loss"\nfactor = "mode"\n'
    study = made(OWN + own + 'columns = { best = ["hybrid 3", "decentralised"], hybrid = ["hybrid 3"] }\n')
    runs = runs_of(study, table(worse_at_90), NONE)
    found = grids_of(study, runs).set_index(["row", "column"])
    assert found.loc[("loss=0.9", "best"), "level"] == "decentralised"
    medians = runs.groupby("variant")["waiting_all"].median()
    assert found.loc[("loss=0.9", "hybrid"), "median"] == medians["loss=0.9, hybrid 3"]


def lost(variant: str, replicates: Sequence[int]) -> list[dict[str, Any]]:
    """Rows of runs that are no replicates."""
    reason = "not valid: agent 3 failed in step 5 (25 steps missed): boom"
    return [{"variant": variant, "replicate": number, "means": "in-process", "reason": reason} for number in replicates]


CLAIMED = (
    f'[[claim]]\nid = "same"\ntext = "t"\nkind = "alike"\nmetric = "waiting_all"\na = "{SAME}"\nb = "{SLOW}"\n'
    'margin = 1.5\n[[finding]]\ntext = "Nothing matters."\nbecause = [{ claim = "same", is = "holds" }]\n'
)


@pytest.mark.parametrize(("invalid", "is_judged"), [(0, True), (1, True), (2, True), (3, False), (10, False)])
def test_a_variant_with_more_than_a_fifth_invalid_runs_is_not_judged(invalid: int, is_judged: bool) -> None:
    """By no contrast and no claim, and the first lines say so; what is left of it is shown."""
    text = OWN + LIMIT + CLAIMED
    runs = table()
    slow = SLOW
    rows = lost(slow, range(10 - invalid, 10))
    kept = runs[(runs["variant"] != slow) | (runs["replicate"] < 10 - invalid)].reset_index(drop=True)
    found = Evidence.of_sweep(made(text), kept, series(lambda *_: 20.0), rows)
    contrasts = found.contrasts
    is_of_it = (contrasts["level"] + ", " + contrasts["within"]) == slow
    assert set(contrasts[is_of_it]["verdict"]) == ({"alike"} if is_judged else {"no data"})
    assert set(contrasts[~is_of_it]["verdict"]) == {"alike"}
    assert (found.claims["verdict"].tolist() == ["no data"]) == (not is_judged)
    assert (found.findings["broken"] == "").all() == is_judged
    if not invalid:
        assert found.incomplete == []
        return
    assert found.incomplete[0].startswith(
        f"{invalid} of 60 runs failed or are not valid, and are no replicates: {slow}"
    )
    assert found.incomplete[0].endswith("agent 3 failed in step 5 (25 steps missed): boom")
    assert [line.startswith("Too few replicates are left") for line in found.incomplete[1:]] == [True] * (not is_judged)
    assert set(found.estimates[found.estimates["variant"] == slow]["n"]) == ({10 - invalid} - {0})


def test_invalid_runs_are_kept_with_the_tables_until_they_are_repeated(tmp_path: Path) -> None:
    """So a page that is made again says the same."""
    study = made(OWN + LIMIT)
    runs = table()
    kept = runs[runs["variant"] != SLOW].reset_index(drop=True)
    found = Evidence.of_sweep(study, kept, series(lambda *_: 20.0), lost(SLOW, range(10)))
    found.save(tmp_path)
    again = Evidence.of_folder(study, tmp_path)
    assert again.incomplete == found.incomplete
    assert again.unjudged == {SLOW: 0}
    Evidence.of_sweep(study, runs, series(lambda *_: 20.0)).save(tmp_path)
    assert Evidence.of_folder(study, tmp_path).incomplete == []
