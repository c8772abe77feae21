"""The notebooks: their cells run in order, and their files show what they give."""

import itertools
import json
import os
import re
import subprocess
import sys

import pytest

from tests.support.pages import ROOT

FOLDER = ROOT / "docs" / "notebooks"
REMAKE = "to execute them again: python docs/extensions/notebooks.py"
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
    kept = [output for cell in cells for output in cell.get("outputs", ()) if output["output_type"] == "stream"]
    assert "".join(itertools.chain.from_iterable(output["text"] for output in kept)) == done.stdout, REMAKE


def test_the_files_have_the_outputs_of_their_cells() -> None:
    """All were executed once, in order, without an error; each notebook is in the table above, and none is large."""
    files = sorted(FOLDER.glob("*.ipynb"))
    assert [file.stem for file in files] == sorted(PRINTED)
    for file in files:
        cells = [cell for cell in json.loads(file.read_text())["cells"] if cell["cell_type"] == "code"]
        assert [cell["execution_count"] for cell in cells] == [*range(1, len(cells) + 1)], REMAKE
        kinds = {output["output_type"] for cell in cells for output in cell["outputs"]}
        assert kinds <= {"display_data", "execute_result", "stream"}
        assert any("image/png" in output.get("data", {}) for cell in cells for output in cell["outputs"])
        assert file.stat().st_size < 200_000
