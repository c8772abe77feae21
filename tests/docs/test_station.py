"""The commands of docs/STATION.md work as written (with a short run)."""

import tomllib
from pathlib import Path

import pytest

from tests.support.pages import ROOT, commands, serve, shell

PAGE = (ROOT / "docs/STATION.md").read_text()
SHORT = "--set run.duration_s=20 --set agents.count=6"


@pytest.mark.processes
@pytest.mark.slow
def test_a_run_with_a_station_is_scripted_and_replayed(tmp_path: Path) -> None:
    """In the order in which the commands stand; the script's commands leave the base again when they did."""
    station, scripted, replay = commands(PAGE)
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
