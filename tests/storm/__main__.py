"""`python -m tests.storm --runs 100 --seed 1`: a table of storms; exit code 1 if anything did not hold."""

import argparse
import os
import tempfile
from pathlib import Path
from random import Random

from deltaswarm_orchestrator.base.signals import STOP_SIGNALS, raise_on_signals
from tests.storm import blows, commands, judge


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.storm", description=__doc__)
    parser.add_argument("--runs", type=int, default=100, metavar="N", help="how many (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="all blows come from it (default: 1)")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="begin with this one (default: 0)")
    parser.add_argument("--one-blow", action="store_true", help="one blow per run, whose cause must be told first")
    parser.add_argument("--commands", action="store_true", help="strike commands that work on folders")
    arguments = parser.parse_args()
    of = blows if arguments.one_blow else commands if arguments.commands else judge
    raise_on_signals(STOP_SIGNALS)  # so that no process and no folder stays behind
    bad, before = 0, set(os.listdir("/dev/shm"))
    for number in range(arguments.first, arguments.first + arguments.runs):
        with tempfile.TemporaryDirectory(prefix="storm-") as name:
            seen, found = of.play_and_judge(Path(name), Random(f"{arguments.seed}/{number}"))
        print(f"{number:4} {seen}  {'; '.join(found) or 'holds'}", flush=True)
        if found:
            print("\n".join(f"       {line}" for line in getattr(seen, "printed", "").splitlines()[-12:]), flush=True)
        bad += bool(found)
    print(f"{arguments.runs} storms, {bad} in which something did not hold")
    if left := set(os.listdir("/dev/shm")) - before:
        print(f"left behind in shared memory: {', '.join(sorted(left))}")
    return 1 if bad or left else 0


if __name__ == "__main__":
    raise SystemExit(main())
