"""The board's wheel: an agent in an environment with nothing but Zenoh and msgpack joins a world over TCP."""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from deltaswarm_orchestrator import results
from deltaswarm_orchestrator.launch import Swarm
from deltaswarm_orchestrator.observer import Observer
from deltaswarm_orchestrator.scenario import load_scenario, to_toml
from deltaswarm_wire.keys import WORLD
from deltaswarm_wire.session import PASSWORD_VARIABLE
from tests.swarms import PATIENCE_S, run, wait_until

pytestmark = pytest.mark.processes

ROOT = Path(__file__).parents[1]


def board(folder: Path) -> Path:
    """The Python of a fresh environment that has the board's wheel and what it asks for."""
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder / "dist"), str(ROOT / "agent")],
        check=True,
    )
    venv.create(folder / "board", with_pip=True)
    python = folder / "board" / "bin" / "python"
    wheels = [str(wheel) for wheel in (folder / "dist").glob("*.whl")]
    subprocess.run([str(python), "-m", "pip", "install", "-q", *wheels], check=True)
    return python


def test_an_agent_from_the_wheel_joins_a_world_over_tcp(tmp_path: Path) -> None:
    """One of six agents runs from the wheel, over the ordinary transport; the digest is the usual one."""
    python = board(tmp_path)
    listed = subprocess.run(
        [str(python), "-m", "pip", "list", "--format=freeze"], capture_output=True, text=True, check=True
    )
    installed = {line.split("==")[0].lower() for line in listed.stdout.splitlines()} - {"pip", "setuptools"}
    assert installed == {"deltaswarm-agent", "eclipse-zenoh", "msgpack"}

    scenario = load_scenario("smoke", ["record=off", "run.duration_s=100"])
    (tmp_path / "scenario.toml").write_text(to_toml(scenario))
    with Swarm(scenario, "board", tmp_path) as swarm:
        swarm.start_world(tmp_path / "scenario.toml", listen="tcp/127.0.0.1:0", record=False)
        with Observer("board", swarm.recorder_link(), None, wire=False) as observer:
            swarm.start_operator(publish_all=False)
            swarm.start_agents(range(5))
            command = [str(python), "-m", "deltaswarm_agent", "--id", "5", "--run", "board"]
            command += ["--connect", swarm.endpoint, "--settings", str(tmp_path / "agents" / "5.toml")]
            environment = {**os.environ, PASSWORD_VARIABLE: swarm.password("agent-5")}
            with subprocess.Popen(command, env=environment, cwd=tmp_path) as agent:

                def has_ended() -> bool:
                    observer.work(0.01)
                    observer.leave_when_done()
                    return swarm.part(WORLD).exit_code is not None

                wait_until(has_ended, "the end of the run")
                assert agent.wait(PATIENCE_S) == 0
            assert not swarm.join(5)
    outcome = results.read_outcome(tmp_path)
    summary = results.summary(outcome, scenario)
    assert summary["valid"], summary["invalid_because"]
    inside = run(tmp_path / "inside", "--in-process", "--record", "off", "--set", "run.duration_s=100")
    assert summary["digest"] == inside["digest"]
