"""Exports of the tables of sessions as datasets: BIDS (behaviour, .tsv) and Psych-DS (.csv)."""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_sessions import BIDS, PSYCH_DS
from deltaswarm_sessions.tables import staged, write_rows
from deltaswarm_wire.cells import rows_by_column
from deltaswarm_wire.files import write_whole

BIDS_VERSION = "1.10.0"
DESCRIPTION = "dataset_description.json"
README = (
    "Sessions of deltaswarm: people who work with a swarm of robots. All columns are described beside the tables.\n"
)

Row = Mapping[str, str]
Columns = Mapping[str, Row]


def export(kind: str, tables: Path, name: str) -> Path:
    """Write the tables in a folder as a dataset below it, in place of an earlier one; return its folder."""
    out = tables / kind
    if out.exists() and not (out / DESCRIPTION).exists():
        raise CommandError(f"{out} must be a dataset that was exported before, or not be there; move it away")
    dictionary: dict[str, dict[str, Row]] = {}
    for row in _rows(tables / "dictionary.tsv"):
        dictionary.setdefault(row["table"], {})[row["column"]] = row
    with staged(out) as part:
        (part / "new").mkdir()
        KINDS[kind](tables, part / "new", name, dictionary)
        if out.exists():
            out.rename(part / "old")
        (part / "new").rename(out)
    return out


def _bids(tables: Path, out: Path, name: str, dictionary: Mapping[str, Columns]) -> None:
    """Write participants, and for each participant the runs (scans) with the answers of each (beh)."""
    _json(out / DESCRIPTION, {"Name": name, "BIDSVersion": BIDS_VERSION, "DatasetType": "raw"})
    write_whole(out / "README.md", README.encode())
    people = [{"participant_id": _subject(row), **row} for row in _rows(tables / "participants.tsv")]
    _tsv(out / "participants.tsv", ["participant_id", *dictionary["participants"]], people)
    _json(out / "participants.json", _described(dictionary["participants"]))
    _json(out / "scans.json", _described(dictionary["runs"]))
    answers = _rows(tables / "probes.tsv")
    scans: dict[str, list[dict[str, str]]] = {}
    for row in _rows(tables / "runs.tsv"):
        subject = _subject(row)
        number = len(scans.setdefault(subject, [])) + 1
        label = re.sub(r"[^A-Za-z0-9]", "", row["condition"]) or "run"
        file = f"beh/{subject}_task-swarm_acq-{label}_run-{number:02}_beh.tsv"
        scans[subject].append({"filename": file, **row})
        own = [one for one in answers if (one["participant"], one["run"]) == (row["participant"], row["run"])]
        _tsv(out / subject / file, dictionary["probes"], own)
        described = {"TaskName": "swarm", **_described(dictionary["probes"])}
        _json((out / subject / file).with_suffix(".json"), described)
    for subject, rows in scans.items():
        _tsv(out / subject / f"{subject}_scans.tsv", ["filename", *dictionary["runs"]], rows)


def _psych_ds(tables: Path, out: Path, name: str, dictionary: Mapping[str, Columns]) -> None:
    """Write each table as a CSV file, and all columns as variables of a schema.org Dataset."""
    study = re.sub(r"[^A-Za-z0-9]", "", name) or "study"
    variables: dict[str, dict[str, str]] = {}
    for table, columns in dictionary.items():
        file = out / "data" / f"study-{study}_description-{table.replace('_', '')}_data.csv"
        write_rows(file, columns, _rows(tables / f"{table}.tsv"), ",")
        for column, row in columns.items():
            told = {"@type": "PropertyValue", "name": column, "description": row["meaning"], "unitText": row["unit"]}
            variables.setdefault(column, {key: value for key, value in told.items() if value})
    content = {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": name,
        "description": README.strip(),
        "variableMeasured": list(variables.values()),
    }
    _json(out / DESCRIPTION, content)


KINDS: Mapping[str, Callable[[Path, Path, str, Mapping[str, Columns]], None]] = {BIDS: _bids, PSYCH_DS: _psych_ds}


def _subject(row: Row) -> str:
    return f"sub-{int(row['participant']):03}"


def _described(columns: Columns) -> dict[str, Any]:
    told = {name: {"Description": row["meaning"], "Units": row["unit"]} for name, row in columns.items()}
    return {name: {key: value for key, value in one.items() if value} for name, one in told.items()}


def _rows(file: Path) -> Sequence[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as stream:
        return rows_by_column(stream, "\t")


def _tsv(file: Path, columns: Iterable[str], rows: Iterable[Row]) -> None:
    """Write a table of BIDS, which has n/a in empty cells, and neither tabs nor line breaks in them."""
    plain = [{name: " ".join(value.split()) or "n/a" for name, value in row.items()} for row in rows]
    write_rows(file, columns, plain)


def _json(file: Path, content: Mapping[str, Any]) -> None:
    write_whole(file, json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n")
