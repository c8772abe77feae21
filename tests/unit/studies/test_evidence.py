"""From made-up runs to estimates, contrasts, verdicts and fits: what must come out is known."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from deltaswarm_studies.claims import claims_of
from deltaswarm_studies.contrasts import contrasts_of
from deltaswarm_studies.evidence import Evidence, fits_of
from deltaswarm_studies.tables import estimates_of, invalid_of, missing_metrics, missing_runs, runs_of, same_arrivals
from deltaswarm_studies.tables import too_few as variants_with_too_few
from tests.support.studying import FAST, LIMIT, OWN, SAME, SLOW, SWEEP, made, series, spread, table, worse_at_90

NONE = pd.DataFrame()


def test_estimates_are_medians_by_variant() -> None:
    study = made()
    found = estimates_of(study, runs_of(study, table(worse_at_90), NONE))
    rows = found[found["metric"] == "waiting_all"].set_index("variant")
    assert rows.loc["loss=0.9, hybrid 3", "median"] == pytest.approx(2 * rows.loc["loss=0.5, hybrid 3", "median"])
    assert set(rows["loss"]) == {"loss=0.0", "loss=0.5", "loss=0.9"}
    assert (rows["n"] == 10).all()


def test_a_contrast_compares_levels_within_each_cell() -> None:
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
        for metric in ("waiting_all", "senders")
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
    assert missing_metrics(study, part) == ["The table of runs has no columns senders (Agents that report in a step)."]
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


FIT = """
[[fit]]
text = "Which loss fits"
factor = "mode"
targets = [
    { level = "hybrid 3", metric = "waiting_all", says = 60.0, iqr = 10.0 },
    { level = "decentralised", metric = "messages", says = 25.0, iqr = 5.0 },
]
"""


def test_resamples_say_how_sure_the_first_place_is() -> None:
    study = made(OWN + FIT)
    runs = runs_of(study, table(worse_at_90), NONE)
    found = fits_of(study, runs)
    assert found.drop_duplicates("within")[["within", "verdict"]].to_numpy().tolist()[0] == ["loss=0.9", "closest"]
    assert found.groupby("within")["closest"].first().sum() == pytest.approx(1.0)
    assert found["closest"].iloc[0] > 0.5


def test_a_fit_without_runs_is_infinitely_far() -> None:
    study = made(OWN + FIT)
    runs = runs_of(study, table(worse_at_90), NONE)
    found = fits_of(study, runs[runs["variant"] != "loss=0.9, hybrid 3"])
    assert found["within"].iloc[-1] == "loss=0.9"
    assert math.isinf(found["sum"].iloc[-1])
    assert found["closest"].iloc[-1] == 0


def test_a_fit_uses_every_replicate_of_each_variant() -> None:
    """Of 30 replicates the median is that of 30, although the others have 10."""
    own = OWN + FIT.replace(
        'level = "decentralised", metric = "messages", says = 25.0',
        'level = "decentralised", metric = "messages", says = 1.0',
    )
    study = made(own, SWEEP.replace("repeats = 10", f'repeats = 10\nrepeats_of = {{ "{SLOW}" = 30 }}'))
    more = pd.DataFrame({"variant": SLOW, "replicate": range(30), "waiting_all": [60.0] * 10 + [90.0] * 20})
    others = pd.DataFrame({"variant": FAST, "replicate": range(10), "messages": 1.0})
    found = fits_of(study, pd.concat([more, others])).set_index(["within", "metric"])
    assert found.loc[("loss=0.9", "waiting_all"), "distance"] == 3.0


def lost(variant: str, replicates: Sequence[int]) -> list[dict[str, Any]]:
    reason = "not valid: agent 3 failed in step 5 (25 steps missed): boom"
    return [{"variant": variant, "replicate": number, "means": "in-process", "reason": reason} for number in replicates]


CLAIMED = (
    f'[[claim]]\nid = "same"\ntext = "t"\nkind = "alike"\nmetric = "waiting_all"\na = "{SAME}"\nb = "{SLOW}"\n'
    'margin = 1.5\n[[finding]]\nheading = "Loss"\nresults = [{ claim = "same" }]\n'
)


@pytest.mark.parametrize(("invalid", "is_judged"), [(0, True), (1, True), (2, True), (3, False), (10, False)])
def test_a_variant_with_more_than_a_fifth_invalid_runs_is_not_judged(invalid: int, is_judged: bool) -> None:
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
    assert ("no data" in found.findings[0].sentences[0]) == (not is_judged)
    if not invalid:
        assert found.incomplete == []
        return
    assert found.incomplete[0].startswith(
        f"{invalid} of 60 runs failed or are not valid, and are no replicates: {slow}"
    )
    assert found.incomplete[0].endswith("agent 3 failed in step 5 (25 steps missed): boom")
    assert [line.startswith("Too few replicates are left") for line in found.incomplete[1:]] == [True] * (not is_judged)
    assert set(found.estimates[found.estimates["variant"] == slow]["n"]) == ({10 - invalid} - {0})


def test_each_variant_is_judged_by_its_own_number_of_replicates() -> None:
    """Of 30 replicates 4 may fail where 3 of 10 are too many, and what is missing is counted up to 30."""
    study = made(sweep=SWEEP.replace("repeats = 10", f'repeats = 10\nrepeats_of = {{ "{SLOW}" = 30 }}'))
    invalid = pd.DataFrame([*lost(SLOW, range(4)), *lost(FAST, range(3))])
    assert variants_with_too_few(study, invalid) == {FAST: 7}
    runs = runs_of(study, table(), NONE)
    assert missing_runs(study, runs, invalid_of(runs, [])) == [
        f"20 of 80 runs are missing: {SLOW} (replicates 10 to 29)."
    ]


def test_invalid_runs_are_kept_with_the_tables_until_they_are_repeated(tmp_path: Path) -> None:
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
