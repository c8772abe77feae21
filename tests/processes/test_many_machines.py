"""A run over many machines: a Dask scheduler and two workers here, each worker with agents of its own."""

import asyncio
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from distributed import Client

import deltaswarm_wire
from deltaswarm_cluster import dask_cluster as dask_cluster_module
from deltaswarm_cluster.host import HostActor, Job
from deltaswarm_cluster.plan import Worker
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import plain
from tests.support.dask_clusters import Cluster, dask_cluster, nothing_is_left
from tests.support.pages import ROOT
from tests.support.swarms import BOUND_S, PATIENCE_S, UNHURRIED, RunningSwarm, run, running, told, wait_until
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

SHORT = ("--set", "run.duration_s=60")
LONG = ("--set", "run.duration_s=1000000")
"""A run that a test ends once it has seen what it is about."""


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """Two workers whose temporary files are in a folder of their own."""
    (tmp_path / "temporary").mkdir()
    path = f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"  # for `UNHURRIED`
    with dask_cluster(tmp_path / "cluster") as made:
        for _ in range(2):
            made.add_worker(TMPDIR=str(tmp_path / "temporary"), PYTHONPATH=path)
        yield made


@contextmanager
def on(cluster: Cluster, out: Path, *arguments: str) -> Iterator[RunningSwarm]:
    with running(out, "--engine", "dask", "--scheduler", cluster.address, *arguments) as swarm:
        yield swarm


def test_a_run_on_a_cluster_has_the_digest_of_one_process(cluster: Cluster, tmp_path: Path) -> None:
    """Its agents are divided in order, their logs are here, and nothing is left on the workers."""
    with on(cluster, tmp_path / "run", *SHORT) as swarm:
        swarm.end_well()
    nothing_is_left(cluster, tmp_path)
    inside = run(tmp_path / "inside", *SHORT, "--in-process")
    summary, manifest = swarm.summary(), swarm.manifest()
    assert (summary["digest"], summary["valid"], summary["why"]) == (inside["digest"], True, [])
    assert manifest["engine"] == "dask"
    assert [name.split()[0] for name in manifest["workers"]] == ["w0", "w1"]
    assert [*manifest["workers"].values()] == [[0, 1, 2], [3, 4, 5]]
    for agent in range(6):
        assert f"agent {agent} exits after step 59" in swarm.log("agent", agent)


def test_a_killed_worker_costs_its_agents_alone(cluster: Cluster, tmp_path: Path) -> None:
    """The others do all steps, the line names worker and agents, and an agent that is killed has a line of its own."""
    with on(cluster, tmp_path / "run", "--set", "run.duration_s=300", *UNHURRIED, "--record", "off") as swarm:
        swarm.wait_for_steps(20)
        secrets = list((tmp_path / "temporary").glob("*/*.key"))
        assert sorted(key.name for key in secrets) == [f"{agent}.key" for agent in range(6)]
        assert {key.stat().st_mode & 0o777 for key in secrets} == {0o600}
        assert {key.parent.stat().st_mode & 0o777 for key in secrets} == {0o700}
        os.kill(pid_of_agent(cluster, 4), signal.SIGKILL)
        swarm.wait_for_steps(20)
        cluster.workers[0].kill()
        swarm.end_without(0, 1, 2, 4)
    nothing_is_left(cluster, tmp_path)
    summary = swarm.summary()
    assert (summary["complete"], summary["steps"], sorted(summary["agents_lost"])) == (True, 300, [0, 1, 2, 4])
    killed, lost = sorted(summary["why"])
    assert re.fullmatch(r"the Dask worker w0 at tcp://\S+ was lost after step \d+ with agents 0-2", lost)
    assert re.fullmatch(r"agent 4 was killed by SIGKILL in step \d+", killed)
    causes = {row["agent"]: row["cause"] for row in summary["agents_failed"]}
    assert causes[4] == "killed by SIGKILL"
    assert causes[0].startswith("lost with the Dask worker w0 at ")
    assert swarm.manifest()["why"] == summary["why"]


def pid_of_agent(cluster: Cluster, agent: int) -> int:
    """The process on a worker whose standard error is an agent's log."""
    [pid] = [pid for pid in cluster.agents() if os.readlink(f"/proc/{pid}/fd/2").endswith(f"/agent-{agent}.log")]
    return pid


@pytest.mark.parametrize("number", first_of([signal.SIGKILL, signal.SIGINT]))
def test_agents_on_workers_end_with_the_command(number: signal.Signals, cluster: Cluster, tmp_path: Path) -> None:
    """However it ends; the workers stay."""
    with on(cluster, tmp_path / "run", *LONG, "--record", "off") as swarm:
        swarm.wait_for_steps(5)
        swarm.process.send_signal(number)
        code, _, errors = swarm.finish(BOUND_S)
        assert code == (130 if number == signal.SIGINT else -9), errors
        assert "Traceback" not in errors
        nothing_is_left(cluster, tmp_path)
    assert [worker.poll() for worker in cluster.workers] == [None, None]
    if number == signal.SIGINT:
        assert swarm.summary()["agents_lost"] == []
        assert "exits after step" in swarm.log("agent", 5)


@pytest.mark.slow
def test_a_command_that_is_killed_while_agents_start_leaves_none(cluster: Cluster, tmp_path: Path) -> None:
    """Neither processes nor their keys: before the first step, too."""
    with on(cluster, tmp_path / "run", *LONG) as swarm:
        wait_until(cluster.agents, "the first process on a worker")
        swarm.process.kill()
        nothing_is_left(cluster, tmp_path)


@pytest.mark.slow
def test_a_busy_worker_can_be_given_up(cluster: Cluster, tmp_path: Path) -> None:
    """By Ctrl-C, while its agents wait to be started; those of the other worker end, and nothing is left of them."""
    with Client(cluster.address) as client:
        busy = next(address for address, name in names_of(client).items() if name == "w0")
        sleeping = client.submit(time.sleep, PATIENCE_S, workers=[busy])
        with on(cluster, tmp_path / "run", *LONG) as swarm:
            wait_until(cluster.agents, "the agents of the other worker")
            swarm.interrupt()
            code, _, errors = swarm.finish(BOUND_S)
        assert (code, "Traceback" in errors) == (130, False), errors
        sleeping.cancel()
    nothing_is_left(cluster, tmp_path)


def names_of(client: Client) -> dict[str, str]:
    return {address: worker["name"] for address, worker in client.scheduler_info()["workers"].items()}


def test_without_its_scheduler_a_run_ends(cluster: Cluster, tmp_path: Path) -> None:
    """In one line; Dask's workers end without it, and so do their agents."""
    with on(cluster, tmp_path / "run", *LONG, "--record", "off") as swarm:
        swarm.wait_for_steps(5)
        cluster.scheduler.kill()
        code, _, errors = swarm.finish(BOUND_S)
    assert code == 1
    assert "Traceback" not in errors
    [why] = swarm.summary()["why"]
    assert re.fullmatch(rf"the Dask scheduler was lost after step \d+ .* {cluster.address}", why)
    nothing_is_left(cluster, tmp_path)


@pytest.mark.slow
def test_what_a_cluster_cannot_do_is_refused_before_anything_starts(tmp_path: Path) -> None:
    """No scheduler, no workers, an address that is not this machine's: a line each, and no folder."""

    def refused(scheduler: str, *more: str) -> str:
        run = ("run", "smoke", "--out", str(tmp_path / "run"), "--engine", "dask", "--scheduler", scheduler, *more)
        done = told(*run)
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        return line

    with dask_cluster(tmp_path / "cluster") as cluster:
        assert "no Dask scheduler could be reached at tcp://127.0.0.1:9" in refused("tcp://127.0.0.1:9")
        assert "tls://127.0.0.1:9" in refused("tls://127.0.0.1:9")
        assert "must have at least one worker" in refused(cluster.address)
        cluster.add_worker()
        elsewhere = refused(cluster.address, "--listen", "tls/192.0.2.1:0")
        assert "--listen must be an address of this machine" in elsewhere
    assert not list(tmp_path.glob("run*"))


def job_of_mute_agents(connect: str) -> Job:
    """Two agents that reach nobody."""
    settings = tomli_w.dumps(plain(load_scenario("smoke").for_agent(3)))
    options = {"--run": "run", "--connect": connect, "--zenoh": []}
    return Job("hybrid", 60.0, options, "", [(agent, settings, "", "SECRET") for agent in (3, 4)])


def test_a_killed_host_leaves_no_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The worker notices, removes the files, and says so; the agents end with their parent."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        actor = HostActor(job_of_mute_agents(f"tls/127.0.0.1:{mute.getsockname()[1]}"))
        wait_until(lambda: len(list(tmp_path.glob("*/logs/*.log"))) == 2, "the agents")
        os.kill(actor.pid, signal.SIGKILL)
        why = wait_until(lambda: [item for item in actor.poll() if item[0] == "failed"], "the news")
    assert why == [["failed", "its process ended with code -9"]]
    wait_until(lambda: not list(tmp_path.iterdir()), "no more files")


ACTOR = """
import sys, time
from deltaswarm_cluster.host import HostActor
from tests.processes.test_many_machines import job_of_mute_agents
actor = HostActor(job_of_mute_agents(sys.argv[1]))
print(actor.pid, flush=True)
time.sleep(600)
"""


@contextmanager
def an_actor(folder: Path, agents: int = 2) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    """The process of a worker whose agents are up, and its host's number."""
    environment = {**os.environ, "TMPDIR": str(folder), "PYTHONPATH": str(ROOT)}
    with socket.create_server(("127.0.0.1", 0)) as mute:
        command = [sys.executable, "-P", "-c", ACTOR, f"tls/127.0.0.1:{mute.getsockname()[1]}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as worker:
            assert worker.stdout is not None
            host = int(worker.stdout.readline())
            wait_until(lambda: len(list(folder.glob("*/logs/*.log"))) >= agents, "the agents")
            wait_until(lambda: len(keys_in(folder)) == agents, "their keys")
            try:
                yield worker, host
            finally:
                worker.kill()


def folders_in(folder: Path) -> set[Path]:
    return {logs.parent for logs in folder.glob("*/logs")}


def keys_in(folder: Path) -> list[Path]:
    return list(folder.rglob("*.key"))


@pytest.mark.slow
def test_a_worker_and_its_host_killed_together_leave_no_keys(tmp_path: Path) -> None:
    """The agents remove them as they end; the next host removes the folder, and no other's."""
    with an_actor(tmp_path) as (worker, host):
        os.kill(host, signal.SIGSTOP)  # so that it cannot see the worker's end
        worker.kill()
        os.kill(host, signal.SIGKILL)
        wait_until(lambda: not keys_in(tmp_path), "no more keys")
    (left,) = folders_in(tmp_path)
    with an_actor(tmp_path):
        assert not left.exists()
        (own,) = folders_in(tmp_path)
        with an_actor(tmp_path, agents=4):
            assert own.exists()


def test_a_port_that_cannot_be_reached_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it refuses or says nothing; one that listens is well."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert asyncio.run(dask_cluster_module.problem_to_reach("127.0.0.1", port)) == ""
    assert "refused" in asyncio.run(dask_cluster_module.problem_to_reach("127.0.0.1", port)).lower()
    monkeypatch.setattr(dask_cluster_module, "REACH_WITHIN_S", 0.0)
    assert "no answer" in asyncio.run(dask_cluster_module.problem_to_reach("127.0.0.1", port))


def test_a_cluster_may_have_more_workers_than_a_default_backlog() -> None:
    """All of them try the port at once, where nobody accepts."""
    cluster = dask_cluster_module.DaskCluster.__new__(dask_cluster_module.DaskCluster)
    cluster.workers = [Worker(f"w{number}", f"tcp://127.0.0.1:{number}") for number in range(200)]

    def ask(function: Callable[..., Any], *place: object) -> dict[str, str]:
        async def tried() -> list[str]:
            problems: list[str] = await asyncio.gather(*[function(*place) for _ in cluster.workers])
            return problems

        return {worker.address: problem for worker, problem in zip(cluster.workers, asyncio.run(tried()), strict=True)}

    cluster._ask_workers = ask  # type: ignore[method-assign]
    assert cluster.endpoint("tcp/127.0.0.1:0").startswith("tls/127.0.0.1:")


@pytest.mark.slow
def test_a_worker_with_other_code_is_refused(tmp_path: Path) -> None:
    """The lines name the worker, what it has, and what this machine has."""
    shadow = tmp_path / "shadow" / "deltaswarm_wire"
    shadow.mkdir(parents=True)
    for source in Path(deltaswarm_wire.__path__[0]).glob("*.py"):
        (shadow / source.name).write_text(source.read_text() + "# changed\n")
    with dask_cluster(tmp_path / "cluster") as cluster:
        cluster.add_worker(PYTHONPATH=f"{shadow.parent}:{os.environ.get('PYTHONPATH', '')}")
        done = told("run", "smoke", "--out", str(tmp_path / "run"), "--engine", "dask", "--scheduler", cluster.address)
    assert done.returncode == 2
    assert re.search(r"w0 at tcp://\S+ has deltaswarm \S+ \(code \w+\), Python", done.stderr)
    assert not (tmp_path / "run").exists()
