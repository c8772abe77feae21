"""From made-up runs to estimates, contrasts, verdicts and findings: what must come out is known."""

import math

import pandas as pd
import pytest

from deltaswarm_orchestrator.studies.evidence import (
    claims_of,
    contrasts_of,
    courses_of,
    disagreements,
    estimates_of,
    findings_of,
    runs_of,
    windows_with_levels,
)
from deltaswarm_orchestrator.studies.recovery import recovery_of
from tests.studying import OWN, SWEEP, made, series, spread, table

NONE = pd.DataFrame()
LIMIT = '[[contrast]]\nid = "limit"\nfactor = "loss"\nreference = "loss=0.0"\nmargin = 1.1\n'


def worse_at_90(level: str, mode: str, replicate: int) -> float:
    """Under loss 0.9 hybrid swarms wait twice as long, decentralised ones as long as ever."""
    return spread(level, mode, replicate) * (2 if (level, mode) == ("loss=0.9", "hybrid 3") else 1)


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


def test_an_interaction_compares_changes() -> None:
    """Whether loss changes one mode more than the other."""
    own = LIMIT.replace("margin = 1.1\n", 'across = "mode"\nacross_pairs = [["hybrid 3", "decentralised"]]\n')
    study = made(OWN + own)
    found = contrasts_of(study, runs_of(study, table(worse_at_90), NONE))
    waiting = found[found["metric"] == "waiting_all"].set_index("level")
    assert waiting.loc["loss=0.9", "verdict"] == "higher"
    assert waiting.loc["loss=0.9", "estimate"] == pytest.approx(2)
    assert waiting.loc["loss=0.5", "verdict"] == "unclear"


def claim(text: str) -> pd.Series:
    """The judgement of one claim."""
    study = made(OWN + f'[[claim]]\nid = "c"\ntext = "c"\nmetric = "waiting_all"\n{text}')
    return claims_of(study, runs_of(study, table(worse_at_90), NONE)).iloc[0]


FAST, SLOW, SAME = "loss=0.9, decentralised", "loss=0.9, hybrid 3", "loss=0.0, hybrid 3"


@pytest.mark.parametrize(
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
        (f'kind = "value"\nof = "{FAST}"\nwithin = [15.0, 40.0]', "holds"),
        (f'kind = "value"\nof = "{SLOW}"\nwithin = [15.0, 30.0]', "refuted"),
        (f'kind = "value"\nof = "{FAST}"\nwithin = [25.0, 26.0]', "undecided"),
    ],
)
def test_verdicts_are_symmetric(text: str, verdict: str) -> None:
    """A claim is refuted only where the opposite is shown; where neither is, it is undecided."""
    assert claim(text)["verdict"] == verdict


def test_holms_correction_is_over_the_claims_of_one_source() -> None:
    """Claims of another source are another question."""
    one = '[[claim]]\nid = "{}"\ntext = "t"\nsource = "{}"\nmetric = "waiting_all"\n'
    one += f'less = "{FAST}"\nmore = "{SLOW}"\n'
    study = made(OWN + "".join(one.format(name, source) for name, source in (("a", "x"), ("b", "x"), ("c", "y"))))
    found = claims_of(study, runs_of(study, table(worse_at_90), NONE)).set_index("claim")
    assert found["family"].to_dict() == {"a": 2, "b": 2, "c": 1}
    assert found.loc["a", "p_holm"] == pytest.approx(2 * found.loc["c", "p_holm"])


def test_a_finding_that_is_no_longer_carried_is_named() -> None:
    """By the result that fails it; one that is carried is not."""
    own = OWN + LIMIT + (
        '[[finding]]\ntext = "carried"\nbecause = [{ contrast = "limit", metric = "waiting_all", level = "loss=0.9", '
        'within = "hybrid 3", is = "higher" }]\n'
        '[[finding]]\ntext = "not carried"\nbecause = [{ contrast = "limit", metric = "waiting_all", '
        'level = "loss=0.5", within = "hybrid 3", is = "higher" }]\n'
        '[[finding]]\ntext = "about nothing"\nbecause = [{ contrast = "limit", level = "loss=7", is = "higher" }]\n'
    )  # fmt: skip
    study = made(own)
    runs = runs_of(study, table(worse_at_90), NONE)
    found = findings_of(study, claims_of(study, runs), contrasts_of(study, runs)).set_index("text")["broken"]
    assert found["carried"] == ""
    assert "alike" in found["not carried"]
    assert "loss=7" in found["about nothing"]


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
    assert runs["messages"].to_numpy() == pytest.approx(4.0 / study.sweep.variants[0].scenario.run.step_s)


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


def test_courses_are_means_over_the_replicates() -> None:
    """With an interval that holds them, a row per window, for what is drawn over time."""
    study = made(OWN + '[[figure]]\nname = "f"\nkind = "time"\nmetric = "waiting_all"\nhue = "mode"\n')
    windows = windows_with_levels(study, series(lambda level, mode, replicate, time_s: float(replicate)))
    found = courses_of(study, windows)
    assert (found["mean"] == 4.5).all()
    assert ((found["low"] < 4.5) & (found["high"] > 4.5)).all()
    assert len(found) == 6 * 10


def test_a_window_that_does_not_fit_the_series_is_refused() -> None:
    """Its rows could not be told apart."""
    study = made(OWN.replace("window_s = 100.0", "window_s = 150.0"))
    with pytest.raises(ValueError, match="series_every_s"):
        windows_with_levels(study, series(lambda *_: 1.0))


def test_a_missing_series_is_named() -> None:
    """Rather than a column of nothing."""
    study = made(OWN.replace("window_s", "from_s = 500.0\nwindow_s"), SWEEP)
    with pytest.raises(ValueError, match="series_every_s"):
        runs_of(study, table(), NONE)
