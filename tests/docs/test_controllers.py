"""The page on controllers: a stranger gets from an empty folder to a report, and its tables are the code's."""

import json
import re
import shutil
from pathlib import Path

import pytest

from deltaswarm_agent.controller import Decision, Percept
from tests.support.pages import ROOT, blocks, files, shell

PAGE = (ROOT / "docs" / "CONTROLLERS.md").read_text()

SHORTER = {"deltaswarm sweep": "--set run.duration_s=60 --repeats 2 --prove 1"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder with what the page says to put there."""
    shutil.copy(ROOT / "docs" / "controllers" / "levy.py", tmp_path)
    for name, text in files(PAGE).items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.processes
@pytest.mark.slow
def test_the_commands_work(folder: Path) -> None:
    """As they stand; equal digests with processes and without, in the sweep too, and a report with both."""
    lines = [line for block in blocks(PAGE) for line in block.splitlines()]
    script = [f"{line} {next((more for verb, more in SHORTER.items() if line.startswith(verb)), '')}" for line in lines]
    done = shell("\n".join(script), folder)
    assert done.returncode == 0, done.stdout + done.stderr
    summaries = [
        json.loads((folder / "runs" / name / "summary.json").read_text()) for name in ("in-process", "processes")
    ]
    assert summaries[0]["digest"] == summaries[1]["digest"]
    assert summaries[1]["valid"]
    manifest = json.loads((folder / "runs" / "processes" / "manifest.json").read_text())
    assert manifest["controller"]["mode"] == "levy:Levy"
    assert manifest["controller"]["source"]
    report = (folder / "sweeps" / "compare" / "page.html").read_text()
    assert "levy" in report
    assert "hybrid" in report


def test_the_page_has_all_that_a_controller_gets_and_gives() -> None:
    """Each field of a percept and a decision has a row."""
    for field in (*Percept._fields, *Decision._fields):
        assert re.search(rf"^\| [^|]*`{field}`", PAGE, flags=re.MULTILINE), field
