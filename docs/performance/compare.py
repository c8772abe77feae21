"""Compare the CPU time of runs in one process by several versions of deltaswarm, in turns.

    python compare.py MODE STEPS REPETITIONS FOLDER FOLDER...

Each folder holds the packages (a wheel's content) or is a checkout. All versions take turns in blocks of 50 steps; of a
block's repetitions the fastest counts, so that a neighbour on a busy machine matters little. Their digests must be
equal.
"""

import os
import subprocess
import sys

BLOCK_STEPS = 50
PARTS = ("agent", "world", "operator", "orchestrator")

WORKER = f"""
import sys, time
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.operator_messages import Clock
scenario = load_scenario("paper-25", ["control.mode=" + sys.argv[1], "record=off"], 1)
for line in sys.stdin:
    if line == "new\\n":
        swarm, step = InProcess(scenario), 0
    began = time.process_time()
    for step in range(step, step + {BLOCK_STEPS}) if line == "run\\n" else ():
        record = swarm.step(step, False)
        swarm.close_step(Clock(step, record.time_s, False))
    spent_s = time.process_time() - began
    step += line == "run\\n"
    print(swarm.world.digest.hex() if line == "digest\\n" else spent_s, flush=True)
"""


def main(mode: str, steps: str, repetitions: str, *folders: str) -> None:
    """Print a line for each folder: CPU time per step [us], its ratio to the first folder's, and the digest."""
    blocks = int(steps) // BLOCK_STEPS
    workers = []
    for folder in folders:
        path = os.pathsep.join([folder, *(os.path.join(folder, part) for part in PARTS)])
        command = [sys.executable, "-P", "-c", WORKER, mode]
        environment = {**os.environ, "PYTHONPATH": path}
        workers.append(
            subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        )

    def ask(worker: subprocess.Popen[str], what: str) -> str:
        print(what, file=worker.stdin, flush=True)
        return next(iter(worker.stdout or ())).strip()

    fastest_s = [[float("inf")] * blocks for _ in workers]
    for repetition in range(int(repetitions)):
        for worker in workers:
            ask(worker, "new")
        for block in range(blocks):
            for index in sorted(range(len(workers)), reverse=bool((repetition + block) % 2)):
                spent_s = float(ask(workers[index], "run"))
                fastest_s[index][block] = min(fastest_s[index][block], spent_s)
    first_s = sum(fastest_s[0])
    for folder, worker, spent in zip(folders, workers, fastest_s, strict=True):
        step_us = 1e6 * sum(spent) / (blocks * BLOCK_STEPS)
        print(f"{folder}: {step_us:.0f} us per step, {sum(spent) / first_s:.2f}, digest {ask(worker, 'digest')}")
        worker.kill()


if __name__ == "__main__":
    main(*sys.argv[1:])
