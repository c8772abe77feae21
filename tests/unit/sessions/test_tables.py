"""The data of all participants as tables: every row has its participant, every column is explained."""

import csv
import json
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_orchestrator.cli import main
from deltaswarm_scenario.person_tables import TABLES, OperatorAction, ProbeRow
from deltaswarm_sessions.folder import RECORD
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
    return {file.stem: pd.read_csv(file, sep="\t") for file in (tmp_path / "data").iterdir()}


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
    assert dictionary[in_seconds]["unit"].isin(["s", "wall s"]).all()


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
