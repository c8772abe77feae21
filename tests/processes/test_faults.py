"""Faults on real processes: real signals at exact steps, the same digest as in one process, nothing left behind."""

import re
import signal
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_world.__main__ import main
from tests.support.swarms import BOUND_S, UNHURRIED, is_running, run, running, wait_until
from tests.support.tiers import first_of, in_one_test

pytestmark = pytest.mark.processes

SHORT = ("--set", "run.duration_s=80", "--set", "events.rate_hz=0.3", "--set", "control.delta=1")
TIMELINES = {
    "kill": 'kind="kill", at_s=30, agents=[1, 4]',
    "kill-the-roots": 'kind="kill", at_s=60, roots=true',
    "freeze": 'kind="freeze", at_s=20, duration_s=15, agents=[0, 2]',
    "freeze-to-the-end": 'kind="freeze", at_s=50, duration_s=1000, fraction=0.5',
    "restart": 'kind="restart", at_s=40, fraction=0.4',
    "restart-later": 'kind="restart", at_s=20, duration_s=20, agents=[0, 5]',
}


def timeline(*faults: str) -> tuple[str, str]:
    return "--set", f"fault=[{', '.join('{' + fault + '}' for fault in faults)}]"


def outside_and_inside(folder: Path, *faults: str) -> tuple[dict[str, Any], dict[str, Any], str]:
    """Summaries of the same run by processes and in one, and what the first printed; no process is left."""
    options = [*SHORT, *timeline(*faults), "--record", "off"]
    with running(folder / "outside", *options) as swarm:
        pids = wait_until(lambda: swarm.pids, "process ids")
        errors = swarm.end_well()
        assert not [name for name, pid in pids.items() if is_running(pid)]
        outside = swarm.summary()
    return outside, run(folder / "inside", "--in-process", *options), errors


@pytest.mark.parametrize("name", first_of(TIMELINES))
def test_a_fault_is_the_same_with_and_without_processes(tmp_path: Path, name: str) -> None:
    """The same targets, the same digest; a planned end is no accident and has no obituary."""
    outside, inside, errors = outside_and_inside(tmp_path, TIMELINES[name])
    assert outside["digest"] == inside["digest"]
    assert outside["faults"] == inside["faults"]
    assert outside["faults"][0]["agents"]
    assert outside["valid"]
    assert outside["agents_lost"] == []
    assert outside["agents_late"] == 0
    assert "was killed" not in errors


def test_all_faults_at_once_are_the_same_too(tmp_path: Path) -> None:
    """With those that befall bodies, and loss on the air."""
    faults = [
        *TIMELINES.values(),
        'kind="lying", at_s=5, agents=[3], phantoms=3',
        'kind="sensor-noisy", at_s=5, fraction=0.5, noise_m=0.5, miss=0.1',
        'kind="actuator-slow", at_s=5, agents=[2], factor=0.5',
        'kind="radio-dead", at_s=35, duration_s=10, fraction=0.3',
        'kind="sensor-blind", at_s=45, duration_s=10, fraction=0.3',
    ]
    outside, inside, _ = outside_and_inside(tmp_path, *faults)
    assert outside["digest"] == inside["digest"]
    assert outside["faults"] == inside["faults"]
    assert len(outside["faults"]) == len(faults)


def test_an_accident_beside_a_fault_is_told_apart(tmp_path: Path) -> None:
    """The one that nobody planned is lost and has its obituary; the planned one stands among the faults."""
    long = ("--set", "run.duration_s=300", *UNHURRIED)
    with running(tmp_path / "run", *long, *timeline('kind="kill", at_s=2, agents=[1]')) as swarm:
        wait_until(lambda: len(swarm.pids) == 8 and "agent 1 (kill)" in swarm.log("world"), "the fault")
        swarm.wait_for_steps(1)
        swarm.signal("agent 3", signal.SIGKILL)
        errors = swarm.end_without(3)
        summary = swarm.summary()
        assert summary["agents_lost"] == [3]
        assert [fault["agents"] for fault in summary["faults"]] == [[1]]
        assert re.search("agent 3 .*SIGKILL", errors)
        assert "agent 1 was killed" not in errors
        recording = read_recording(swarm.out / "recording.mcap")
        assert len(recording.step_records) == 300


def test_ctrl_c_ends_a_run_with_frozen_agents_in_order(tmp_path: Path) -> None:
    """Soon, without a complaint of the frozen ones."""
    long = ("--set", "run.duration_s=1000000", "--record", "off", *UNHURRIED)
    with running(tmp_path / "run", *long, *timeline('kind="freeze", at_s=5, duration_s=1e6, agents=[2, 3]')) as swarm:
        wait_until(lambda: len(swarm.pids) == 8 and "(stop)" in swarm.log("world"), "the freeze")
        swarm.wait_for_steps(1)
        pids = swarm.pids
        swarm.interrupt()
        code, _, errors = swarm.finish(BOUND_S)
        assert code == 130
        assert "agent" not in errors.partition("not valid")[0].rpartition("messages/s")[2]
        assert not any(map(is_running, pids.values()))


@in_one_test("override", [timeline(TIMELINES["kill"])[1], "world.dynamics=jsbsim"])
def test_a_world_without_hands_does_not_begin(override: str, tmp_path: Path) -> None:
    """Started by itself, it has nobody who could kill an agent, as a crash does: it says so, with exit code 2."""
    scenario = load_scenario("smoke", [override])
    file = tmp_path / "scenario.toml"
    file.write_text(to_toml(scenario))
    others = ["--credentials", str(tmp_path / "c"), "--out", str(tmp_path)]
    assert main(["--scenario", str(file), *others, "--run", "alone"]) == 2
