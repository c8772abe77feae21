"""A run with plug-ins can be read where these are not, and nothing of theirs is imported where they are."""

import json
import shutil
import sys
from pathlib import Path

import pytest

import deltaswarm
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.inspect.info import describe
from deltaswarm_orchestrator.recording.replay import write_steps
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test

MODULE = """
from dataclasses import dataclass
from deltaswarm_agent.controllers.potential import PotentialController
from deltaswarm_operator.inbox.all import All
from deltaswarm_wire.checked import key
from deltaswarm_wire.commands import CommandForm
from deltaswarm_wire.controller_metrics import ControllerMetric
from deltaswarm_world.core.air.channel.links import Diagnosis
from deltaswarm_world.core.dynamics import Points
from deltaswarm_world.core.faults.kind import Kind

@dataclass(frozen=True)
class Options:
    share: float = key(0.5, "a share", low=0, high=1)

class Fog:
    Settings, reason, meaning, holds_for_step = Options, "fog", "fog on the way", False
    of = classmethod(lambda cls, context: cls())
    def cuts(self, links, time_s):
        return links.distances_m > 20
    def explain(self, links, time_s):
        return Diagnosis("fog", False, "thin", {})

class Gust(Kind):
    Settings, lasts = Options, "duration_s is needed"

class Body(Points):
    Settings = Options

class Shown(All):
    pass

class Mine(PotentialController):
    Metrics = (ControllerMetric("asked", "percepts of an agent", per="run"),)
    Commands = (CommandForm(name="gather", help="come"),)
    def __init__(self, context):
        super().__init__(context)
        self.metrics = {"asked": 0}
    def step(self, percept):
        self.metrics["asked"] += 1
        done = tuple(command.number for command in percept.commands)
        return super().step(percept)._replace(done=done)
"""

SCENARIO = """
schema = 1
name = "colleagues"
run.duration_s = 20.0
agents.count = 4
arena = { width_m = 30.0, height_m = 30.0 }
events = { rate_hz = 0.5, density = { kind = "uniform" } }
world = { dynamics = "colleagues:Body", share = 0.1 }
radio.models."colleagues:Fog" = { share = 0.2 }
control.mode = "colleagues:Mine"
operator = { inbox = { policy = "colleagues:Shown" }, person = { policy = "none" } }
fault = [{ kind = "colleagues:Gust", at_s = 5.0, duration_s = 5.0, agents = [0], share = 0.3 }]
command = [{ at_s = 5.0, name = "gather" }]
"""

SWEEP = """
schema = 1
name = "thicker"
base = "colleagues.toml"
[sweep]
repeats = 2
prove = 0
[sweep.axes]
radio.models."colleagues:Fog".share = [0.1, 0.2]
"""

PLUGINS = ("Body", "Fog", "Mine", "Shown", "Gust")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run and a sweep that used plug-ins, which are gone now."""
    tmp_path = tmp_path_factory.mktemp("colleague")
    (tmp_path / "colleagues.toml").write_text(SCENARIO)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    with pytest.MonkeyPatch.context() as patch:
        (tmp_path / "modules").mkdir()
        (tmp_path / "modules" / "colleagues.py").write_text(MODULE)
        patch.syspath_prepend(tmp_path / "modules")
        deltaswarm.run(tmp_path / "colleagues.toml", out=tmp_path / "run", progress=False)
        deltaswarm.sweep(tmp_path / "sweep.toml", out=tmp_path / "sweep", jobs=1, progress=False)
    del sys.modules["colleagues"]
    return tmp_path


def test_a_run_is_read_without_its_plugins(folder: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder, summary, tables, recording and page; a summary that it had no time to write is computed."""
    run, sweep = str(folder / "run"), str(folder / "sweep")
    asked = describe(folder / "run")["summary"]["controller"]["asked"]
    assert asked == 20
    for where in (None, folder / "modules"):
        if where:
            monkeypatch.syspath_prepend(where)
        assert deltaswarm.open(run).summary["controller"] == {"asked": asked}
        table, page = (("--out", str(folder / f"{name}-{where is None}")) for name in ("table", "page"))
        for command in (
            ("info", run),
            ("why", run),
            ("export", run, "--format", "csv", *table),
            ("report", sweep, *page),
        ):
            assert main([*command]) == 0, capsys.readouterr().err
        write_steps(folder / "run", folder / "steps")
        assert b"gather" in (folder / "steps").read_bytes()
        assert "colleagues:Shown is not run again" in capsys.readouterr().err
    assert "colleagues" not in sys.modules


def test_a_killed_run_has_its_controllers_numbers(folder: Path, tmp_path: Path) -> None:
    """Though it wrote no summary: the manifest says which there are."""
    run = shutil.copytree(folder / "run", tmp_path / "run")
    (run / "summary.json").unlink()
    manifest = json.loads((run / "manifest.json").read_text())
    del manifest["seal"]
    (run / "manifest.json").write_text(json.dumps(manifest))
    assert deltaswarm.open(run).summary["controller"] == {"asked": 20}


@in_one_test(
    "command",
    [
        ("why", "run", "0", "1", "--at", "5"),
        ("run", "--resume", "run"),
        ("run", "run/scenario.toml"),
        ("branch", "run", "--at", "5", "--set", "radio.loss=0.1"),
        ("value", "run"),
    ],
)
def test_what_computes_again_asks_for_them(
    command: tuple[str, ...], folder: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By name, a line each, and says where Python must find them."""
    monkeypatch.chdir(folder)
    assert main([*command]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert any(f"colleagues:{name}" in line and "PYTHONPATH" in line for line in lines for name in PLUGINS), lines
    assert not any("Traceback" in line for line in lines)
