"""The data of all participants as tables: every row has its participant, every column is explained."""

import csv
import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.seal import digests, write_sealed
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_orchestrator.results.summary import value_at
from deltaswarm_scenario.person_tables import TABLES, OperatorAction, ProbeRow
from deltaswarm_scenario.situation import SituationRow
from deltaswarm_sessions.folder import RECORD
from deltaswarm_sessions.tables import write_tables
from deltaswarm_sessions.variables import KEYS
from tests.support.complaints import Printed
from tests.support.sessions import a_file

SUMMARY = {
    "complete": True,
    "valid": True,
    "seed": 2**53 - 1,
    "digest": "00ff",
    "waiting_time_s": {"restricted_mean": 12.5},
    "person": {"items": 7, "isa": 3.5, "answers_missing": 1, "tlx": {"raw": 40.0}, "commands_by_state": {"done": 2}},
}


def a_participant(folder: Path, number: int, conditions: str) -> None:
    """A session of these conditions, whose runs have an act and an answer each."""
    here = folder / f"participant-{number:03}"
    runs = []
    for place, condition in enumerate(conditions):
        run = here / f"{place}-{condition}"
        run.mkdir(parents=True)
        (run / "summary.json").write_text(json.dumps(SUMMARY))
        act = OperatorAction(place, "note", utc="2026-11-26T02:00:00.001Z", text=f'tab\tand "quote"\nof {number}')
        for name, row in (("actions", act), ("probes", ProbeRow("isa", 0, "isa", None, 120.0, None))):
            with (run / f"{name}.csv").open("w", newline="") as stream:
                csv.writer(stream).writerows([row._fields, row])
        attempt = {"folder": run.name, "complete": True, "digest": "00ff", "answers_missing": 1}
        runs.append({"place": place, "condition": condition, "stream": place, "attempts": [attempt]})
    (here / RECORD).write_text(json.dumps({"participant": number, "runs": runs}))


@pytest.fixture
def tables(tmp_path: Path) -> dict[str, pd.DataFrame]:
    """The tables of two participants, as pandas reads them."""
    out = tmp_path / "sessions"
    a_participant(out, 1, "AB")
    a_participant(out, 2, "BA")
    command = ["session", str(a_file(tmp_path)), "--out", str(out), "--table", str(tmp_path / "data")]
    assert main(command) == 0
    return {file.stem: pd.read_csv(file, sep="\t") for file in (tmp_path / "data").glob("*.tsv")}


def test_each_row_has_its_participant_condition_and_place(tables: dict[str, pd.DataFrame]) -> None:
    """Numbers as they were, texts too."""
    runs = tables["runs"]
    assert [[*row] for row in runs[[*KEYS]].to_numpy()] == [
        [1, "A", 0, "0-A"],
        [1, "B", 1, "1-B"],
        [2, "B", 0, "0-B"],
        [2, "A", 1, "1-A"],
    ]
    assert set(runs["seed"]) == {2**53 - 1}
    assert (runs["waiting_time_s"] == 12.5).all()
    assert (runs["tlx_raw"] == 40.0).all()
    assert runs["tlx_weighted"].isna().all()
    actions = tables["actions"]
    assert [*actions["text"]] == [f'tab\tand "quote"\nof {number}' for number in (1, 1, 2, 2)]
    assert pd.to_datetime(actions["utc"]).dt.microsecond.eq(1000).all()
    assert [*actions["condition"]] == ["A", "B", "B", "A"]
    assert tables["probes"]["value"].isna().all()
    assert [*tables["participants"]["answers_missing"]] == [2, 2]


def test_the_dictionary_explains_every_column(tables: dict[str, pd.DataFrame]) -> None:
    """With its type, and a unit where it has one; tables without a row have their columns too."""
    dictionary = tables.pop("dictionary")
    assert set(TABLES) < set(tables)
    for name, table in tables.items():
        assert [*dictionary[dictionary["table"] == name]["column"]] == [*table.columns]
    assert dictionary["meaning"].str.len().gt(3).all()
    in_seconds = dictionary["column"].str.endswith("_s") & ~dictionary["column"].str.endswith("per_s")
    assert dictionary[in_seconds]["unit"].isin(["s", "wall s", "page s"]).all()


def test_what_cannot_be_read_is_named(tmp_path: Path, capsys: Printed) -> None:
    """No session yet, and a record that was cut off."""
    out = tmp_path / "sessions"
    command = ["session", str(a_file(tmp_path)), "--out", str(out), "--table", str(tmp_path / "data")]
    assert main(command) == 2
    assert str(out) in capsys.readouterr().err
    a_participant(out, 1, "AB")
    file = out / "participant-001" / RECORD
    file.write_text(file.read_text()[:-9])
    assert main(command) == 2
    assert str(file) in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


FULL = {
    "complete": True,
    "valid": False,
    "invalid_because": ["too few", "too late"],
    "agent_steps": {"answered_share": 0.75},
    "seed": 7,
    "digest": "00ff",
    "waiting_time_s": {"restricted_mean": 12.5, "mean": 1.0},
    "told_s": {"mean": 20.5},
    "worked_s": {"mean": 31.5},
    "completion_s": {"mean": 30.25},
    "horizon_s": 600.0,
    "completed": 8,
    "operator_messages_per_s": {"mean": 0.5},
    "operator_time_above_threshold_s": 44.0,
    "person": {
        "items": 9,
        "read": 6,
        "missed": 2,
        "missed_share": 0.25,
        "acknowledge_s": 3.5,
        "commands": 5,
        "commands_by_state": {"done": 4},
        "isa": 2.5,
        "questions": 11,
        "answers_missing": 1,
        "page_away_s": 2.25,
        "tlx": {"raw": 40.0, "weighted": 45.0},
    },
    "task": {
        "share_right": 0.75,
        "hits": 3,
        "misses": 10,
        "false_alarms": 12,
        "correct_rejections": 13,
        "unjudged": 14,
        "d_prime": 1.5,
        "criterion": -0.125,
    },
}
RUNS = {
    "participant": "12",
    "condition": "training",
    "position": "0",
    "run": "0-training-2",
    "pilot": "0",
    "attempt": "2",
    "scenario": "smoke",
    "set": "a=1; b=2",
    "complete": "1",
    "valid": "0",
    "invalid_because": "too few; too late",
    "answered_share": "0.75",
    "stream": "3",
    "seed": "7",
    "horizon_s": "600.0",
    "digest": "00ff",
    **dict.fromkeys(("started", "wall_duration_s", "screen", "median_answer_s"), ""),
    **dict.fromkeys(
        ("tlx_mental", "tlx_physical", "tlx_temporal", "tlx_performance", "tlx_effort", "tlx_frustration"), ""
    ),
    **dict.fromkeys(("away_too_long", "too_many_missing", "d_prime_too_low", "answers_too_fast", "excluded"), ""),
    "training_value": "6.0",
    "waiting_time_s": "12.5",
    "told_s": "20.5",
    "worked_s": "31.5",
    "completion_s": "30.25",
    "completed": "8",
    "messages_per_s": "0.5",
    "time_above_threshold_s": "44.0",
    "items": "9",
    "read": "6",
    "missed": "2",
    "missed_share": "0.25",
    "acknowledge_s": "3.5",
    "commands": "5",
    "commands_done": "4",
    "share_right": "0.75",
    "hits": "3",
    "misses": "10",
    "false_alarms": "12",
    "correct_rejections": "13",
    "unjudged": "14",
    "d_prime": "1.5",
    "criterion": "-0.125",
    "situation_right_share": "0.5",
    "situation_true_share": "0.0",
    "situation_known_share": "0.0",
    "isa": "2.5",
    "questions": "11",
    "answers_missing": "1",
    "page_away_s": "2.25",
    "tlx_raw": "40.0",
    "tlx_weighted": "45.0",
}
NUMBERS = {
    *(
        "training_value",
        "waiting_time_s",
        "told_s",
        "worked_s",
        "completion_s",
        "horizon_s",
        "messages_per_s",
        "time_above_threshold_s",
        "missed_share",
    ),
    *("acknowledge_s", "share_right", "d_prime", "criterion", "situation_right_share", "isa", "tlx_raw"),
    *("situation_true_share", "situation_known_share"),
    *("tlx_weighted", "answered_share", "page_away_s"),
}
TEXTS = {"invalid_because", "condition", "run", "scenario", "set", "digest", "language", "training_outcome"}
TEXTS |= {"withdrawn", "withdrawn_because", "started", "screen", "order", "versions", "consent", "frozen"}
NUMBERS |= {"wall_duration_s", "median_answer_s"}
NUMBERS |= {"tlx_mental", "tlx_physical", "tlx_temporal", "tlx_performance", "tlx_effort", "tlx_frustration"}
UNITS = dict.fromkeys(
    (
        *("waiting_time_s", "told_s", "worked_s", "completion_s", "horizon_s"),
        *("time_above_threshold_s", "acknowledge_s", "page_away_s"),
    ),
    "s",
)
UNITS["messages_per_s"] = "1/s"
UNITS |= {"wall_duration_s": "wall s", "median_answer_s": "wall s"}


def a_full_run(sessions: Path) -> None:
    """A participant whose second training run has every number, after one that was cut off; one run is missing."""
    here = sessions / "participant-012"
    for name, summary in (("0-training", {"complete": False}), ("0-training-2", FULL)):
        (here / name).mkdir(parents=True)
        (here / name / "summary.json").write_text(json.dumps(summary))
    situation = here / "0-training-2" / "situation.csv"
    answers = [
        SituationRow("sagat", 0, "trees", 9.0, *row)
        for row in (("2", "2", "3", 1, 0, 0, -1, 0, -1), ("1", "3", "4", 0, -2, 0, -3, 0, -1))
    ]
    with situation.open("w", newline="") as stream:
        csv.writer(stream).writerows([SituationRow._fields, *answers])
    attempts = [
        {"folder": "0-training", "complete": False, "answers_missing": 5, "training_value": None},
        {"folder": "0-training-2", "complete": True, "answers_missing": 1, "training_value": 6.0},
    ]
    training = {"place": 0, "condition": "training", "scenario": "smoke", "set": ["a=1", "b=2"], "stream": 3}
    runs = [{**training, "attempts": attempts, "outcome": "reached"}, {"place": 1, "condition": "A", "attempts": []}]
    (here / RECORD).write_text(json.dumps({"participant": 12, "language": "de", "runs": runs}))


def rows_of(file: Path) -> list[dict[str, str]]:
    """The rows of a table."""
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream, delimiter="\t"))


def test_each_number_of_a_run_is_in_its_column(tmp_path: Path) -> None:
    """Those of the summary, of the record, and the share of right answers; a run without a number has an empty one."""
    a_full_run(tmp_path / "sessions")
    for _ in range(2):  # into a folder that is not there, and again
        files = write_tables(tmp_path / "sessions", tmp_path / "more" / "data")
    assert [file.name for file in files[:2]] == ["participants.tsv", "runs.tsv"]
    assert files[-1].name == "dictionary.tsv"
    cut_off, whole = rows_of(tmp_path / "more" / "data" / "runs.tsv")
    assert whole == RUNS
    assert [*whole] == [*RUNS]
    first = {name: value for name, value in cut_off.items() if value}
    keys = {name: RUNS[name] for name in ("participant", "condition", "position", "scenario", "set", "stream")}
    assert first == {**keys, "run": "0-training", "pilot": "0", "attempt": "1", "complete": "0"}
    assert rows_of(tmp_path / "more" / "data" / "participants.tsv") == [
        {
            "participant": "12",
            "withdrawn": "",
            "withdrawn_because": "",
            "pilot": "0",
            "allocated": "12",
            "frozen": "",
            "language": "de",
            "started": "",
            "order": "A",
            "versions": "",
            "consent": "",
            "runs": "2",
            "complete": "1",
            "invalid": "0",
            "answers_missing": "1",
            "training_runs": "1",
            "training_outcome": "reached",
        }
    ]
    assert not list((tmp_path / "more" / "data").glob("*.part"))


def test_the_dictionary_has_types_and_units(tmp_path: Path) -> None:
    """Of participants and runs: whole numbers unless they are listed above."""
    a_full_run(tmp_path / "sessions")
    *_, dictionary = write_tables(tmp_path / "sessions", tmp_path / "data")
    rows = [row for row in rows_of(dictionary) if row["table"] in ("participants", "runs")]
    assert len(rows) == 80
    for row in rows:
        kind = "number" if row["column"] in NUMBERS else "text" if row["column"] in TEXTS else "whole number"
        assert (row["type"], row["unit"]) == (kind, UNITS.get(row["column"], "")), row
    keys = [row["column"] for row in rows_of(dictionary) if row["table"] == "actions"][:4]
    assert keys == ["participant", "condition", "position", "run"]


def test_a_value_is_found_by_its_dotted_name() -> None:
    """True is 1; what is not there is None, also below a number."""
    assert value_at({"a": {"b": 0.5}, "c": True, "d": False}, "a.b") == 0.5
    assert value_at({"c": True}, "c") == 1
    assert value_at({"d": False}, "d") == 0
    assert value_at({"a": 1}, "a.b") is None
    assert value_at({}, "a.b") is None


def test_the_command_ends_with_the_runs_that_are_not_valid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """How many, which, and why one of them is not; it does not count as complete, and a pilot leaves it out."""
    a_full_run(tmp_path / "sessions")
    here = tmp_path / "sessions" / "participant-012"
    because = ["agent 3 failed in step 5 (25 steps missed): killed by SIGKILL"]
    summary = FULL | {"valid": False, "invalid_because": because}
    (here / "0-training-2" / "summary.json").write_text(json.dumps(summary))
    record = json.loads((here / RECORD).read_text())
    record["runs"][0]["attempts"][1]["valid"] = False
    (here / RECORD).write_text(json.dumps(record))
    write_tables(tmp_path / "sessions", tmp_path / "data")
    name = "participant 12, 0-training-2"
    line = f"1 of 1 complete runs are not valid, and are no replicates: {name}. For example {name}: {because[0]}"
    assert capsys.readouterr().err.splitlines()[-1] == f"deltaswarm: {line}"
    [participant] = rows_of(tmp_path / "data" / "participants.tsv")
    assert (participant["complete"], participant["invalid"], participant["training_runs"]) == ("0", "1", "0")
    assert rows_of(tmp_path / "data" / "runs.tsv")[1]["invalid_because"] == because[0]


def test_a_participant_without_a_record_is_not_left_out(tmp_path: Path) -> None:
    """Whose runs are there; tables without them would look whole."""
    for number in (1, 2):
        a_participant(tmp_path / "sessions", number, "AB")
    (tmp_path / "sessions" / "participant-002" / RECORD).unlink()
    with pytest.raises(CommandError, match="participant-002 has runs and no"):
        write_tables(tmp_path / "sessions", tmp_path / "data")


def test_a_killed_run_and_a_deleted_one_are_in_the_table(tmp_path: Path, capsys: Printed) -> None:
    """The first with the acts on disk but a last one that was cut off; the repetition is attempt 2."""
    here = tmp_path / "sessions" / "participant-001"
    a_participant(here.parent, 1, "ABC")
    (here / "1-B").rename(here / "1-B-2")
    record = json.loads((here / RECORD).read_text())
    record["runs"][1]["attempts"][0]["folder"] = "1-B-2"
    (here / "2-C" / "manifest.json").write_text("{}")
    write_sealed(here / RECORD, record, digests(here, ["2-C/manifest.json"]))
    killed = here / "1-B.part"
    killed.mkdir()
    (killed / "manifest.json").write_text(json.dumps({"seed": 5}))
    whole = (here / "1-B-2" / "actions.csv").read_text()
    (killed / "actions.csv").write_text(whole + whole.splitlines()[1][:12])
    shutil.rmtree(here / "2-C")
    write_tables(here.parent, tmp_path / "data")
    runs = rows_of(tmp_path / "data" / "runs.tsv")
    assert [(row["run"], row["attempt"], row["complete"], row["seed"]) for row in runs] == [
        ("0-A", "1", "1", f"{2**53 - 1}"),
        ("1-B", "1", "0", "5"),
        ("1-B-2", "2", "1", f"{2**53 - 1}"),
        ("2-C", "1", "0", ""),
    ]
    assert runs[-1]["invalid_because"] == "its folder was deleted"
    assert [row["run"] for row in rows_of(tmp_path / "data" / "actions.tsv")] == ["0-A", "1-B", "1-B-2"]
    lock = FolderLock(killed)
    write_tables(here.parent, tmp_path / "data")
    assert [row["run"] for row in rows_of(tmp_path / "data" / "runs.tsv")] == ["0-A", "1-B-2", "2-C"], "in progress"
    lock.release()
    (here / "0-A" / "manifest.json").write_text("{}")
    write_sealed(here / RECORD, record, digests(here, ["0-A/manifest.json"]))
    (here / "0-A" / "manifest.json").unlink()
    with pytest.raises(CommandError, match=r"0-A/manifest.json is missing"):
        write_tables(here.parent, tmp_path / "data")
