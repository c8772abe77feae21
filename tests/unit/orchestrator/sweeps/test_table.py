"""The tables of a sweep: the same bit for bit whoever did the runs, and right by the runs' own tables."""

import json
import shutil
import time
from pathlib import Path
from statistics import fmean
from typing import Any

import pandas as pd
import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_orchestrator.sweeps.folder import SweepFolder
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES, work
from deltaswarm_orchestrator.sweeps.job import series_of as windows_of_run
from deltaswarm_orchestrator.sweeps.load import load_sweep
from deltaswarm_orchestrator.sweeps.plan import flattened, replicate_seed
from deltaswarm_orchestrator.sweeps.table import (
    PER_SENDER,
    costs_of,
    digest_of,
    finished_runs,
    read_table,
    series_of,
    table_of,
    write_table,
)
from tests.support.sweeping import LOSSES, made, sweep, tasks_of, written
from tests.support.tiers import first_of

WINDOW_S = 20.0
CSV = ("table.csv", "series.csv")

OF_THE_RUN = ("wall_s", "steps_per_s", "real_time_factor", "exit_reason", "why", "operator_restarts", "resumed")
"""What a summary says of a run and its machine, and not of what it shows."""


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep by the command: three losses, two replicates, one of them also by real processes."""
    folder = tmp_path_factory.mktemp("sweeps")
    file = written(folder, prove=1, duration_s=150.0)
    sweep(file, folder / "out", "--series", "-j", "1")
    return folder / "out"


@pytest.fixture
def table(done: Path) -> pd.DataFrame:
    return pd.read_csv(done / "table.csv")


# What is in them


@pytest.mark.processes
def test_there_is_a_row_per_run_with_what_tells_it_apart(table: pd.DataFrame) -> None:
    """Variant, swept keys, replicate and seed, by variant and then by replicate."""
    assert list(table.columns[:4]) == ["variant", "radio.loss", "replicate", "seed"]
    assert list(table["variant"]) == [f"loss={loss}" for loss in LOSSES for _ in range(2)]
    assert list(table["radio.loss"]) == [loss for loss in LOSSES for _ in range(2)]
    assert list(table["replicate"]) == [0, 1] * 3
    assert list(table["seed"]) == [replicate_seed(1, replicate) for replicate in (0, 1)] * 3
    assert list(table["steps"]) == [150] * 6


@pytest.mark.processes
def test_every_figure_of_a_summary_is_in_the_table(done: Path, table: pd.DataFrame, tmp_path: Path) -> None:
    """As `deltaswarm run` writes it for the same scenario and seed, but for the speed of the machine.

    What it has for each sender stands in `senders.csv`.
    """
    row = table.iloc[3]
    senders = pd.read_csv(done / "senders.csv")
    own = senders[(senders["variant"] == row["variant"]) & (senders["replicate"] == row["replicate"])]
    (tmp_path / "scenario.toml").write_text(to_toml(load_sweep(str(done.parent / "mine.toml")).variants[1].scenario))
    arguments = ["run", str(tmp_path / "scenario.toml"), "--in-process", "--seed", str(row["seed"])]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    figures = {name: value for name, value in flattened(summary) if name not in OF_THE_RUN}
    by_sender = {name for name in figures if name.startswith(PER_SENDER)}
    assert len(own) == len(by_sender) > 0
    assert sum(figures[name] for name in by_sender if name.endswith(".messages")) == row["operator.messages"]
    assert sorted(own["value"]) == sorted(figures[name] for name in by_sender)
    assert figures["digest"] == row["digest"]
    for name, value in figures.items():
        if name in by_sender:
            continue
        if value is None:
            assert pd.isna(row[name])
        else:
            assert row[name] == value, name


@pytest.mark.processes
def test_the_proof_stands_in_the_table(done: Path, table: pd.DataFrame) -> None:
    """The sample's digest by real processes beside that in one process; both are equal."""
    assert list(table["digest_in_process"]) == list(table["digest"])
    proven = table.dropna(subset="digest_processes")
    assert list(proven["digest_processes"]) == list(proven["digest_in_process"])
    assert len(proven) == 1
    assert json.loads((done / "manifest.json").read_text())["proofs"] == {"checked": 1, "equal": 1}
    assert len(list((done / "runs").glob("*.processes.json"))) == 1


@pytest.mark.processes
def test_windows_of_the_series_have_the_means_of_their_steps(done: Path, table: pd.DataFrame, tmp_path: Path) -> None:
    """Of every column of a run's own series.csv, also of the last window, which is shorter; unknown is left out."""
    row = table.iloc[0]
    (tmp_path / "scenario.toml").write_text(to_toml(load_sweep(str(done.parent / "mine.toml")).variants[0].scenario))
    arguments = ["run", str(tmp_path / "scenario.toml"), "--in-process", "--seed", str(row["seed"])]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 0
    steps = pd.read_csv(tmp_path / "run" / "series.csv")
    expected = steps.groupby((steps["time_s"] // WINDOW_S).astype(int)).mean()
    series = pd.read_csv(done / "series.csv")
    mine = series[(series["variant"] == row["variant"]) & (series["replicate"] == row["replicate"])]
    assert list(mine["time_s"]) == [WINDOW_S * window for window in range(8)]
    assert set(steps.columns) - {"step"} <= set(mine.columns)
    for name in steps.columns.drop(["step", "time_s"]):
        assert list(mine[name].fillna(-1)) == pytest.approx(list(expected[name].fillna(-1))), name


@pytest.mark.processes
def test_the_long_table_has_every_run_and_window(done: Path, table: pd.DataFrame) -> None:
    series = pd.read_csv(done / "series.csv")
    assert len(series) == 6 * 8
    assert list(series.columns[:5]) == ["variant", "radio.loss", "replicate", "seed", "time_s"]
    heads = series[list(series.columns[:4])].drop_duplicates().reset_index(drop=True)
    pd.testing.assert_frame_equal(heads, table[list(table.columns[:4])])


@pytest.mark.processes
def test_costs_are_in_a_table_of_their_own(done: Path, table: pd.DataFrame) -> None:
    """They differ each time; the table of results does not."""
    costs = pd.read_csv(done / "costs.csv")
    assert list(costs["seed"]) == list(table["seed"])
    assert (costs[["wall_s", "steps_per_s", "max_rss_mb"]] > 0).all().all()
    assert costs["max_rss_mb"].max() < 2000
    assert not {"wall_s", "steps_per_s", "real_time_factor"} & set(table.columns)


@pytest.mark.processes
@pytest.mark.parametrize("name", ["table", "series", "costs"])
def test_parquet_says_the_same_as_csv(done: Path, name: str) -> None:
    """Where pyarrow is installed."""
    pytest.importorskip("pyarrow")
    parquet = pd.read_parquet(done / f"{name}.parquet")
    assert parquet.to_csv(index=False) == (done / f"{name}.csv").read_text()


@pytest.mark.processes
def test_the_folder_holds_nothing_else(done: Path) -> None:
    names = {".lock", "runs", "manifest.json", "sweep.toml"}
    names |= {f"{name}.{kind}" for name in ("table", "series", "costs", "senders") for kind in ("csv", "parquet")}
    assert {file.name for file in done.iterdir()} == names
    assert all(file.suffix == ".json" for file in (done / "runs").iterdir())


# Whoever did the runs


@pytest.mark.processes
@pytest.mark.parametrize("engine", first_of([["--engine", "dask", "-j", "2"], ["-j", "2"]]), ids=["dask", "local"])
def test_the_tables_do_not_depend_on_the_engine(done: Path, engine: list[str], tmp_path: Path) -> None:
    """Bit for bit the same as by one worker; and nothing is left of a cluster."""
    if "dask" in engine:
        pytest.importorskip("distributed")
    manifest = sweep(done.parent / "mine.toml", tmp_path / "out", "--series", *engine)
    assert manifest["digest"] == json.loads((done / "manifest.json").read_text())["digest"]
    for name in CSV:
        assert (tmp_path / "out" / name).read_bytes() == (done / name).read_bytes(), name


@pytest.mark.processes
def test_a_sweep_by_real_processes_has_the_same_table(done: Path, tmp_path: Path) -> None:
    """With every digest proven, where there are runs in one process beside them."""
    shutil.copytree(done, tmp_path / "out")
    manifest = sweep(done.parent / "mine.toml", tmp_path / "out", "--processes", "--repeats", "1")
    assert manifest["proofs"] == {"checked": 3, "equal": 3}
    proven, table = (pd.read_csv(folder / "table.csv") for folder in (tmp_path / "out", done))
    table = table[table["replicate"] == 0].reset_index(drop=True)[proven.columns]
    assert list(proven["digest_processes"]) == list(table["digest"])
    by_processes = ["digest_processes", "events_digest_processes"]
    one, other = (frame.drop(columns=by_processes) for frame in (proven, table))
    pd.testing.assert_frame_equal(one, other, check_dtype=False)
    kept = SweepFolder(tmp_path / "out")
    for job in load_sweep(str(done.parent / "mine.toml"), settings={"repeats": 1}).jobs():
        by_one, by_many = (kept.result(job, means) for means in (IN_PROCESS, PROCESSES))
        assert by_one is not None
        assert by_many is not None
        assert by_one["summary"] == by_many["summary"]
        for name in by_one["series"].keys() - {"operator_backlog"}:  # which is of the machine, not of the swarm
            assert by_one["series"][name] == by_many["series"][name], name


# Tables from results


def finished(folder: Path, settings: dict[str, Any]) -> tuple[SweepFolder, Any]:
    """A folder with the results of a sweep that was done in this process."""
    planned = made(settings, scenario={"run.duration_s": 30.0, "metrics.horizon_s": 10.0})
    kept = SweepFolder(folder)
    kept.runs.mkdir()
    for task in tasks_of(planned):
        kept.save(task.job, task.means, work(task))
    return kept, planned


def test_tables_and_lists_are_cells_of_json(tmp_path: Path) -> None:
    """So that CSV and Parquet can hold them."""
    densities = [{"kind": "uniform"}, {"mean_m": [10.0, 10.0]}]
    kept, planned = finished(tmp_path, {"axes": {"events.density": densities}, "repeats": 1})
    table = table_of(finished_runs(planned, kept), kept)
    cells = [json.loads(cell) for cell in table["events.density"]]
    assert [(cell["kind"], cell["mean_m"]) for cell in cells] == [("uniform", [50, 50]), ("gaussian", [10, 10])]
    assert list(table["agents_lost"]) == ["[]", "[]"]


def test_a_label_is_no_formula(tmp_path: Path) -> None:
    """In the table for spreadsheets; it is read as it was given, and columns of numbers stay as they are."""
    table = pd.DataFrame({"variant": ["=1+1", "-5", "a"], "value": [-1.5, 2.0, 3.0], "reason": [None, "'@x", None]})
    file, *_ = write_table(tmp_path / "table", table)
    assert file.read_text() == "variant,value,reason\n'=1+1,-1.5,\n-5,2.0,''@x\na,3.0,\n"
    back = read_table(file)
    assert [*back["variant"]] == [*table["variant"]]
    assert back["reason"][1] == "'@x"
    assert back["value"].dtype == float


def test_a_column_of_which_nothing_is_known_is_a_column_of_numbers(tmp_path: Path) -> None:
    """The covered area of a swarm without trees; also beside one that has it."""
    kept, planned = finished(
        tmp_path, {"axes": {"control.mode": ["decentralised", "hybrid"]}, "repeats": 1, "series_every_s": 1.0}
    )
    series = series_of(finished_runs(planned, kept))
    assert series["covered_area_m2"].dtype == float
    assert series["covered_area_m2"].isna().any()


def test_without_windows_there_is_no_series(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And the command says so when it is asked for one."""
    kept, planned = finished(tmp_path, {"axes": {"radio.loss": [0.5]}, "repeats": 1, "series_every_s": 0})
    runs = finished_runs(planned, kept)
    assert series_of(runs).empty
    assert len(costs_of(runs)) == 1
    file = tmp_path / "none.toml"
    file.write_text("schema = 1\n[sweep]\nseries_every_s = 0\naxes.radio.loss = [0.1]\n")
    assert main(["sweep", str(file), "--series", "--out", str(tmp_path / "out")]) == 2
    assert "series_every_s is 0" in capsys.readouterr().err


def test_a_sweeps_digest_depends_on_each_run(tmp_path: Path) -> None:
    kept, planned = finished(tmp_path, {"axes": {"radio.loss": [0.0, 0.5]}, "repeats": 1})
    runs = finished_runs(planned, kept)
    assert len({digest_of(runs), digest_of(runs[:1]), digest_of(runs[::-1])}) == 3


def test_labels_are_read_as_the_text_that_they_are(tmp_path: Path) -> None:
    """Numbers, truth and words for nothing; in other columns an empty cell is unknown, and a word stays one."""
    labels = ["10", "true", "None", "NA", "nan", ""]
    written = pd.DataFrame({"variant": labels, "replicate": range(6), "delta": [1.5, None] * 3, "why": ["NA"] * 6})
    write_table(tmp_path / "table", written)
    found = read_table(tmp_path / "table.csv", needs=["replicate"])
    assert found["variant"].tolist() == labels
    assert found["delta"].isna().tolist() == [False, True] * 3
    assert found["why"].tolist() == ["NA"] * 6
    with pytest.raises(ValueError, match="seed"):
        read_table(tmp_path / "table.csv", needs=["replicate", "seed"])


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_windows_of_a_run_are_in_seconds(step_s: float) -> None:
    """Means of their steps, and counts of their events, in the last one too, which is shorter."""
    sets = [f"run.step_s={step_s}", "run.duration_s=90", "metrics.horizon_s=20", "events.rate_hz=0.3"]
    scenario = load_scenario("smoke", [*sets, "events.work_agent_s=20", "record=off"], 2)
    outcome = run_in_process(scenario)
    found = windows_of_run(outcome, scenario, 20.0)
    starts_s = [0.0, 20.0, 40.0, 60.0, 80.0]
    assert found["time_s"] == starts_s
    assert windows_of_run(outcome, scenario, 0.0) == {}
    for index, start_s in enumerate(starts_s):

        def is_in(time_s: float | None, start_s: float = start_s) -> bool:
            return time_s is not None and start_s <= time_s < start_s + 20

        for column, name, rows in (
            ("events_open", "events_open", outcome.step_records),
            ("operator_messages", "messages", outcome.workloads),
        ):
            own = [getattr(row, name) for row in rows if is_in(row.time_s)]
            assert len(own) == round((10 if index == 4 else 20) / step_s)
            assert found[column][index] == pytest.approx(fmean(own))
        arrived = [event for event in outcome.events if is_in(event.arrived_s)]
        assert found["completed"][index] == sum(is_in(event.completed_s) for event in outcome.events)
        assert found["never_sensed"][index] == sum(event.sensed_s is None for event in arrived)
        assert found["events_followed"][index] == sum(event.arrived_s <= 70 for event in arrived)
    assert sum(one or 0 for one in found["completed"]) > 3


def test_a_runs_cost_is_the_time_that_it_took() -> None:
    """No more than passed, and no less than its steps took."""
    began = time.monotonic()
    [task] = tasks_of(made({"axes": {"radio.loss": [0.5]}, "repeats": 1}))
    cost = work(task)["cost"]
    assert 60 / cost["steps_per_s"] <= cost["wall_s"] <= time.monotonic() - began


def test_windows_have_the_times_of_the_events_that_arrived_in_them(tmp_path: Path) -> None:
    """Put together they are the run's: every event that could be followed is in one; completed ones are counted."""
    kept, planned = finished(tmp_path, {"axes": {"events.rate_hz": [0.5]}, "repeats": 1, "series_every_s": 10.0})
    ((_, result),) = finished_runs(planned, kept)
    series, summary = result["series"], result["summary"]
    counts = series["events_followed"]
    assert sum(counts) == summary["arrivals"]["followed"] > 0
    for column, mean in (
        ("waiting_time_s", summary["waiting_time_s"]["restricted_mean"]),
        ("completion_time_s", summary["completion_s"]["mean"]),
    ):
        total = sum(events * mean_s for events, mean_s in zip(counts, series[column], strict=True) if events)
        assert total / sum(counts) == pytest.approx(mean)
    assert sum(series["completed"]) == summary["completed"]
    assert sum(series["never_sensed"]) == summary["waiting_time_s"]["never_sensed"]
