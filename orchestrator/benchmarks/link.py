"""Measure how the speed of a run depends on the round-trip time to the machines of its agents.

The agents run here, as a worker of a cluster would run them: over TLS, with certificates, behind a proxy that delays.
"""

import secrets
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.delaying_proxy import delaying_proxy
from deltaswarm_cluster.agents import DaskPlacement
from deltaswarm_cluster.host import HostActor, Job
from deltaswarm_cluster.plan import Worker
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.bench.speed import bench_scenario, speed_of
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.keys import WORLD
from deltaswarm_wire.session import host_and_port

LOOPBACK = "127.0.0.1"


def measure(agents: int, steps: int, rounds: int, rtts: Sequence[float]) -> dict[str, Any]:
    """Measure steps/s with local agents, and at each round-trip time [ms] in turns; return medians.

    `steps_per_round_trip` says how many steps one round-trip time lasts for: a step that asks nobody needs none.

    Raises:
        CommandError: a run is not valid.
    """
    scenario = bench_scenario(agents, steps)
    speeds: defaultdict[float | None, list[float]] = defaultdict(list)
    for _ in range(rounds):
        for rtt_ms in (None, *rtts):
            speeds[rtt_ms].append(_steps_per_s(scenario, rtt_ms))
    middle = {rtt_ms: median(values) for rtt_ms, values in speeds.items()}
    return {
        "agents": agents,
        "steps": steps,
        "rounds": rounds,
        "local_steps_per_s": middle[None],
        "links": [
            {"rtt_ms": rtt_ms, "steps_per_s": speed, "steps_per_round_trip": speed * rtt_ms / 1000}
            for rtt_ms, speed in middle.items()
            if rtt_ms is not None
        ],
    }


class _Here:
    """This machine as a worker with its host, and as the cluster of this one worker."""

    worker = Worker("here", "here")
    problem = ""

    def start(self, job: Job) -> None:
        actor = HostActor(job)
        self.poll, self.stop, self.close = actor.poll, actor.stop, actor.close


def _steps_per_s(scenario: Scenario, rtt_ms: float | None) -> float:
    """Measure one run, with agents behind a proxy or, with None, as local processes."""
    with tempfile.TemporaryDirectory(prefix="deltaswarm-bench-") as name:
        folder = Path(name)
        (folder / "scenario.toml").write_text(to_toml(scenario), encoding="utf-8")
        run, remote = f"bench-{secrets.token_hex(4)}", None
        if rtt_ms is not None:
            here: Any = _Here()
            placement = DaskPlacement(here, {here: range(scenario.agents.count)}, f"tls/{LOOPBACK}:0")
            remote = placement.agents(scenario, folder / "logs")
        with ExitStack() as stack:
            swarm = stack.enter_context(Swarm(scenario, run, folder, remote=remote))
            with starting_processes():  # the fork server
                swarm.start_world(f"tcp/{LOOPBACK}:0")
            observer = stack.enter_context(Observer(run, swarm.recorder_link(), None, wire=False))
            swarm.start_operator(publish_all=False)
            if remote is None or rtt_ms is None:
                swarm.start_agents()
            else:
                _, port = host_and_port(swarm.endpoints[-1])
                port = stack.enter_context(delaying_proxy(port, rtt_ms / 1000))
                remote.start(run, f"tls/{LOOPBACK}:{port}", [], lambda: None)
            while swarm.part(WORLD).exit_code is None:
                observer.work(0.02)
                observer.leave_when_done()
                swarm.ended()  # takes its updates
        return speed_of(summarise(run_tables.read_outcome(folder), scenario))
