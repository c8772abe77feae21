"""The page on testing a controller: its commands, snippets and template work."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from deltaswarm.testing import percept
from deltaswarm_cli.main import main
from tests.support.pages import ROOT, shell

PAGE = (ROOT / "docs" / "TESTING.md").read_text()


CALM = """
from hypothesis import HealthCheck, settings

settings.register_profile("calm", deadline=None, suppress_health_check=list(HealthCheck), max_examples=20)
settings.load_profile("calm")
"""
"""What a machine that does much else needs."""


def in_folder(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.processes
def test_the_template_and_the_pages_tests_pass(tmp_path: Path) -> None:
    """Those of `deltaswarm new controller` and those of the page, one after the other in one file."""
    folder = tmp_path / "my_walk"
    assert main(["new", "controller", "my_walk", "--out", str(folder)]) == 0
    snippets = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (folder / "conftest.py").write_text(CALM)
    (folder / "test_page.py").write_text("\n".join(snippets))
    done = in_folder(folder, "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist")
    assert done.returncode == 0, done.stdout
    assert "7 passed" in done.stdout


def test_the_templates_scenario_and_study_are_valid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both name the controller by its module; an own number of it is in the study."""
    folder = tmp_path / "your_walk"
    assert main(["new", "controller", "your_walk", "--out", str(folder)]) == 0
    monkeypatch.syspath_prepend(folder)
    assert main(["run", str(folder / "scenario.toml"), "--dry-run"]) == 0
    assert main(["study", str(folder / "study.toml"), "--dry-run", "--out", str(tmp_path / "study")]) == 0


MISNAMED = ["My", "a-b", "1st", "class", "json", "deltaswarm_x", "test_it", "näme", "pytest", "__init__", "_", "a__b"]


@pytest.mark.parametrize("name", [*MISNAMED, "none", "percept", "exception", "list", "match", "a" * 300])
def test_a_name_that_cannot_be_a_module_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "controller", name, "--out", str(tmp_path / "new")]) == 2
    assert "NAME must" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_folder_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "controller", "walk", "--out", str(tmp_path)]) == 2
    assert "must not exist" in capsys.readouterr().err


@pytest.mark.processes
@pytest.mark.slow
def test_the_commands_work(tmp_path: Path) -> None:
    blocks = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    script = "\n".join(blocks).replace("study.toml\n", "study.toml --repeats 2 || [ $? = 3 ]\n")
    done = shell(script, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "cumtime" in done.stdout


def test_a_percept_takes_what_it_holds() -> None:
    """Frames that were heard, as pairs or by sender: the newest of each, in sender order."""
    heard = [(2, b"x"), (7, b"y")]
    assert percept(heard=heard[::-1]).heard == percept(heard=dict(heard)).heard == heard
    assert percept().heard == []
