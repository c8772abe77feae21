"""The board's wheel: an agent in an environment with nothing but Zenoh and msgpack joins a world over TCP."""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from deltaswarm_orchestrator.processes.process import wait_for
from deltaswarm_orchestrator.results.run_tables import read_outcome
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.session import PASSWORD_VARIABLE
from tests.support.swarms import PATIENCE_S, run, started, wait_for_end

pytestmark = [pytest.mark.slow, pytest.mark.processes]

ROOT = Path(__file__).parents[2]


def board(folder: Path) -> Path:
    """The Python of a fresh environment that has the board's wheel and what it asks for."""
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder / "dist"), str(ROOT / "agent")],
        check=True,
    )
    venv.create(folder / "board", with_pip=False)
    python = folder / "board" / "bin" / "python"
    wheels = [str(wheel) for wheel in (folder / "dist").glob("*.whl")]
    subprocess.run([*pip_for(python), "install", "-q", *wheels], check=True)
    return python


def pip_for(python: Path) -> list[str]:
    """The command of this environment's pip, for another one: to put a pip into it would take longer than all else."""
    return [sys.executable, "-m", "pip", "--python", str(python)]


def test_an_agent_from_the_wheel_joins_a_world_over_tcp(tmp_path: Path) -> None:
    """One of six agents runs from the wheel, over the ordinary transport; the digest is the usual one."""
    python = board(tmp_path)
    listed = subprocess.run([*pip_for(python), "list", "--format=freeze"], capture_output=True, text=True, check=True)
    installed = {line.split("==")[0].lower() for line in listed.stdout.splitlines()}
    assert installed == {"deltaswarm-agent", "eclipse-zenoh", "msgpack"}

    scenario = load_scenario("smoke", ["record=off", "run.duration_s=100"])
    with started(scenario, "board", tmp_path, range(5)) as (swarm, observer):
        command = [str(python), "-m", "deltaswarm_agent", "--id", "5", "--run", "board"]
        command += ["--connect", swarm.endpoint, "--settings", str(tmp_path / "agents" / "5.toml")]
        environment = {**os.environ, PASSWORD_VARIABLE: swarm.password("agent-5")}
        with subprocess.Popen(command, env=environment, cwd=tmp_path) as agent:
            wait_for_end(swarm, observer)
            assert agent.wait(PATIENCE_S) == 0
        assert not wait_for(swarm.parts, 5)
    outcome = read_outcome(tmp_path)
    summary = summarise(outcome, scenario)
    assert summary["valid"], summary["invalid_because"]
    inside = run(tmp_path / "inside", "--in-process", "--record", "off", "--set", "run.duration_s=100")
    assert summary["digest"] == inside["digest"]
