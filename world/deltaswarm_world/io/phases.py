"""Where the wall time of the world's steps goes, phase by phase, for `python -m benchmarks processes`."""

import time

PHASES = {
    "held": "the operator's turn or pace, faults, and checkpoints",
    "begin": "bodies, events, sensing, and who is asked",
    "radio": "who hears whom",
    "frames": "each agent's frame is made, encoded and sent",
    "bookkeeping": "the step before: record, digest, tables, truth, reports to the operator",
    "waiting": "no sample is there",
    "intake": "agents' samples are decoded and checked",
    "close": "acts and work on events",
}

CRITICAL = ("close", "held", "begin", "radio", "frames")
"""The phases between the last act of a step and the last frame of the next one."""


class Phases:
    """Adds the time since the last call to a phase: wall time, and CPU time of the one thread that calls."""

    def __init__(self) -> None:
        self._wall_s, self._cpu_s = dict.fromkeys(PHASES, 0.0), dict.fromkeys(PHASES, 0.0)
        self._wall_since_s, self._cpu_since_s = time.perf_counter(), time.thread_time()
        self._began_s = time.process_time()
        self._steps = 0

    def __call__(self, phase: str) -> None:
        wall_s, cpu_s = time.perf_counter(), time.thread_time()
        self._wall_s[phase] += wall_s - self._wall_since_s
        self._cpu_s[phase] += cpu_s - self._cpu_since_s
        self._wall_since_s, self._cpu_since_s = wall_s, cpu_s
        self._steps += phase == "close"

    def totals(self) -> dict[str, float]:
        """Return means per step [us]: wall time and CPU time of each phase of the critical ones, and of all threads."""
        us = 1e6 / max(1, self._steps)
        times = {"all_threads_cpu_us": (time.process_time() - self._began_s) * us}
        for suffix, seconds in ("us", self._wall_s), ("cpu_us", self._cpu_s):
            times |= {f"{phase}_{suffix}": spent_s * us for phase, spent_s in seconds.items()}
            times[f"critical_{suffix}"] = sum(seconds[phase] for phase in CRITICAL) * us
        return times
