"""A real run with an attacker in it, and what there is to compare with another one."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.keys import OPERATOR, WORLD
from tests.hostile.attacker import SILENCE, WHO
from tests.support.swarms import PATIENCE_S, started


class Ended(NamedTuple):
    """What is left of a run: summary, what its parts say, wall time [s] and the largest memory [MB] by part."""

    summary: dict[str, Any]
    outcome: Outcome
    wall_s: float
    peak_mb: dict[str, float]
    log_kb: float
    """Length of the world's log."""

    @property
    def world(self) -> dict[str, Any]:
        return self.outcome.world

    @property
    def refused(self) -> dict[str, int]:
        return dict(self.world["rejected"])


MOST_MB, MOST_LOG_KB = 150.0, 20.0


def harm(ended: Ended, silence: Ended) -> list[str]:
    """Say what an attack did to others, compared with an attacker that merely fell silent; one line each."""
    found = [] if ended.world["digest"] == silence.world["digest"] else ["another digest"]
    now, then = ended.summary, silence.summary
    found += [f"{name}: {now[name]}, not {then[name]}" for name in ("steps", "agents_lost") if now[name] != then[name]]
    if others := sorted(ended.refused.keys() - {str(WHO)}):
        found.append(f"samples of agents {', '.join(others)} were refused")
    found += [f"{role} grew to {mb:.0f} MB" for role, mb in ended.peak_mb.items() if mb >= MOST_MB]
    if ended.log_kb >= MOST_LOG_KB:
        found.append(f"the world's log grew to {ended.log_kb:.0f} kB")
    reports = now["operator"]["per_sender"].get(str(WHO), {"messages": 0})["messages"]
    if reports > now["steps"]:
        found.append(f"{reports} reports of agent {WHO} were counted, more than one per step")
    return found


def play(
    folder: Path,
    scenario_name: str,
    steps: int,
    attack: str = SILENCE,
    sessions: int = 1,
    others: Sequence[str] = (),
) -> Ended:
    """Do a whole run with this attack, and `others` among its settings."""
    settings = [
        "control.mode=tests.hostile.attacker:Attacker",
        f"control.attack={attack}",
        f"control.sessions={sessions}",
        f"run.duration_s={steps}",
        "run.step_timeout_s=6",
        "record=off",
        *others,
    ]
    scenario = load_scenario(scenario_name, settings)
    folder.mkdir(parents=True)
    began = time.monotonic()
    peak_mb: dict[str, float] = {}
    with started(scenario, "hostile", folder) as (swarm, observer):
        while swarm.part(WORLD).exit_code is None:
            assert time.monotonic() < began + PATIENCE_S, "the run does not end"
            observer.work(0.05)
            observer.leave_when_done()
            for role in (WORLD, OPERATOR):
                peak_mb[role] = max(peak_mb.get(role, 0.0), _memory_mb(swarm.part(role).pid))
    outcome = run_tables.read_outcome(folder)
    log_kb = (folder / "logs" / "world-0.log").stat().st_size / 1000
    return Ended(summarise(outcome, scenario), outcome, time.monotonic() - began, peak_mb, log_kb)


def _memory_mb(pid: int) -> float:
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS:")), 0.0)
