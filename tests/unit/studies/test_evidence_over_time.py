"""Evidence over time: metrics of windows, convergence, recovery, courses."""

import math

import pandas as pd
import pytest

from deltaswarm_studies.evidence import recovery_of
from deltaswarm_studies.tables import courses_of, runs_of, windows_with_levels
from tests.support.studying import OWN, SAME, SWEEP, made, series, table
from tests.support.tiers import in_one_test

NONE = pd.DataFrame()


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
    study = made(OWN + '[[figure]]\nname = "f"\nkind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n')
    windows = windows_with_levels(study, series(lambda level, mode, replicate, time_s: float(replicate)))
    found = courses_of(study, windows)
    assert (found["mean"] == 4.5).all()
    assert ((found["low"] < 4.5) & (found["high"] > 4.5)).all()
    assert len(found) == 6 * 10


def test_a_missing_series_is_named() -> None:
    study = made(OWN.replace("window_s", "from_s = 500.0\nwindow_s"), SWEEP)
    with pytest.raises(ValueError, match="series_every_s"):
        runs_of(study, table(), NONE)
