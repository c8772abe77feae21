"""The tutorial: a stranger who follows it ends with a figure of their own data."""

import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from tests.support.pages import ROOT, blocks, files, shell

PAGE = (ROOT / "docs" / "TUTORIAL.md").read_text()
SHORTER = {
    "deltaswarm run smoke": "--set run.duration_s=100",
    "deltaswarm study scout.toml\n": "--set run.duration_s=100 --set metrics.horizon_s=50 --repeats 7 --prove 0 -j 1",
}


@pytest.mark.processes
@pytest.mark.slow
def test_the_tutorial_ends_in_a_figure(tmp_path: Path) -> None:
    """Every command in order (runs are shorter): equal digests, a claim that is judged, and the reader's own figure."""
    install, *steps = blocks(PAGE)
    assert install.startswith("python3 -m venv .venv")
    folder = tmp_path / "swarm"
    folder.mkdir()
    shutil.copy(ROOT / "docs" / "controllers" / "scout.py", folder)
    for name, text in files(PAGE).items():
        (folder / name).write_text(text)
    script = "".join(steps)
    for command, more in SHORTER.items():
        script = script.replace(
            command, f"{command.strip()} {more}\n" if command.endswith("\n") else f"{command} {more}"
        )
    done = shell(script, tmp_path, HOME=str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    smoke, alike = (json.loads((folder / f"runs/{name}/summary.json").read_text()) for name in ("smoke", "one-process"))
    assert smoke["digest"] == alike["digest"]
    study = folder / "studies" / "scout"
    assert pd.read_csv(study / "claims.csv")["verdict"].notna().all()
    contrasts = pd.read_csv(study / "contrasts.csv").query("within == 'scout' and metric == 'messages'")
    assert (contrasts["estimate"] == 1).all(), "scouts do not use their radio"
    for end in ("png", "svg", "pdf"):
        assert (study / "figures" / f"messages.{end}").exists()


def test_the_files_of_the_tutorial_are_there() -> None:
    """The figure and the controller that the page shows, and nothing to save that it does not."""
    assert list(files(PAGE)) == ["scout.toml"]
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (ROOT / "docs" / target).exists(), target
    code = (ROOT / "docs" / "controllers" / "scout.py").read_text()
    assert len([line for line in code.splitlines() if line.strip()]) <= 35, "the page promises about 30 lines"
