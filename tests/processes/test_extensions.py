"""A radio model and a fault from a folder outside the package, from the command line to the tables."""

import csv
import json
import os
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.recording.reader import read_recording
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test
from tests.support.weather import put_weather

pytestmark = pytest.mark.processes

SCENARIO = """
schema = 1
name = "weather"
[run]
duration_s = 90.0
[arena]
width_m = 40.0
height_m = 40.0
[events]
rate_hz = 0.2
[events.density]
kind = "uniform"
[agents]
count = 6
[radio]
range_m = 60.0
[radio.models.fog]
density = 0.01
[[fault]]
kind = "wind"
at_s = 20.0
duration_s = 30.0
fraction = 0.5
speed_mps = 0.5
"""

SWEEP = """
schema = 1
name = "thicker"
base = "weather.toml"
[sweep]
repeats = 1
prove = 1
series_every_s = 30.0
[sweep.axes]
radio.models.fog.density = [0.0, 0.05]
"""


def test_in_one_process_and_by_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    """One digest; their own columns in table, summary and recording; `why` asks the model; a sweep varies it."""
    put_weather(tmp_path, monkeypatch)
    (tmp_path / "weather.toml").write_text(SCENARIO)
    folders = [tmp_path / name for name in ("in-process", "processes")]
    for folder, more in zip(folders, (["--in-process"], []), strict=True):
        own = ["--set", "radio.models.fog.density=0.02", "-q", "--out", str(folder)]
        assert main(["run", str(tmp_path / "weather.toml"), *own, *more]) == 0
    alone, apart = (json.loads((folder / "summary.json").read_text()) for folder in folders)
    assert alone["digest"] == apart["digest"]
    assert apart["valid"]
    assert alone["frames_dropped"] == apart["frames_dropped"]
    assert [fault["kind"] for fault in apart["faults"]] == ["wind"]

    with (folders[1] / "series.csv").open() as file:
        rows = list(csv.DictReader(file))
    dropped = [int(row["dropped_fog"]) for row in rows]
    assert sum(dropped) == apart["frames_dropped"]["fog"] > 0
    assert [record.frames_dropped["fog"] for record in read_recording(folders[1]).step_records] == dropped
    manifest = json.loads((folders[1] / "manifest.json").read_text())
    assert [(source["what"], source["name"]) for source in manifest["extensions"]] == [
        ("radio model", "fog"),
        ("fault", "wind"),
    ]

    capsys.readouterr()
    assert main(["why", str(folders[1]), "0", "1", "--at", "40", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert "fog" in [finding["reason"] for finding in answer["findings"]]
    assert answer["differs_from_step"] is None

    (tmp_path / "sweep.toml").write_text(SWEEP)
    swept = tmp_path / "sweep"
    assert main(["sweep", str(tmp_path / "sweep.toml"), "-q", "--jobs", "1", "--out", str(swept)]) == 0
    with (swept / "table.csv").open() as file:
        table = {row["radio.models.fog.density"]: row for row in csv.DictReader(file)}
    assert int(table["0.0"]["frames_dropped.fog"]) == 0 < int(table["0.05"]["frames_dropped.fog"])


WRONG = """
import numpy as np
from deltaswarm_operator.inbox.all import All
from deltaswarm_world.core.faults.kind import Kind

class Gust(Kind):
    def drive(self, velocities_mps):
        velocities_mps[:] = np.nan

class Moody(All):
    def close_step(self, now_s, items):
        raise RuntimeError("not today")
"""


@in_one_test(
    ("key", "part", "said"),
    [
        ('fault=[{kind="wrong:Gust", at_s=2, agents=[0]}]', "world", "Gust.drive must leave velocities"),
        ('operator.inbox.policy="wrong:Moody"', "operator", "Moody.close_step failed: RuntimeError: not today"),
    ],
)
def test_what_they_do_wrong_ends_their_process(
    key: str, part: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """At once, without a restart, and the run says in one line which part, class, file and line; no agent hangs."""
    (tmp_path / "wrong.py").write_text(WRONG)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    more = ["--set", key, "--set", "operator.person.policy=none", "--record", "off", "--json", "--force"]
    assert main(["run", "smoke", "-q", *more, "--out", str(tmp_path / "run")]) == 1
    why = json.loads(capsys.readouterr().out)["why"]
    [line] = [line for line in why if line.startswith(f"{part} ended")]
    assert f"wrong:{said}" in line
    assert f"({tmp_path / 'wrong.py'}:" in line
    assert not any("hung" in line or "Traceback" in line for line in why)
    assert main(["run", "smoke", "-q", *more, "--in-process", "--out", str(tmp_path / "run")]) == 1
    assert f"wrong:{said}" in json.loads(capsys.readouterr().out)["invalid_because"][0]
