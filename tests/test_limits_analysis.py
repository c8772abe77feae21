"""Effects, tests and recovery on tables made up for it: what is in them is found, what is not is not."""

import math

import numpy as np
import pandas as pd
import pytest

from deltaswarm_orchestrator.analysis import intervals
from deltaswarm_orchestrator.limits import recovery
from deltaswarm_orchestrator.limits.effects import BETWEEN, HARM, LIMIT, comparisons_of, estimates_of
from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS, MODES
from deltaswarm_orchestrator.limits.recovery import back_s, recovery_of
from deltaswarm_orchestrator.limits.runs import IN_TREES, MESSAGES, WAITING, runs_of, windows_of
from tests.limiting import plain, series, table

LOSS, JAM, THIRD, ROOTS = (EXPERIMENTS[name] for name in ("network-loss", "jamming", "lose-a-third", "lose-the-roots"))
NOTHING = pd.DataFrame()


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch: pytest.MonkeyPatch) -> None:
    """The intervals' digits are not what is tested here."""
    monkeypatch.setattr(intervals, "RESAMPLES", 49)
    monkeypatch.setattr(recovery, "RESAMPLES", 49)


def hurt(level: str, mode: str, replicate: int) -> float:
    """Half of the frames lost or more doubles the waiting of hybrid 3, and of nobody else."""
    factor = 2.0 if mode == "hybrid 3" and level in ("loss=0.5", "loss=0.9") else 1.0
    return plain(level, mode, replicate) * factor


def one(rows: pd.DataFrame, **wanted: object) -> "pd.Series":
    for column, value in wanted.items():
        rows = rows[rows[column] == value]
    (index,) = rows.index
    return rows.loc[index]


# Effects


def test_an_effect_is_found_where_it_is() -> None:
    """Ratio 2 from half of the frames on, of one mode; no other comparison with no limit is significant."""
    tests = comparisons_of(LOSS, runs_of(LOSS, table(LOSS, waiting=hurt), NOTHING))
    limit = tests[(tests["question"] == LIMIT) & (tests["measure"] == WAITING)]
    shown = limit[limit["p_holm"] < 0.05]
    assert set(zip(shown["a"], shown["level"], strict=True)) == {("hybrid 3", "loss=0.5"), ("hybrid 3", "loss=0.9")}
    assert shown["ratio"].tolist() == [2.0, 2.0]
    harm = one(tests, question=HARM, measure=WAITING, level="loss=0.9", a="hybrid 3", b="decentralised")
    assert harm["ratio"] == pytest.approx(2.0)
    assert harm["p_holm"] < 0.05
    between = one(tests, question=BETWEEN, measure=WAITING, level="loss=0.0", a="hybrid 3", b="decentralised")
    assert between["difference"] == pytest.approx(4 + 2 * 4.5 / 7)


def test_p_is_corrected_within_question_and_measure() -> None:
    """Never below what the test gave, and by no more than the family's size."""
    tests = comparisons_of(LOSS, runs_of(LOSS, table(LOSS, waiting=hurt), NOTHING))
    assert (tests["p_holm"] >= tests["p"]).all()
    for _, family in tests.groupby(["question", "measure"]):
        assert (family["p_holm"] <= family["p"] * len(family) + 1e-12).all()
    sizes = tests.groupby("question").size() / 2
    assert sizes.to_dict() == {LIMIT: 12, BETWEEN: 15, HARM: 12}


def test_ten_replicates_can_show_something_in_every_experiment() -> None:
    """The smallest p that they can give survives the correction over its family, which is as large for one."""
    for experiment in EXPERIMENTS.values():
        windows = windows_of(experiment, series(experiment, repeats=1), 1.0)
        runs = runs_of(experiment, table(experiment, repeats=1), windows)
        largest = comparisons_of(experiment, runs).groupby(["question", "measure"]).size().max()
        assert 2 / 2 ** (20 if experiment is LOSS else 10) * largest < 0.05


def test_no_difference_is_none() -> None:
    """Equal values give ratio 1 and p 1, one replicate gives no interval."""
    tests = comparisons_of(LOSS, runs_of(LOSS, table(LOSS, repeats=1), NOTHING))
    assert set(tests.loc[tests["question"] == LIMIT, "ratio"]) == {1.0}
    assert (tests["p"] == 1.0).all()
    estimates = estimates_of(LOSS, runs_of(LOSS, table(LOSS, repeats=1), NOTHING))
    assert estimates["low"].isna().all()


def test_runs_without_a_value_are_left_out() -> None:
    """With their pair; a mode without any has nothing to compare."""
    known = table(LOSS, waiting=hurt)
    hierarchical = known["variant"].str.endswith("hierarchical")
    known.loc[hierarchical, "waiting_time_s.mean_with_never_sensed"] = np.nan
    known.loc[(known["variant"] == "loss=0.9, hybrid 3") & (known["replicate"] == 4), known.columns[3]] = np.nan
    tests = comparisons_of(LOSS, runs_of(LOSS, known, NOTHING))
    assert one(tests, question=LIMIT, measure=WAITING, level="loss=0.9", a="hybrid 3")["n"] == 9
    nothing = one(tests, question=LIMIT, measure=WAITING, level="loss=0.9", a="hierarchical")
    assert (nothing["n"], nothing["p_holm"]) == (0, 1.0)


def test_a_strange_table_is_refused() -> None:
    """One of another experiment, or without a column."""
    with pytest.raises(ValueError, match=r"jamming has no level 'loss=0\.0'"):
        runs_of(JAM, table(LOSS), NOTHING)
    with pytest.raises(ValueError, match="no column 'seed'"):
        runs_of(LOSS, table(LOSS).drop(columns="seed"), NOTHING)


# Where the limit comes and goes


def jammed(level: str, mode: str, replicate: int, time_s: float) -> float:
    """Hierarchical waits four times as long while the jammer is there, and 600 s more."""
    is_hurt = mode == "hierarchical" and level == "20 m" and 3000 <= time_s < 6600
    return plain(level, mode, replicate) * (4.0 if is_hurt else 1.0)


def test_measures_are_those_of_the_time_of_the_limit() -> None:
    """What was before and after is not in them."""
    windows = windows_of(JAM, series(JAM, waiting=jammed), 1.0)
    runs = runs_of(JAM, table(JAM), windows)
    tests = comparisons_of(JAM, runs)
    assert one(tests, question=LIMIT, measure=WAITING, level="20 m", a="hierarchical")["ratio"] == pytest.approx(4.0)
    assert one(tests, question=LIMIT, measure=WAITING, level="10 m", a="hierarchical")["ratio"] == 1.0


def test_a_run_that_ends_before_its_fault_has_no_measures() -> None:
    """NaN, not that of another time."""
    short = series(JAM)
    runs = runs_of(JAM, table(JAM), windows_of(JAM, short[short["time_s"] < 1000], 1.0))
    assert len(runs) == 90
    assert runs[WAITING].isna().all()


def test_windows_are_weighted_by_their_events() -> None:
    """A window without events has no waiting time, and takes none from its neighbours."""
    rows = series(LOSS, repeats=1)
    first = (rows["variant"] == "loss=0.0, hybrid 3") & (rows["time_s"] < 300)
    rows.loc[first, "events_arrived"] = [1.0, 3.0, 0.0]
    rows.loc[first, "waiting_time_s"] = [10.0, 50.0, np.nan]
    windows = windows_of(LOSS, rows[rows["time_s"] < 8950], 0.5)
    window = one(windows, level="loss=0.0", mode="hybrid 3", time_s=0.0)
    assert (window[WAITING], window["events"]) == (40.0, 4.0)
    assert window[MESSAGES] == pytest.approx(2 * plain("", "hybrid 3", 0))
    assert windows["time_s"].max() == 8700.0


# Recovery


def test_recovery_is_counted_from_the_faults_end() -> None:
    """600 s after the jammer is gone hierarchical is as before: within the third window; the others at once."""
    found = recovery_of(JAM, windows_of(JAM, series(JAM, waiting=jammed), 1.0))
    hard = found[(found["level"] == "20 m") & (found["measure"] == WAITING)].set_index("mode")
    assert hard["back_s"].to_dict() == {"decentralised": 300.0, "hierarchical": 900.0, "hybrid 3": 300.0}
    assert hard.loc["hierarchical", ["low_s", "high_s"]].tolist() == [900.0, 900.0]
    assert hard.loc["hierarchical", "worst"] == pytest.approx(4.0)
    trees = found[(found["measure"] == IN_TREES) & (found["mode"] == "decentralised")]
    assert (trees["back_s"] == 300.0).all(), "a swarm without trees has lost none"


def test_what_never_comes_back_is_said_so() -> None:
    """Half of the waiting more than before to the end: inf, not the length of the run."""

    def worse(level: str, mode: str, replicate: int, time_s: float) -> float:
        return plain(level, mode, replicate) * (1.5 if level == "a third lost" and time_s >= 4500 else 1.0)

    found = recovery_of(THIRD, windows_of(THIRD, series(THIRD, waiting=worse), 1.0))
    waiting = found[found["measure"] == WAITING]
    assert set(waiting["reference"]) == {"none lost", "17 from the beginning"}
    assert (waiting["back_s"] == math.inf).all()
    assert (waiting["high_s"] == math.inf).all()


def test_fewer_messages_are_a_change_but_less_waiting_is_none() -> None:
    """A swarm that finds events faster after a fault has come back; one that says nothing has not."""

    def less(level: str, mode: str, replicate: int, time_s: float) -> float:
        return plain(level, mode, replicate) * (0.5 if level == "roots lost" and time_s >= 4500 else 1.0)

    found = recovery_of(ROOTS, windows_of(ROOTS, series(ROOTS, waiting=less, messages=less), 1.0))
    assert (found.loc[found["measure"] == WAITING, "back_s"] == 300.0).all()
    assert (found.loc[found["measure"] == MESSAGES, "back_s"] == math.inf).all()


def test_one_replicate_has_no_interval_and_a_short_run_no_answer() -> None:
    """NaN for what is not known."""
    alone = recovery_of(ROOTS, windows_of(ROOTS, series(ROOTS, repeats=1), 1.0))
    assert alone["low_s"].isna().all()
    assert (alone["back_s"] == 300.0).all()
    rows = series(ROOTS)
    short = recovery_of(ROOTS, windows_of(ROOTS, rows[rows["time_s"] < 4800], 1.0))
    assert short["back_s"].isna().all()
    assert list(dict.fromkeys(short["mode"])) == list(MODES)


def test_constant_limits_have_no_recovery() -> None:
    """There is no time from which on it could be counted."""
    assert recovery_of(LOSS, windows_of(LOSS, series(LOSS, repeats=1), 1.0)).empty


@pytest.mark.parametrize(
    ("ratios", "measure", "expected"),
    [
        ([3.0, 1.2, 1.3, 1.0, 1.1], WAITING, 1200.0),
        ([1.25, 1.25], WAITING, 300.0),
        ([0.1, 0.1], WAITING, 300.0),
        ([0.1, 0.8, 0.8], MESSAGES, 600.0),
        ([1.0], WAITING, math.inf),
        ([math.nan, 1.0, math.nan], WAITING, math.inf),
    ],
)
def test_back_is_two_windows_in_a_row(ratios: list[float], measure: str, expected: float) -> None:
    """One alone may be chance; an unknown one is none."""
    assert back_s(np.array(ratios), measure) == expected
