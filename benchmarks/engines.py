"""Measure whole runs by the Python engine and by the dense engine, in turns, in this process."""

import time
from dataclasses import replace
from statistics import median
from typing import Any

from benchmarks.scale import scale_scenario
from deltaswarm_dense.joining import Dense
from deltaswarm_orchestrator.processes.elsewhere import DENSE, PYTHON
from deltaswarm_orchestrator.run.engine import Engine
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario

CASES = {
    "decentralised": ["control.mode=decentralised"],
    "hierarchical": ["control.mode=hierarchical"],
    "hybrid": [],
    "adaptive": ["control.mode=adaptive"],
    "hybrid, 30 % of frames lost": ["radio.loss=0.3"],
    "hybrid, frames 1.5 s late": ["radio.latency_s=1.5"],
    "hybrid, 30 % of reports lost": ["uplink.loss=0.3"],
}
"""What differs from hybrid control over a perfect network."""

ENGINES: dict[str, Engine] = {PYTHON: run_in_process, DENSE: Dense()}


def measure(agents: int, steps: int, rounds: int) -> dict[str, Any]:
    """Measure the CPU time of runs with seeds 1, 2..., from scenario to outcome [s]; return medians and ratios.

    The first run of the dense engine, which may compile its code, is not counted.
    """
    ENGINES[DENSE](load_scenario("smoke", ["record=off"]))
    rows = []
    for name, sets in CASES.items():
        times: dict[str, list[float]] = {PYTHON: [], DENSE: []}
        for seed in range(1, rounds + 1):
            base = scale_scenario(agents, steps, seed)
            case = load_scenario("paper-25", sets)
            scenario = replace(base, control=case.control, radio=case.radio, uplink=case.uplink)
            digests = set()
            for by, engine in ENGINES.items():
                began = time.process_time()
                digests.add(engine(scenario).digest)
                times[by].append(time.process_time() - began)
            assert len(digests) == 1
        ratios = [slow / fast for slow, fast in zip(times[PYTHON], times[DENSE], strict=True)]
        medians_s = {f"{by}_s": median(values) for by, values in times.items()}
        rows.append({"case": name, **medians_s, "ratio": median(ratios)})
    return {"agents": agents, "steps": steps, "rounds": rounds, "rows": rows}
