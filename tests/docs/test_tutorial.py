"""The tutorial: a stranger who follows it ends with a figure of their own data."""

import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from tests.support.pages import ROOT, blocks, files, shell

PAGE = (ROOT / "docs" / "TUTORIAL.md").read_text()
SHORTER = {"deltaswarm run smoke": "--set run.duration_s=100"}


@pytest.mark.processes
@pytest.mark.slow
def test_the_tutorial_ends_in_a_figure(tmp_path: Path) -> None:
    """Every command in order (single runs are shorter): equal digests, the own figure, and what the page says of it."""
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
    smoke, same = (json.loads((folder / f"runs/{name}/summary.json").read_text()) for name in ("smoke", "one-process"))
    assert smoke["digest"] == same["digest"]
    study = folder / "studies" / "scout"
    assert pd.read_csv(study / "claims.csv")["verdict"].notna().all()
    rows = pd.read_csv(study / "contrasts.csv").set_index(["contrast", "metric", "within"])
    alike, less = rows.loc[("loss", "messages", "scout")], rows.loc[("loss", "messages", "hybrid")]
    assert (alike["estimate"], alike["verdict"]) == (1, "alike"), "scouts do not use their radio"
    told = [(less, "{estimate:.2f} times as many"), (less, "*{verdict}* (p = {p_holm:.3f})")]
    sooner = [rows.loc[("modes", "waiting_all", f"loss={loss}")] for loss in (0.0, 0.5)]
    told += [(sooner[0], "about {estimate:.2f} times as long"), (sooner[0], "(*{verdict}*, p = {p_holm:.3f})")]
    told += [(sooner[1], "({estimate:.2f} times, p = {p_holm:.3f})")]
    for row, words in told:
        assert words.format(**row) in " ".join(PAGE.split()), words.format(**row)
    for end in ("png", "svg", "pdf"):
        assert (study / "figures" / f"messages.{end}").exists()


def test_the_files_of_the_tutorial_are_there() -> None:
    """The figure and the controller that the page shows, and nothing to save that it does not."""
    assert list(files(PAGE)) == ["scout.toml"]
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (ROOT / "docs" / target).exists(), target
    code = (ROOT / "docs" / "controllers" / "scout.py").read_text()
    assert len([line for line in code.splitlines() if line.strip()]) <= 35, "the page promises about 30 lines"
