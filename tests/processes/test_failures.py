"""The failure table of the design, row by row, with real processes and real signals."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import suppress
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator.processes import fork_server, starter
from deltaswarm_orchestrator.processes.fork_server import kill_fork_server
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.results.run_tables import read_outcome
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_wire.child import GAVE_UP
from deltaswarm_wire.keys import WORLD
from tests.support.swarms import COMMAND, PATIENCE_S, UNHURRIED, is_running, parent_of, running, wait_until
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

LONG = ("--set", "run.duration_s=1000000", *UNHURRIED)
"""A run that ends only when something makes it."""

TWELVE = ("--set", "agents.count=12")


def all_gone(pids: dict[str, int]) -> None:
    wait_until(lambda: not any(map(is_running, pids.values())), "the end of all processes")


def test_five_agents_killed_in_mid_run_are_named_and_the_others_go_on(tmp_path: Path) -> None:
    """SIGKILL of agents: the world goes on without them, and the summary says who was lost."""
    with running(tmp_path / "run", *TWELVE, "--set", "run.duration_s=300", *UNHURRIED, "--record", "off") as swarm:
        swarm.wait_until_under_way(14)
        for agent in (1, 3, 5, 7, 9):
            swarm.signal(f"agent {agent}", signal.SIGKILL)
        errors = swarm.end_without(1, 3, 5, 7, 9)
        summary = swarm.summary()
        assert sorted(summary["agents_lost"]) == [1, 3, 5, 7, 9]
        assert summary["steps"] == 300
        assert summary["complete"]
        assert {row["cause"] for row in summary["agents_failed"]} == {"killed by SIGKILL"}
        missed = sum(row["steps"] for row in summary["agents_failed"])
        counts = summary["agent_steps"]
        assert (counts["due"], counts["answered"]) == (12 * 300, 12 * 300 - missed)
        assert re.search("agent 3 .*SIGKILL", errors)


def test_a_swarm_of_which_nobody_is_left_ends(tmp_path: Path) -> None:
    """After the time in which a cut link may come back; it says so, and names agents."""
    with running(tmp_path / "run", "--set", "run.step_timeout_s=0.5", *LONG) as swarm:
        swarm.wait_until_under_way()
        for agent in range(6):
            swarm.signal(f"agent {agent}", signal.SIGKILL)
        swarm.end_without(*range(6))
        summary = swarm.summary()
    reason = "the run did not reach its last step: no agent was left: world ended the run after step "
    assert summary["invalid_because"][0].startswith(reason)
    assert (summary["complete"], summary["steps"] < 1000000) == (False, True)
    missed = sum(row["steps"] for row in summary["agents_failed"])
    assert summary["agent_steps"]["due"] == 6 * summary["steps"] == summary["agent_steps"]["answered"] + missed


def test_an_agent_that_hangs_is_left_behind_and_rejoins(tmp_path: Path) -> None:
    """SIGSTOP: the step's end does not wait for it for ever; SIGCONT: it takes part again."""
    with running(tmp_path / "run", *TWELVE, *LONG) as swarm:
        swarm.wait_until_under_way(14)
        swarm.signal("agent 4", signal.SIGSTOP)
        wait_until(lambda: "without agent 4" in swarm.log("world"), "the world to go on")
        swarm.wait_for_steps(1)
        assert "agent 4, which hung" not in swarm.log("world")
        swarm.signal("agent 4", signal.SIGCONT)
        wait_until(lambda: "agent 4, which hung, answers" in swarm.log("world"), "the agent's return")
        swarm.wait_for_steps(1)
        swarm.interrupt()
        swarm.finish()
        summary = swarm.summary()
        assert summary["agents_late"] >= 1
        [hung] = summary["agents_hung"]
        assert hung["agent"] == 4
        assert hung["steps"] == summary["agent_steps"]["due"] - summary["agent_steps"]["answered"] > 1
        assert f"agent 4 hung in step {hung['step']} " in " ".join(summary["invalid_because"])
        assert (summary["agents_lost"], summary["transport_lost"]) == ([], 0)
        assert swarm.manifest()["exit_reason"] == "stopped by SIGINT"


def steps_of_nobody(log: str, agents: int) -> int:
    """The steps from the one in which the last of so many agents hung to the one in which the first came back."""
    hanging, since = set(), -1
    for step, agent, back, back_in in re.findall(
        r"step (\d+) continues without agent (\d+)|agent (\d+), which hung, answers again in step (\d+)", log
    ):
        if agent:
            hanging.add(agent)
            since = int(step)
        elif len(hanging) == agents:
            return int(back_in) - since
        else:
            hanging.discard(back)
    raise AssertionError(f"never did all hang: {log}")


def test_when_all_agents_hang_the_world_waits_for_them(tmp_path: Path) -> None:
    """It does not race through steps in which nobody takes part; once they wake, all go on."""
    with running(tmp_path / "run", "--set", "run.step_timeout_s=1", *LONG) as swarm:
        swarm.wait_until_under_way()
        for agent in range(6):
            swarm.signal(f"agent {agent}", signal.SIGSTOP)
        for agent in range(6):
            wait_until(lambda agent=agent: f"without agent {agent}" in swarm.log("world"), f"word of agent {agent}")
        for agent in range(6):
            swarm.signal(f"agent {agent}", signal.SIGCONT)
        for agent in range(6):
            back = f"agent {agent}, which hung, answers"
            wait_until(lambda back=back: back in swarm.log("world"), back)
        swarm.wait_for_steps(1)
        assert steps_of_nobody(swarm.log("world"), 6) <= 1
        swarm.interrupt()
        swarm.finish()
        summary = swarm.summary()
        assert summary["agents_late"] >= 6
        assert (summary["agents_lost"], summary["transport_lost"]) == ([], 0)


def test_without_its_world_everything_ends(tmp_path: Path) -> None:
    """With a clear error and exit code 1; what was written is readable, marked incomplete, and says why."""
    with running(tmp_path / "run", *LONG) as swarm:
        swarm.wait_until_under_way()
        events = swarm.part / "world-events.csv"
        wait_until(lambda: events.read_text().count("\n") > 1, "an event on file")
        pids = swarm.pids
        swarm.signal("world", signal.SIGKILL)
        code, _, errors = swarm.finish()
        all_gone(pids)
        assert code == 1
        assert re.search("world .*SIGKILL", errors)
        assert not swarm.summary()["complete"]
        assert swarm.summary()["steps"] > 0
        assert swarm.manifest()["exit_reason"] == "failed"
        assert swarm.manifest()["why"] == swarm.summary()["why"]
        assert re.search("world .*SIGKILL", swarm.manifest()["why"][0])
        assert read_recording(swarm.out / "recording.mcap").step_records
        assert (swarm.out / "events.csv").read_text().count("\n") > 1


@pytest.mark.parametrize("uplink", first_of([[], ["--set", "uplink.loss=0.2", "--set", "uplink.latency_s=3"]]))
def test_an_operator_that_ends_early_is_started_again(uplink: list[str], tmp_path: Path) -> None:
    """Killed or asked to, again and again: no report is lost or counted twice, no row is missing."""
    settings = ["--set", "run.duration_s=400", *uplink]
    with running(tmp_path / "run", *settings, *UNHURRIED) as swarm:
        killed: set[int] = set()
        for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGTERM, signal.SIGKILL):
            operator = wait_until(lambda: {swarm.pids.get("operator", 0)} - killed - {0}, "a new operator").pop()
            swarm.wait_for_steps(20)
            killed.add(operator)
            os.kill(operator, number)
        swarm.end_well()
        assert swarm.manifest()["operator_restarts"] == 4
        hows = [re.search("^operator .*(killed by SIGKILL|ended by SIGTERM)", line) for line in swarm.manifest()["why"]]
        assert [how and how[1] for how in hows] == ["killed by SIGKILL", *2 * ["ended by SIGTERM"], "killed by SIGKILL"]
        kept = read_outcome(swarm.out)
        recorded = read_recording(swarm.out / "recording.mcap")
        digest = swarm.summary()["digest"]
    overrides = [text for text in settings if text != "--set"]
    undisturbed = run_in_process(load_scenario("smoke", overrides))
    assert digest == undisturbed.digest
    for workloads in (kept.workloads, recorded.workloads):
        assert [w._replace(backlog=0) for w in workloads] == [w._replace(backlog=0) for w in undisturbed.workloads]
    assert [len(reports) for reports in recorded.reports.values()] == [w.messages for w in undisturbed.workloads]


def test_an_operator_that_dies_each_time_ends_the_run(tmp_path: Path) -> None:
    """It cannot save what it counts: after some tries everything ends, exit code 1, and the run says why."""
    with running(tmp_path / "run", *LONG) as swarm:
        swarm.wait_until_under_way()
        in_the_way = swarm.part / "operator-state.json.part"

        def made() -> bool:
            with suppress(FileExistsError):  # while the operator writes, the name is its own
                in_the_way.mkdir()
            return in_the_way.is_dir()

        wait_until(made, "a folder where the operator writes")
        pids = swarm.pids
        code, _, _ = swarm.finish()
        all_gone(pids)
        assert code == 1
        assert swarm.manifest()["exit_reason"] == "failed"
        assert any(re.search("operator .*exit code 1", line) for line in swarm.manifest()["why"])


def info(folder: Path) -> dict[str, Any]:
    told = subprocess.run([*COMMAND, "info", "--json", str(folder)], capture_output=True, text=True, check=True)
    return dict(json.loads(told.stdout))


@pytest.mark.parametrize("fork_server_too", first_of([True, False]))
def test_no_orphan_survives_the_orchestrator(
    fork_server_too: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGKILL of the orchestrator: all others end, the recording can be read, nothing else is left."""
    temporary = tempfile.TemporaryDirectory()  # a short path: there are sockets in it
    monkeypatch.setenv("TMPDIR", temporary.name)
    with temporary, running(tmp_path / "run", *LONG) as swarm:
        swarm.wait_until_under_way()
        recording = swarm.part / "recording.mcap.part"
        wait_until(lambda: read_recording(recording).step_records, "steps in the recording")
        pids = swarm.pids
        assert info(swarm.part)["state"] == "running"
        if fork_server_too:
            os.kill(parent_of(pids["world"]), signal.SIGKILL)
        os.kill(swarm.process.pid, signal.SIGKILL)
        all_gone(pids)
        assert not list(Path(temporary.name).rglob("credentials"))
        wait_until(lambda: not os.listdir(temporary.name), "an empty folder for temporary files")
        found = read_recording(recording)
        assert found.step_records
        assert not found.complete
        told = info(swarm.part)
        assert told["state"].startswith("incomplete (killed")
        assert told["summary"]["complete"] is False
        assert told["summary"]["steps"] > 0


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM, signal.SIGHUP]))
def test_a_signal_ends_the_run_in_order(tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C, SIGTERM, a closed terminal: all end, and the recording is closed and whole."""
    with running(tmp_path / "run", *LONG) as swarm:
        swarm.wait_until_under_way()
        pids = swarm.pids
        swarm.interrupt(number)
        code, _, errors = swarm.finish()
        all_gone(pids)
        assert code == 130
        assert "not valid" in errors
        assert swarm.manifest()["exit_reason"] == f"stopped by {number.name}"
        recording = read_recording(swarm.out / "recording.mcap")
        assert len(recording.step_records) == swarm.summary()["steps"] > 0
        assert swarm.summary()["transport_lost"] == 0


def test_a_run_by_nohup_outlives_its_terminal(tmp_path: Path) -> None:
    """SIGHUP to all of its processes changes nothing; SIGTERM still ends it."""
    with running(tmp_path / "run", *LONG, inside=["nohup"]) as swarm:
        swarm.wait_until_under_way()
        pids = swarm.pids
        os.killpg(swarm.process.pid, signal.SIGHUP)
        swarm.wait_for_steps(20)
        assert swarm.pids == pids
        swarm.interrupt(signal.SIGTERM)
        swarm.finish()
        assert swarm.manifest()["exit_reason"] == "stopped by SIGTERM"


def test_a_signal_is_heard_as_soon_as_the_world_listens(tmp_path: Path) -> None:
    """It ends without waiting for agents that nobody starts."""
    scenario = load_scenario("smoke", ["run.start_timeout_s=3600"])
    (tmp_path / "scenario.toml").write_text(to_toml(scenario))
    files = ["--scenario", "scenario.toml", "--out", "out", "--credentials", "credentials"]
    command = [sys.executable, "-m", "deltaswarm_world", *files, "--run", "brief", "--listen", "tcp/127.0.0.1:0"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE) as world:
        try:
            assert world.stdout is not None
            assert world.stdout.readline().startswith(b"tcp/127.0.0.1:")
            world.terminate()
            assert world.wait(PATIENCE_S) == 128 + signal.SIGTERM
        finally:
            world.kill()


def test_a_part_that_does_not_come_up_is_named(tmp_path: Path) -> None:
    """The world does not wait for ever: it says for whom it waited, and ends."""
    scenario = load_scenario("smoke", ["run.start_timeout_s=10", "record=off"])
    (tmp_path / "scenario.toml").write_text(to_toml(scenario))
    with Swarm(scenario, "incomplete", tmp_path) as swarm:
        swarm.start_world("tcp/127.0.0.1:0")
        with Observer("incomplete", swarm.recorder_link(), None, wire=False):
            swarm.start_operator(publish_all=False)
            swarm.start_agents([0, 1, 2, 4])
            wait_until(lambda: swarm.part(WORLD).exit_code is not None, "the world's end")
        assert swarm.part(WORLD).exit_code == GAVE_UP
        said = swarm.part(WORLD).how_it_ended()
        assert " 10 s (missing: " in said
        assert {"agent 3", "agent 5"} <= set(said.partition("missing: ")[2].partition(")")[0].split(", "))
        pids = {part.name: part.pid for part in swarm.parts}
    all_gone(pids)


def test_a_killed_fork_server_is_dead_before_a_process_is_started() -> None:
    """One that is still dying would be asked for the next process."""
    for _ in range(5):
        forkserver.ensure_running()
        pid = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
        kill_fork_server()
        assert os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def test_slow_imports_are_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They do not count as time to come up: the fork server is not killed while it is at them."""
    (tmp_path / "slow_to_import.py").write_text("import time\ntime.sleep(2)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(starter, "PRELOADED", ["slow_to_import", *starter.PRELOADED])
    monkeypatch.setattr(starter, "PYTHON_S", PATIENCE_S)
    kill_fork_server()
    scenario = load_scenario("smoke", ["run.start_timeout_s=1", "record=off"])
    (tmp_path / "scenario.toml").write_text(to_toml(scenario))
    with Swarm(scenario, "slow", tmp_path) as swarm:
        swarm.start_world("tcp/127.0.0.1:0")
        assert swarm.endpoints


def test_an_address_that_is_taken_is_refused(tmp_path: Path) -> None:
    """A port that is taken: exit code 2, the reason, and no run."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with running(tmp_path / "run", "--listen", endpoint) as swarm:
            code, _, errors = swarm.finish()
    assert code == 2
    assert "--listen" in errors
    assert endpoint.partition("/")[2] in errors


def test_a_python_whose_fork_server_cannot_be_controlled_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The private names by which no process outlives a run are there, and no run starts without one of them."""
    scenario = load_scenario("smoke")
    with Swarm(scenario, "run", tmp_path / "well"):
        pass
    monkeypatch.setattr(fork_server, "PRIVATE_NAMES", (*fork_server.PRIVATE_NAMES, "_renamed"))
    with pytest.raises(starter.LaunchError, match="_renamed"), Swarm(scenario, "run", tmp_path / "ill"):
        pass
