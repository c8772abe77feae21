"""The table of a study's events, rings around the densest place, and what is refused before the runs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.results.outcome import COMPLETED, SENSED, TOLD, WORKED, EventLife, Moment
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.sweeps import table as sweep_tables
from deltaswarm_orchestrator.sweeps.job import Task, work
from deltaswarm_orchestrator.sweeps.plan import Job
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.event_checks import least_s
from deltaswarm_studies.events import COLUMNS, events_of, from_densest_m, kept, lacking
from deltaswarm_studies.rings import ring_rows, rings_of
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import SettingsError, load
from tests.support.studying import FAST, OWN, SAME, SLOW, SWEEP, made
from tests.support.tiers import in_one_test

ASKED = f'[[rings]]\ntext = "told"\nvariants = ["{FAST}", "{SLOW}"]\nrings = 2\n'


def results(study: Study, sizes: Sequence[int], variants: Sequence[str] = ()) -> list[tuple[Job, dict[str, Any]]]:
    """Finished runs with so many events in each replicate; the first event of each is never told of."""
    jobs = [job for job in study.sweep.jobs() if job.variant.label in (variants or study.levels)]
    return [(job, {"events": lives(sizes[job.replicate])}) for job in jobs if job.replicate < len(sizes)]


def lives(count: int) -> dict[str, list[float | None]]:
    own = [
        EventLife(n, 20.0 + n, 20.0, 10.0 * n, 10.0 * n + 5, 10.0 * n + 7 if n else None, None, None, 0.0)
        for n in range(count)
    ]
    return {name: [getattr(life, name) for life in own] for name in EventLife._fields}


def test_a_row_says_when_each_moment_came_where_and_until_when_it_was_followed() -> None:
    """Empty: not before the end of the run. Distances are from the densest place of the smoke scenario, (20, 20)."""
    study = made(OWN + ASKED)
    events = events_of(study, results(study, [3, 2], [FAST]))
    assert list(events) == COLUMNS
    assert events["replicate"].tolist() == [0, 0, 0, 1, 1]
    assert events["from_densest_m"].tolist() == [0.0, 1.0, 2.0, 0.0, 1.0]
    assert events["told_s"].isna().tolist() == [True, False, False, True, False]
    assert set(events["end_s"]) == {1000.0}
    assert events["event"].dtype == int


def test_only_what_is_asked_about_is_kept() -> None:
    study = made(OWN + ASKED)
    assert set(events_of(study, results(study, [2]))["variant"]) == {FAST, SLOW}
    study = made(OWN + f'[[survival]]\nvariants = ["{FAST}"]\nreference = "{SAME}"\n')
    assert set(events_of(study, results(study, [2]))["variant"]) == {FAST, SAME}
    assert len(set(events_of(made(OWN), results(made(OWN), [2]))["variant"])) == 6


@pytest.mark.parametrize(("most", "replicates"), [(0, []), (9, []), (10, [0]), (29, [0]), (30, [0, 1]), (99, [0, 1])])
def test_the_table_is_bounded_by_whole_replicates(most: int, replicates: list[int]) -> None:
    """Of 2 variants with 5 and 10 events: half a replicate would not be comparable."""
    study = made(OWN.replace("[study]", f"[study]\nmax_events = {most}") + ASKED)
    found = results(study, [5, 10])
    events = events_of(study, found)
    assert sorted(set(events["replicate"])) == replicates
    note = kept(study, events, pd.DataFrame({"replicate": [0, 1]}))
    assert note == (
        f"`events.csv` has the events of replicates 0 of 2 (`study.max_events` = {most})." if replicates == [0] else ""
    )


def test_runs_without_events_are_named() -> None:
    """Those of earlier versions, all or some; of a study that asks nothing about events nothing is lacking."""
    study = made(OWN + ASKED)
    old = [(job, {}) for job, _ in results(study, [1])]
    assert lacking(study, events_of(study, old)) == [
        "This study's runs carry no events: nothing is said of their times."
    ]
    assert lacking(study, events_of(study, results(study, [2], [FAST]))) == [f"There are no events of {SLOW!r}."]
    assert lacking(made(OWN), pd.DataFrame(columns=COLUMNS)) == []
    with pytest.raises(ValueError, match="this study's runs carry no events"):
        ring_rows(study, study.file.rings[0], pd.DataFrame(columns=COLUMNS), FAST)


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_a_sweep_keeps_the_events_of_its_runs(step_s: float) -> None:
    sweep = SWEEP.replace("run.duration_s = 1000.0", f"run.duration_s = 100.0\nrun.step_s = {step_s}")
    study = made(
        sweep=sweep.replace("horizon_s = 100.0", "horizon_s = 50.0").replace(
            "100.0\n\n[sweep.axes]", "50.0\n\n[sweep.axes]"
        ),
        own=OWN.replace("window_s = 100.0", ""),
    )
    job = next(job for job in study.sweep.jobs() if job.variant.label == SAME)
    events = sweep_tables.events_of([(job, work(Task(job)))])
    names = [name for name in EventLife._fields if name not in ("shown_s", "read_s")]  # there is no inbox
    expected = [{name: getattr(life, name) for name in names} for life in run_in_process(job.scenario).lives]
    assert len(expected) > 3
    assert events[names].replace({math.nan: None}).to_dict("records") == expected
    assert events["told_s"].notna().any()
    assert set(events["end_s"]) == {100.0}


def test_distances_are_from_the_place_that_was_densest_at_the_arrival() -> None:
    """A density that moves takes its rings along; if it is the same everywhere, there is no such place."""
    density = {"path_m": [[10.0, 20.0], [30.0, 20.0]], "path_s": [0.0, 200.0], "mean_m": [20.0, 20.0]}
    table = {"arena": {"width_m": 40.0, "height_m": 40.0}, "run": {"duration_s": 300.0}}
    events = pd.DataFrame({"x_m": [10.0, 10.0, 30.0], "y_m": [20.0, 20.0, 23.0], "arrived_s": [0.0, 100.0, 250.0]})
    shuffled = events.sample(frac=1.0, random_state=1)
    scenario = load(Scenario, {**table, "events": {"density": density}})
    assert from_densest_m(scenario, events).tolist() == pytest.approx([0.0, 10.0, 3.0])
    assert from_densest_m(scenario, shuffled).sort_index().tolist() == pytest.approx([0.0, 10.0, 3.0])
    flat = load(Scenario, {**table, "events": {"density": {"kind": "uniform"}}})
    assert from_densest_m(flat, events).isna().all()


# Rings


def in_rings(waits_s: Sequence[Sequence[float | None]], variant: str = FAST) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {"variant": variant, "replicate": replicate, "from_densest_m": place + 1.0, "arrived_s": 0.0,
             "told_s": math.nan if wait_s is None else wait_s, "end_s": 1000.0}
            for replicate, run in enumerate(waits_s)
            for place, wait_s in enumerate(run)
        ]
    )  # fmt: skip


def test_rings_by_hand() -> None:
    """Two rings of two events in each of two runs: means by run, then the median over the runs."""
    study = made(OWN + ASKED)
    events = in_rings([[10.0, 20.0, 40.0, None], [30.0, 40.0, 60.0, 80.0]])
    inner, outer = ring_rows(study, study.file.rings[0], events, FAST)
    assert (inner["time_s"], outer["time_s"]) == ((15 + 35) / 2, (70 + 70) / 2)  # never: the horizon of 100 s
    assert (inner["from_m"], inner["until_m"], outer["from_m"], outer["until_m"]) == (1.0, 2.0, 3.0, 4.0)
    assert (inner["mean_m"], outer["ring"], outer["events"], outer["runs"]) == (1.5, 2, 4, 2)
    assert (inner["beyond_horizon"], outer["beyond_horizon"]) == (0.0, 0.25)


def test_rings_leave_out_what_could_not_be_followed() -> None:
    """As the metric of the mean does: an event 99 s before the end says less than the horizon of 100 s."""
    study = made(OWN + ASKED)
    events = in_rings([[10.0, 20.0, 40.0, 50.0]])
    late = events.assign(arrived_s=[0.0, 901.0, 900.0, 0.0], told_s=[10.0, 902.0, 940.0, 50.0])
    rows = ring_rows(study, study.file.rings[0], late, FAST)
    assert [(row["events"], row["time_s"]) for row in rows] == [(2, 25.0), (1, 50.0)]


WAITS = st.lists(st.integers(0, 150), min_size=1, max_size=40)


@given(WAITS, st.integers(2, 8))
def test_rings_divide_all_events_evenly(waits_s: list[int], count: int) -> None:
    """Sizes differ by one at most, no event is lost, and their means add up to the mean over all."""
    study = made(OWN + ASKED.replace("rings = 2", f"rings = {count}"))
    rows = ring_rows(study, study.file.rings[0], in_rings([waits_s]), FAST)
    sizes = [row["events"] for row in rows]
    assert sum(sizes) == len(waits_s)
    assert max(sizes) - min(sizes) <= 1
    assert len(rows) == min(count, len(waits_s))
    total_s = sum(row["events"] * row["time_s"] for row in rows)
    assert total_s == pytest.approx(float(np.minimum(waits_s, 100).sum()))


def test_a_table_of_rings_has_the_variants_that_have_events() -> None:
    study = made(OWN + ASKED)
    events = in_rings([[10.0, 20.0]])
    assert rings_of(study, events)["variant"].tolist() == [FAST, FAST]
    assert rings_of(study, pd.DataFrame(columns=COLUMNS)).empty
    with pytest.raises(ValueError, match="no place is the densest"):
        ring_rows(study, study.file.rings[0], events.assign(from_densest_m=[1.0, math.nan]), FAST)
    everything = made(OWN + "[[rings]]\n")
    assert set(rings_of(everything, pd.concat([events, in_rings([[1.0]], SLOW)]))["variant"]) == {FAST, SLOW}


# Before the runs

FIGURE = '[[figure]]\nname = "told"\nkind = "survival"\nmetric = "told_s"\n'
UNIFORM = SWEEP.replace("[scenario]", '[scenario]\nevents.density.kind = "uniform"')
SLOW_UPLINK = SWEEP.replace("[scenario]", "[scenario]\nuplink.latency_s = 100.0")


@in_one_test(
    ("own", "sweep", "complaint"),
    [
        ('[[survival]]\nmetric = "messages"\n', SWEEP, "survival[0].metric must be one of 'waiting_all'"),
        ('[[survival]]\nmetric = "told_p95"\n', SWEEP, "(got 'told_p95'; did you mean 'told_s'?)"),
        ('[[survival]]\nreference = "hybrid"\n', SWEEP, "survival[0].variants must be one of 'loss"),
        ('[[rings]]\nvariants = ["hybrid"]\n', SWEEP, "rings[0].variants must be one of 'loss=0.0, decentralised'"),
        ("[[rings]]\nrings = 1\n", SWEEP, "rings[0].rings must be an integer from 2 to 50 (got 1)"),
        ("[[survival]]\nhorizon_s = 1000.0\n", SWEEP, "must be less than the length of the runs, 1000 s"),
        (f"{FIGURE}horizon_s = 1000.0\n", SWEEP, "figure[0].horizon_s must be less than"),
        (f"{FIGURE}rings = 3\n", SWEEP, "figure[0].rings"),
        (f'{FIGURE}hue = "mode"\n', SWEEP, "must tell all variants apart"),
        (FIGURE.replace("told_s", "waiting"), SWEEP, "figure[0].metric must be one of 'waiting_all', 'told_s'"),
        ("[[rings]]\n", UNIFORM, "must not be uniform for rings around the densest place"),
        ("[[survival]]\n", SLOW_UPLINK, "longer than 100 s, which the delay of a report (uplink.latency_s)"),
        ('[[survival]]\nmetric = "completion_s"\nhorizon_s = 32.0\n', SWEEP, "longer than 32.3333 s"),
        ('[[survival]]\ntext = "a"\n[[survival]]\ntext = "a"\n', SWEEP, "which has the same metric (got 'a')"),
    ],
)  # fmt: skip
def test_what_no_run_could_answer_is_refused(own: str, sweep: str, complaint: str) -> None:
    with pytest.raises(SettingsError) as caught:
        made(OWN.replace('metrics = ["waiting_all", "messages"]', 'metrics = ["messages"]') + own, sweep)
    assert complaint in "\n".join(map(str, caught.value.problems))


@in_one_test(
    ("own", "sweep"),
    [
        ('[[survival]]\nmetric = "completion_s"\nhorizon_s = 33.0\n', SWEEP),
        ("[[survival]]\nhorizon_s = 999.0\n", SWEEP),
        ('[[survival]]\nmetric = "waiting_all"\n', SLOW_UPLINK),
        ("[[survival]]\n", UNIFORM),
        (f'{FIGURE}hue = "mode"\nfacet = "loss"\n', SWEEP),
        ('[[survival]]\n[[survival]]\nmetric = "completion_s"\n', SWEEP),
    ],
)
def test_what_some_run_can_answer_is_not_refused(own: str, sweep: str) -> None:
    assert made(OWN + own, sweep)


def test_the_shortest_of_the_runs_bounds_the_horizon() -> None:
    sweep = SWEEP.replace("run.duration_s = 1000.0", "").replace(
        "radio.loss = [0.0, 0.5, 0.9]", "run.duration_s = [1000.0, 500.0]"
    )
    own = OWN.replace("loss =", "length =")
    with pytest.raises(SettingsError, match=r"must be less than the length of the runs, 500 s"):
        made(own + "[[survival]]\nhorizon_s = 500.0\n", sweep)
    assert made(own + "[[survival]]\nhorizon_s = 499.0\n", sweep)


def test_the_shortest_time_until_a_moment() -> None:
    """Work shared by all, less the step in which it begins; a delay in whole steps; else nothing is known."""

    def least(moment: Moment, work_agent_s: float) -> float:
        table = {"run": {"step_s": 2.0, "duration_s": 300.0}, "uplink": {"latency_s": 7.0}, "agents": {"count": 10}}
        return least_s(moment, load(Scenario, {**table, "events": {"work_agent_s": work_agent_s}}))[0]

    assert [least(COMPLETED, work_agent_s) for work_agent_s in (100.0, 25.0, 10.0)] == [8.0, 0.5, 0.0]
    assert [least(moment, 100.0) for moment in (TOLD, SENSED, WORKED)] == [6.0, 0.0, 0.0]


def test_variants_with_different_horizons_need_one_for_the_table() -> None:
    sweep = SWEEP.replace("metrics.horizon_s = 100.0", "").replace(
        "radio.loss = [0.0, 0.5, 0.9]", "metrics.horizon_s = [100.0, 200.0]"
    )
    own = OWN.replace("loss =", "horizon_s =")
    with pytest.raises(SettingsError, match=r"survival\[0\].horizon_s must be given: .* 100 or 200"):
        made(own + "[[survival]]\n", sweep)
    assert made(own + "[[survival]]\nhorizon_s = 150.0\n", sweep)
