"""The commands of docs/STATION.md work as written (with a short run)."""

import tomllib
from pathlib import Path

import pytest

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.page_language import page_texts
from tests.support.pages import ROOT, commands, files, serve, shell

PAGE = (ROOT / "docs/STATION.md").read_text()
SHORT = "--set run.duration_s=20 --set agents.count=6"


@pytest.mark.processes
@pytest.mark.slow
def test_a_run_with_a_station_is_scripted_and_replayed(tmp_path: Path) -> None:
    """In the order in which the commands stand; the script's commands leave the base again when they did."""
    station, scripted, replay, *_ = commands(PAGE)
    scripted = scripted.replace("docs/station", str(ROOT / "docs/station"))
    done = shell(f"{station} {SHORT}; {scripted}", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "http://127.0.0.1:" in done.stderr
    for name in ("actions.csv", "probes.csv"):
        assert (tmp_path / "runs/station" / name).exists()
    given, left = (
        tomllib.loads(file.read_text())["command"]
        for file in (ROOT / "docs/station/commands.toml", tmp_path / "runs/scripted/commands.toml")
    )
    assert [(command["at_s"], command["name"]) for command in left] == [(c["at_s"], c["name"]) for c in given]
    serve(replay, tmp_path)


def test_the_translation_of_the_page_is_one(tmp_path: Path) -> None:
    """A scenario takes it, and the command completes it with all texts that are not translated yet."""
    for name, text in files(PAGE).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    given = load_scenario("smoke", [f"operator.page.language={tmp_path / 'fr.toml'}"]).operator.page.language
    done = shell(commands(PAGE)[-1], tmp_path)
    assert done.returncode == 0, done.stderr
    table = tomllib.loads((tmp_path / "all.toml").read_text(encoding="utf-8"))
    assert list(table["page"]) == list(page_texts())
    assert {text: said for text, said in table["page"].items() if said} == given.page
