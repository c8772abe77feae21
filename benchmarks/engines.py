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

MODES = ("decentralised", "hierarchical", "hybrid", "adaptive")
ENGINES: dict[str, Engine] = {PYTHON: run_in_process, DENSE: Dense()}


def measure(agents: int, steps: int, rounds: int) -> dict[str, Any]:
    """Measure the CPU time of runs with seeds 1, 2..., from scenario to outcome [s]; return medians and ratios.

    The first run of the dense engine, which may compile its code, is not counted.
    """
    ENGINES[DENSE](load_scenario("smoke", ["record=off"]))
    rows = []
    for mode in MODES:
        times: dict[str, list[float]] = {PYTHON: [], DENSE: []}
        for seed in range(1, rounds + 1):
            base = scale_scenario(agents, steps, seed)
            control = load_scenario("paper-25", [f"control.mode={mode}"]).control
            digests = set()
            for name, engine in ENGINES.items():
                began = time.process_time()
                digests.add(engine(replace(base, control=control)).digest)
                times[name].append(time.process_time() - began)
            assert len(digests) == 1
        ratios = [slow / fast for slow, fast in zip(times[PYTHON], times[DENSE], strict=True)]
        medians_s = {f"{name}_s": median(values) for name, values in times.items()}
        rows.append({"mode": mode, **medians_s, "ratio": median(ratios)})
    return {"agents": agents, "steps": steps, "rounds": rounds, "rows": rows}
