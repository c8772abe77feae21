"""Execute the notebooks of the documentation in place, so that their files show what their cells give."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "notebooks"


def is_of_the_moment(output: Mapping[str, Any]) -> bool:
    """Whether an output is a warning, or a bar of progress, which tells how fast this machine was."""
    return output.get("name") == "stderr" or "real time" in str(output.get("data", {}).get("text/plain", ""))


def execute(file: Path) -> None:
    """Execute a notebook in its folder; keep values, figures and what is printed, without warnings and times."""
    notebook = nbformat.read(file, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(file.parent)}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if not is_of_the_moment(output)]
    notebook.metadata.language_info = {"name": "python"}
    nbformat.write(notebook, file)


if __name__ == "__main__":
    for notebook in sorted(FOLDER.glob("*.ipynb")):
        execute(notebook)
