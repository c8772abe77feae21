"""The page on result files names every column and key that runs write."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_cli.main import main
from deltaswarm_scenario.person_tables import TABLES
from tests.support.pages import ROOT

PAGE = (ROOT / "docs" / "RESULTS.md").read_text()
NAMED = set(re.findall(r"`\.?([a-z0-9_.]+)`", PAGE))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("results") / "run"
    sets = ["--set", "operator.person.policy=threshold", "--set", "run.duration_s=50", "--set", "record=off"]
    assert main(["run", "smoke", *sets, "--in-process", "--out", str(out)]) == 0
    return out


def header(file: Path) -> list[str]:
    with file.open(newline="") as stream:
        return next(csv.reader(stream))


def test_every_column_is_named(run: Path) -> None:
    columns = [*header(run / "series.csv"), *header(run / "events.csv")]
    columns += [column for table in TABLES.values() for column in table._fields]
    reasons = [re.sub(r"^(reports_)?dropped_", "", column) for column in columns]
    assert not set(reasons) - NAMED


def test_every_key_is_named(run: Path) -> None:
    """Of the summary and the manifest, to the second level."""
    for name in ("summary.json", "manifest.json"):
        for key, value in json.loads((run / name).read_text()).items():
            assert {key, f"{key}.mean"} & NAMED or any(one.startswith(f"{key}.") for one in NAMED), key
            if isinstance(value, dict) and key not in ("person", "frames_dropped", "reports_dropped", "versions"):
                assert not {inner for inner in value if not is_named(key, inner, value)}, key


def is_named(key: str, inner: str, value: dict[str, Any]) -> bool:
    """Whether the page has a key within a key, in full or after a dot; or, of some, just the key."""
    return key in ("host", "controller", "inputs") or f"{key}.{inner}" in NAMED or inner in NAMED
