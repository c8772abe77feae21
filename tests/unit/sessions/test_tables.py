"""The data of all participants as tables: every row has its participant, every column is explained."""

import json
import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.seal import digests, write_sealed
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_scenario.person_tables import TABLES
from deltaswarm_scenario.situation import SituationRow
from deltaswarm_sessions.folder import RECORD
from deltaswarm_sessions.tables import write_tables
from deltaswarm_sessions.variables import KEYS
from tests.support.complaints import Printed
from tests.support.sessions import a_command, a_participant, edited, rows_of


@pytest.fixture
def tables(tmp_path: Path) -> dict[str, pd.DataFrame]:
    """The tables of two participants, as pandas reads them."""
    a_participant(tmp_path / "out", 1, "AB")
    a_participant(tmp_path / "out", 2, "BA")
    assert main([*a_command(tmp_path), "--table", str(tmp_path / "data")]) == 0
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
    command = [*a_command(tmp_path), "--table", str(tmp_path / "data")]
    assert main(command) == 2
    assert str(tmp_path / "out") in capsys.readouterr().err
    file = a_participant(tmp_path / "out", 1, "AB") / RECORD
    file.write_text(file.read_text()[:-9])
    assert main(command) == 2
    assert str(file) in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


SUMMARY: dict[str, tuple[str, Any]] = {
    "answered_share": ("agent_steps.answered_share", 0.75),
    "seed": ("seed", 7),
    "horizon_s": ("horizon_s", 600.0),
    "digest": ("digest", "00ff"),
    "waiting_time_s": ("waiting_time_s.restricted_mean", 12.5),
    "told_s": ("told_s.mean", 20.5),
    "worked_s": ("worked_s.mean", 31.5),
    "completion_s": ("completion_s.mean", 30.25),
    "completed": ("completed", 8),
    "messages_per_s": ("operator_messages_per_s.mean", 0.5),
    "time_above_threshold_s": ("operator_time_above_threshold_s", 44.0),
    "items": ("person.items", 19),
    "read": ("person.read", 6),
    "missed": ("person.missed", 2),
    "missed_share": ("person.missed_share", 0.25),
    "acknowledge_s": ("person.acknowledge_s", 3.5),
    "commands": ("person.commands", 5),
    "commands_done": ("person.commands_by_state.done", 4),
    "share_right": ("task.share_right", 0.875),
    "hits": ("task.hits", 3),
    "misses": ("task.misses", 10),
    "false_alarms": ("task.false_alarms", 12),
    "correct_rejections": ("task.correct_rejections", 13),
    "unjudged": ("task.unjudged", 14),
    "d_prime": ("task.d_prime", 1.5),
    "criterion": ("task.criterion", -0.125),
    "isa": ("person.isa", 2.5),
    "questions": ("person.questions", 11),
    "answers_missing": ("person.answers_missing", 1),
    "page_away_s": ("person.page_away_s", 2.25),
    "tlx_raw": ("person.tlx.raw", 40.0),
    "tlx_weighted": ("person.tlx.weighted", 45.0),
}
"""By its column in the table of runs, where a number stands in a summary."""

RUN: dict[str, Any] = (
    {"participant": 12, "condition": "training", "position": 0, "run": "0-training-2"}
    | {"pilot": 0, "attempt": 2, "scenario": "smoke", "set": "a=1; b=2", "complete": 1, "valid": 0, "stream": 3}
    | {"invalid_because": "too few; too late", "training_value": 6.0}
    | {"situation_right_share": 0.5, "situation_true_share": 0.0, "situation_known_share": 0.0}
    | {name: value for name, (_, value) in SUMMARY.items()}
)


def a_full_run(sessions: Path, because: list[str]) -> Path:
    """A participant whose second training run has every number, after one that was cut off; one run is missing."""
    here = sessions / "participant-012"
    full: dict[str, Any] = {"complete": True, "valid": False, "invalid_because": because}
    for path, value in SUMMARY.values():
        *tables, name = path.split(".")
        table = full
        for one in tables:
            table = table.setdefault(one, {})
        table[name] = value
    for name, summary in (("0-training", {"complete": False}), ("0-training-2", full)):
        (here / name).mkdir(parents=True)
        (here / name / "summary.json").write_text(json.dumps(summary))
    answers = [
        SituationRow("sagat", 0, "trees", 9.0, *row)
        for row in (("2", "2", "3", 1, 0, 0, -1, 0, -1), ("1", "3", "4", 0, -2, 0, -3, 0, -1))
    ]
    write_csv(here / "0-training-2" / "situation.csv", SituationRow._fields, answers)
    attempts = [
        {"folder": "0-training", "complete": False, "answers_missing": 5, "training_value": None},
        {"folder": "0-training-2", "complete": True, "answers_missing": 1, "training_value": 6.0},
    ]
    training = {"place": 0, "condition": "training", "scenario": "smoke", "set": ["a=1", "b=2"], "stream": 3}
    runs = [{**training, "attempts": attempts, "outcome": "reached"}, {"place": 1, "condition": "A", "attempts": []}]
    (here / RECORD).write_text(json.dumps({"participant": 12, "language": "de", "runs": runs}))
    return here


def test_each_number_of_a_run_is_in_its_column(tmp_path: Path) -> None:
    """Those of the summary, of the record, and the share of right answers; a run without a number has an empty one."""
    a_full_run(tmp_path / "sessions", ["too few", "too late"])
    for _ in range(2):  # into a folder that is not there, and again
        files = write_tables(tmp_path / "sessions", tmp_path / "more" / "data")
    assert [file.name for file in files[:2]] == ["participants.tsv", "runs.tsv"]
    cut_off, whole = rows_of(files[1])
    assert {name: value for name, value in whole.items() if value} == {name: str(value) for name, value in RUN.items()}
    keys = {name: str(RUN[name]) for name in ("participant", "condition", "position", "scenario", "set", "stream")}
    first = {name: value for name, value in cut_off.items() if value}
    assert first == {**keys, "run": "0-training", "pilot": "0", "attempt": "1", "complete": "0"}
    [participant] = rows_of(files[0])
    assert {name: value for name, value in participant.items() if value} == (
        {"participant": "12", "pilot": "0", "allocated": "12", "language": "de", "order": "A", "runs": "2"}
        | {"complete": "1", "invalid": "0", "answers_missing": "1"}
        | {"training_runs": "1", "training_outcome": "reached"}
    )
    assert not list((tmp_path / "more" / "data").glob("*.part"))
    kinds = {int: "whole number", float: "number", str: "text"}
    told = {row["column"]: row for row in rows_of(files[-1]) if row["table"] == "runs"}
    assert {name: told[name]["type"] for name in RUN} == {name: kinds[type(value)] for name, value in RUN.items()}
    assert told["messages_per_s"]["unit"] == "1/s"


def test_the_command_ends_with_the_runs_that_are_not_valid(tmp_path: Path, capsys: Printed) -> None:
    """How many, which, and why one of them is not; it does not count as complete, and a pilot leaves it out."""
    because = "agent 3 failed in step 5 (25 steps missed): killed by SIGKILL"
    here = a_full_run(tmp_path / "sessions", [because])
    record = json.loads((here / RECORD).read_text())
    record["runs"][0]["attempts"][1]["valid"] = False
    (here / RECORD).write_text(json.dumps(record))
    write_tables(tmp_path / "sessions", tmp_path / "data")
    name = "participant 12, 0-training-2"
    line = f"1 of 1 complete runs are not valid, and are no replicates: {name}. For example {name}: {because}"
    *_, unsealed, last = capsys.readouterr().err.splitlines()
    assert last == f"deltaswarm: {line}"
    assert unsealed.endswith(", participant-012/0-training-2/summary.json")
    [participant] = rows_of(tmp_path / "data" / "participants.tsv")
    assert (participant["complete"], participant["invalid"], participant["training_runs"]) == ("0", "1", "0")


def test_a_participant_without_a_record_is_not_left_out(tmp_path: Path) -> None:
    """Whose runs are there; tables without them would look whole."""
    for number in (1, 2):
        here = a_participant(tmp_path / "sessions", number, "AB")
    (here / RECORD).unlink()
    with pytest.raises(CommandError, match="participant-002 has runs and no"):
        write_tables(tmp_path / "sessions", tmp_path / "data")


def test_a_killed_run_and_a_deleted_one_are_in_the_table(tmp_path: Path) -> None:
    """The first with the acts on disk but a last one that was cut off; the repetition is attempt 2."""
    here = a_participant(tmp_path / "sessions", 1, "ABC")
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


def test_the_wide_table_has_valid_runs_after_the_training(tmp_path: Path) -> None:
    """A row per participant, of the last valid attempt at each condition."""
    here = a_participant(tmp_path / "sessions", 1, "TABCB")
    edited(here / "2-B" / "summary.json", person={"isa": 1.0})
    edited(here / "3-C" / "summary.json", complete=False)
    write_tables(here.parent, tmp_path / "data", is_wide=True)
    [wide] = rows_of(tmp_path / "data" / "wide.tsv")
    assert {name.partition(".")[2] for name in wide} == {"", "A", "B"}
    assert (wide["participant"], wide["isa.A"], wide["isa.B"]) == ("1", "3.5", "3.5")
    edited(here / "4-B" / "summary.json", valid=False)
    write_tables(here.parent, tmp_path / "data", is_wide=True)
    assert rows_of(tmp_path / "data" / "wide.tsv")[0]["isa.B"] == "1.0"
