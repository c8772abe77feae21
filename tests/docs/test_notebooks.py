"""The notebooks: their cells run in order, and their files have no outputs."""

import json
import os
import re
import subprocess
import sys

import pytest

from tests.support.pages import ROOT

FOLDER = ROOT / "docs" / "notebooks"
PRINTED = {
    "controller": "",
    "first-run": r"told of \d+ of \d+ events\n(.*\n)+equal digests: True\n",
    "study": r"by hand (\d\.\d{6}), published \1\n",
}
"""What each prints, besides the values and figures that only a notebook shows."""


@pytest.mark.parametrize("name", sorted(PRINTED))
def test_the_cells_run_without_jupyter(name: str) -> None:
    """In the notebook's folder, as one script, without a warning; `test_site.py` runs them in Jupyter's kernel."""
    cells = json.loads((FOLDER / f"{name}.ipynb").read_text())["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "MPLBACKEND": "agg"},
        cwd=FOLDER,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    assert re.search(PRINTED[name], done.stdout), done.stdout


def test_the_files_are_small() -> None:
    """No cell keeps an output or the number of its last execution; each notebook is in the table above."""
    files = sorted(FOLDER.glob("*.ipynb"))
    assert [file.stem for file in files] == sorted(PRINTED)
    for file in files:
        for cell in json.loads(file.read_text())["cells"]:
            assert (cell.get("outputs", []), cell.get("execution_count")) == ([], None), file
