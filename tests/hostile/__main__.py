"""`python -m tests.hostile`: every attack against `smoke` and a shortened `paper-25`, as a table."""

import argparse
import tempfile
from pathlib import Path

from deltaswarm_orchestrator.base.signals import STOP_SIGNALS, raise_on_signals
from tests.hostile.attacker import FLOODS, LATENESS, REFUSED, SILENCE
from tests.hostile.stage import harm, play


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("--steps", type=int, default=1000, help="steps of each run (default: 1000)")
    parser.add_argument(
        "--sessions", type=int, nargs="+", default=[1, 4], help="numbers of sessions that flood at once (default: 1 4)"
    )
    arguments = parser.parse_args()
    raise_on_signals(STOP_SIGNALS)  # so that no process and no folder stays behind
    harmed = 0
    print("scenario  attack                    sessions  wall [s]  world, operator [MB]   refused  harm")
    with tempfile.TemporaryDirectory(prefix="deltaswarm-hostile-") as folder:
        for scenario in ("smoke", "paper-25"):
            silence = play(Path(folder) / scenario, scenario, arguments.steps)
            floods = [(flood, sessions) for flood in (*FLOODS, *REFUSED) for sessions in arguments.sessions]
            for attack, sessions in ((SILENCE, 1), (LATENESS, 1), *floods):
                run = Path(folder) / f"{scenario}-{attack}-{sessions}"
                ended = silence if attack == SILENCE else play(run, scenario, arguments.steps, attack, sessions)
                found = harm(ended, silence)
                harmed += bool(found)
                memory = ", ".join(f"{mb:.0f}" for mb in ended.peak_mb.values())
                print(
                    f"{scenario:8}  {attack:24}  {sessions:8}  {ended.wall_s:8.1f}  {memory:20}  "
                    f"{sum(ended.refused.values()):8}  {'; '.join(found) or 'none'}",
                    flush=True,
                )
    return 1 if harmed else 0


if __name__ == "__main__":
    raise SystemExit(main())
