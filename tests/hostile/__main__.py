"""`python -m tests.hostile`: every flood against `smoke` and a shortened `paper-25`, as a table."""

import argparse
import tempfile
from pathlib import Path

from deltaswarm_orchestrator.stopping import STOP_SIGNALS, raise_on_signals
from tests.hostile.attacker import FLOODS, SILENCE
from tests.hostile.stage import play


def main() -> int:
    """0 if nobody but the flooder was harmed."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("--steps", type=int, default=1000, help="steps of each run (default: 1000)")
    parser.add_argument(
        "--sessions", type=int, nargs="+", default=[1, 4], help="sessions of the flooder (default: 1 4)"
    )
    arguments = parser.parse_args()
    raise_on_signals(STOP_SIGNALS)  # so that no process and no folder stays behind
    harmed = 0
    print("scenario  flood                     sessions  same acts  wall [s]  world, operator [MB]  excess")
    with tempfile.TemporaryDirectory(prefix="deltaswarm-hostile-") as folder:
        for scenario in ("smoke", "paper-25"):
            silence = play(Path(folder) / scenario, scenario, arguments.steps)
            for flood in (SILENCE, *FLOODS):
                for sessions in arguments.sessions if flood != SILENCE else (1,):
                    run = Path(folder) / f"{scenario}-{flood}-{sessions}"
                    ended = silence if flood == SILENCE else play(run, scenario, arguments.steps, flood, sessions)
                    is_same = ended.world["digest"] == silence.world["digest"]
                    harmed += not is_same
                    memory = ", ".join(f"{mb:.0f}" for mb in ended.peak_mb.values())
                    excess = sum(ended.world["excess"].values())
                    print(
                        f"{scenario:9} {flood:25} {sessions:8}  {'yes' if is_same else 'NO':9}  "
                        f"{ended.wall_s:8.1f}  {memory:20}  {excess}",
                        flush=True,
                    )
    return 1 if harmed else 0


if __name__ == "__main__":
    raise SystemExit(main())
