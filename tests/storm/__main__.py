"""`python -m tests.storm --runs 100 --seed 1`: a table of stormy runs; exit code 1 if anything did not hold."""

import argparse
import os
import tempfile
from pathlib import Path
from random import Random

from deltaswarm_orchestrator.base.signals import STOP_SIGNALS, raise_on_signals
from tests.storm import blows, judge


def main() -> int:
    """Play and judge."""
    parser = argparse.ArgumentParser(prog="python -m tests.storm", description=__doc__)
    parser.add_argument("--runs", type=int, default=100, metavar="N", help="how many (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="all blows come from it (default: 1)")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="begin with this one (default: 0)")
    parser.add_argument("--one-blow", action="store_true", help="one blow per run, whose cause must be told first")
    arguments = parser.parse_args()
    play_and_judge = blows.play_and_judge if arguments.one_blow else judge.play_and_judge
    raise_on_signals(STOP_SIGNALS)  # so that no process and no folder stays behind
    bad = landed = 0
    before = shared_memory()
    for number in range(arguments.first, arguments.first + arguments.runs):
        with tempfile.TemporaryDirectory(prefix="storm-") as name:
            seen, found = play_and_judge(Path(name), Random(f"{arguments.seed}/{number}"))
            struck = ", ".join(f"{blow.number.name[3:]} {blow.target} {blow.at_s:.1f}" for blow in seen.landed)
            print(
                f"{number:4} {seen.wall_s:6.1f} s  {seen.kind:22}  code {seen.code}  [{struck}]  "
                f"{'; '.join(found) or 'holds'}",
                flush=True,
            )
            if found:
                print("\n".join(f"       {line}" for line in seen.printed.splitlines()[-12:]), flush=True)
            bad += bool(found)
            landed += bool(seen.landed)
    print(f"{arguments.runs} runs, {landed} of them hit, {bad} in which something did not hold")
    if left := shared_memory() - before:
        print(f"left behind in shared memory: {', '.join(sorted(left))}")
    return 1 if bad or left else 0


def shared_memory() -> set[str]:
    """The segments of all processes of this machine."""
    return set(os.listdir("/dev/shm"))


if __name__ == "__main__":
    raise SystemExit(main())
