"""Exports as BIDS and Psych-DS: what their specifications demand, and the same values as in the tables."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from tests.support.sessions import a_command, a_participant, rows_of


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """The tables of two participants, one of whom has conditions whose labels BIDS does not allow, with exports."""
    a_participant(tmp_path / "out", 1, "AB")
    a_participant(tmp_path / "out", 2, ["A b", "A-b"])
    command = [*a_command(tmp_path), "--table", str(tmp_path / "data")]
    assert main([*command, "--format", "bids", "--format", "psych-ds"]) == 0
    assert main([*command, "--format", "bids"]) == 0, "again"
    return tmp_path / "data"


def test_bids_has_all_answers_once(data: Path) -> None:
    """Each run has a file of its own, named in the participant's scans; no cell is empty."""
    bids = data / "bids"
    assert [row["participant_id"] for row in rows_of(bids / "participants.tsv")] == ["sub-001", "sub-002"]
    files = [row["filename"] for row in rows_of(bids / "sub-002" / "sub-002_scans.tsv")]
    assert files == [f"beh/sub-002_task-swarm_acq-Ab_run-0{number}_beh.tsv" for number in (1, 2)]
    for file in files:
        [answer] = rows_of(bids / "sub-002" / file)
        assert (answer["probe"], answer["value"], answer["participant"]) == ("isa", "n/a", "2")
        assert set(answer) < set(json.loads((bids / "sub-002" / file).with_suffix(".json").read_text()))
    assert all("\t\t" not in file.read_text() for file in bids.rglob("*.tsv"))


def test_no_text_is_a_formula_in_any_table(tmp_path: Path) -> None:
    """Of notes, labels and reasons; one apostrophe less is what was typed."""
    out, data = tmp_path / "out", tmp_path / "data"
    for number in (1, 2):
        a_participant(out, number, ["A", "=B+1"])
    actions = out / "participant-001" / "0-A" / "actions.csv"
    actions.write_text(actions.read_text().replace('"tab\tand ""quote""\nof 1"', "\"=cmd|'/C calc'!A0\""))
    command = a_command(tmp_path)
    assert main([*command, "--withdraw", "2", "--reason", "+49 by phone"]) == 0
    assert main([*command, "--table", str(data), "--wide", "--format", "bids", "--format", "psych-ds"]) == 0
    cells = [
        cell
        for file in (*data.rglob("*.tsv"), *data.rglob("*.csv"))
        for row in csv.reader(file.read_text().splitlines(), delimiter="," if file.suffix == ".csv" else "\t")
        for cell in row
    ]
    assert [cell for cell in cells if cell[:1] in {*"=+-@"} and not cell[1:2].isdigit()] == []
    assert {"'=cmd|'/C calc'!A0", "'=B+1", "'+49 by phone"} <= {*cells}


VALIDATOR = shutil.which("bids-validator-deno", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.skipif(not VALIDATOR, reason="bids-validator-deno is not installed")
def test_bids_is_valid(data: Path) -> None:
    """By the validator of BIDS."""
    done = subprocess.run(
        [str(VALIDATOR), "--format", "json", data / "bids"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []


def test_psych_ds_describes_every_column(data: Path) -> None:
    """Files are named by keywords, and the metadata list the columns of all."""
    folder = data / "psych-ds"
    content = json.loads((folder / "dataset_description.json").read_text())
    assert (content["@context"], content["@type"], content["name"]) == ("https://schema.org/", "Dataset", "deltas")
    known = {variable["name"] for variable in content["variableMeasured"]}
    files = [*(folder / "data").iterdir()]
    assert len(files) > 5
    for file in files:
        assert re.fullmatch(r"study-[A-Za-z0-9]+_description-[A-Za-z0-9]+_data\.csv", file.name)
        with file.open(newline="") as stream:
            assert set(next(csv.reader(stream))) <= known
    with (folder / "data" / "study-deltas_description-actions_data.csv").open(newline="") as stream:
        assert [row["text"] for row in csv.DictReader(stream)] == [
            f'tab\tand "quote"\nof {number}' for number in (1, 1, 2, 2)
        ]
