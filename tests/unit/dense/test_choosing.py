"""Which engine does a run in one process, and that results say so."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_dense.layout import MAX_ORDERS
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.processes.elsewhere import DENSE, PYTHON
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_orchestrator.run import choosing
from deltaswarm_orchestrator.run.choosing import planned_by
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.scenarios.load import load_scenario
from tests.support.complaints import Printed
from tests.support.tiers import in_one_test

LONG = "run.duration_s=900"


@in_one_test(
    ("sets", "because"),
    [
        ([LONG], ""),
        (["run.duration_s=100"], "the run is too short to be worth loading it"),
        ([LONG, "radio.loss=0.1"], ""),
        ([LONG, "downlink.latency_s=0.1"], "downlink.latency_s = 0.1"),
        ([LONG, "control.mode=potential"], "control.mode = 'potential'"),
        ([LONG, "world.dynamics=physics"], "world.dynamics = 'physics'"),
        ([LONG, "run.bound=density"], "run.bound = 'density'"),
    ],
)
def test_the_dense_engine_does_what_it_covers(sets: list[str], because: str) -> None:
    """Otherwise the reason is that of the first key, with its value."""
    by = planned_by(load_scenario("paper-25", sets))
    assert by.engine == (PYTHON if because else DENSE)
    assert by.because.startswith(because)


def test_an_inbox_policy_of_ones_own_needs_the_python_engine() -> None:
    """Which reports its errors with the run that there is until then."""
    scenario = load_scenario("paper-25", [LONG])
    inbox = replace(scenario.operator.inbox, policy="mine:Policy")
    own = replace(scenario, operator=replace(scenario.operator, inbox=inbox))
    assert planned_by(own).because == "operator.inbox.policy = 'mine:Policy'"


def test_a_recording_and_a_state_need_the_python_engine() -> None:
    class Recorder(Sink):
        pass

    scenario = load_scenario("paper-25", [LONG])
    assert "recording" in planned_by(scenario, Wanted(Recorder())).because  # type: ignore[abstract]
    assert "state" in planned_by(scenario, has_state=True).because


def test_each_engine_can_be_insisted_on() -> None:
    """The dense one also for a short run, but not for what it does not cover."""
    short = load_scenario("smoke", [])
    assert planned_by(short, asked=DENSE).engine == DENSE
    assert planned_by(load_scenario("paper-25", [LONG]), asked=PYTHON).engine == PYTHON
    with pytest.raises(CommandError, match=r"downlink\.jitter_s = 0\.1"):
        planned_by(load_scenario("smoke", ["downlink.jitter_s=0.1"]), asked=DENSE)


def test_without_numba_the_python_engine_does_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choosing, "missing", lambda *modules: f"needs {modules[0]}")
    assert planned_by(load_scenario("paper-25", [LONG])).told == {"by": PYTHON, "because": "it needs numba"}


def test_a_run_that_turns_out_to_need_more_is_begun_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the Python engine, with the reason."""
    monkeypatch.setattr("deltaswarm_dense.operating.MAX_ORDERS", 0)
    scenario = load_scenario(
        "smoke", ['command=[{at_s=5, name="set delta", arguments={delta=2}}]', "run.duration_s=60"]
    )
    outcome, by = choosing.run_here(scenario)
    with pytest.raises(CommandError, match="more than 0 orders"):
        choosing.run_here(scenario, asked=DENSE)
    assert (by.engine, outcome.is_complete, MAX_ORDERS) == (PYTHON, True, 4096)


def test_results_say_which_engine_made_them(tmp_path: Path, capsys: Printed) -> None:
    """A run's manifest, and each run of a sweep; with equal digests."""
    command = ["run", "smoke", "--in-process", "--record", "off", "--quiet", "--json"]
    digests = set()
    for engine in (DENSE, PYTHON):
        out = tmp_path / engine
        assert main([*command, "--engine", engine, "--out", str(out)]) == 0
        manifest = json.loads((out / "manifest.json").read_text())
        assert manifest["in_process"]["by"] == engine
        digests.add(manifest["digest"])
    assert len(digests) == 1
    capsys.readouterr()
    assert main(["run", "smoke", "--engine", DENSE, "--out", str(tmp_path / "other")]) == 2
    assert "--engine dense must be given with --in-process" in capsys.readouterr().err
    assert main([*command, "--engine", DENSE, "--set", "downlink.jitter_s=0.1", "--out", str(tmp_path / "lossy")]) == 2
    assert "--engine dense cannot do this run: downlink.jitter_s = 0.1" in capsys.readouterr().err
    for more in (["--record", "views"], ["--debug"], ["--live", "foxglove", "--live-port", "0"]):
        assert main([*command, "--engine", DENSE, *more, "--out", str(tmp_path / "shown")]) == 2
        assert capsys.readouterr().err.startswith("deltaswarm: --engine dense must be given with")
    assert not (tmp_path / "shown").exists()


def test_a_sweep_counts_the_runs_of_each_engine(tmp_path: Path) -> None:
    """In its manifest; the tables are the same whichever did them."""
    file, tables = tmp_path / "sweep.toml", []
    file.write_text(
        'schema = 1\nname = "two"\nbase = "smoke"\n[sweep]\nrepeats = 2\nprove = 0\naxes = {control.delta = [2, 3]}\n'
    )
    for engine in (DENSE, PYTHON):
        out = tmp_path / engine
        assert main(["sweep", str(file), "--engine", engine, "--jobs", "1", "--quiet", "--out", str(out)]) == 0
        assert json.loads((out / "manifest.json").read_text())["engines"] == {engine: 4}
        tables.append((out / "table.csv").read_bytes())
    assert tables[0] == tables[1]
