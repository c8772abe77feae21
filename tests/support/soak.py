"""Three boards in open air for a long time at accelerated pace, and the memory of each over it.

`python -m tests.support.soak --hours 24 --accelerate 400 --out FOLDER` writes `memory.csv` (simulated hours, MB
resident of each board) and `memory.png`, and says what grew. Boards lose and find one another again and again: every
simulated hour the link between them and the first one is gone for five minutes. They have the environment of the
systemd unit.
"""

import argparse
import csv
import tempfile
import time
from pathlib import Path

from deltaswarm_board.settings import RECORDS
from tests.support.cable import Cable, cable
from tests.support.fields import EVENT_AT, TASK, Listener, board_table, boards, endpoint, free_port, listening
from tests.support.swarms import wait_until

UNIT = Path(__file__).parents[2] / "agent" / "systemd" / "deltaswarm-agent@.service"
STARTS = (EVENT_AT, (10.0, 0.5), (19.0, 18.0))
LOSS_EVERY_S, LOSS_S = 3600.0, 300.0


def resident_mb(pid: int) -> float:
    """Memory of a process [MB]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096 / 1e6


def soak(folder: Path, hours: float, accelerate: float, samples: int, record: str = "off") -> list[list[float]]:
    """Rows of simulated hours and the memory of each board [MB]."""
    ports = [free_port() for _ in STARTS]
    rows: list[list[float]] = []
    settings = [line.removeprefix("Environment=") for line in UNIT.read_text().splitlines() if "Environment=" in line]
    environment = dict(setting.split("=", 1) for setting in settings)
    with boards(folder) as running, cable(ports[0]) as link, listening(*map(endpoint, ports)) as listener:
        first = [endpoint(link.port)]
        for agent, at in enumerate(STARTS):
            connect = [*first, *map(endpoint, ports[1:agent])] if agent else []
            air = {"listen": [endpoint(ports[agent])], "connect": connect, "range_m": 9.0}
            table = board_table(agent, at, air, folder)
            table["agent"] = {**TASK, "control": {**TASK["control"], "gamma_max": 400}}
            table["log"] = {"folder": str(folder / "logs"), "max_bytes": 100_000, "record": record}
            running.start(table, "--accelerate", str(accelerate), environment=environment)
        wait_until(lambda: listener.alive == {0, 1, 2}, "all on the air")
        began_s = time.monotonic()
        for sample in range(samples + 1):
            wanted_s = 3600 * hours * sample / samples
            wait_until(lambda wanted_s=wanted_s: tick(link, began_s, accelerate) >= wanted_s, "time", 3600)
            rows.append([wanted_s / 3600, *(resident_mb(running.processes[agent].pid) for agent in range(3))])
        check(listener)
        for agent in range(3):
            assert running.stop(agent) == 0
    return rows


def tick(link: Cable, began_s: float, accelerate: float) -> float:
    """The simulated time [s]; on the way, what is due happens to the link."""
    now_s = (time.monotonic() - began_s) * accelerate
    if now_s % LOSS_EVERY_S > LOSS_EVERY_S - LOSS_S:
        link.cut()
    else:
        link.mend()
    return now_s


def check(listener: Listener) -> None:
    """They did something in all that time."""
    assert listener.frames[0] > 100
    assert listener.frames[1] + listener.frames[2] > 100
    assert listener.reports


def main() -> None:
    """Soak, write, and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0, help="simulated")
    parser.add_argument("--accelerate", type=float, default=400.0, help="simulated per wall second")
    parser.add_argument("--samples", type=int, default=96)
    parser.add_argument("--record", default="off", choices=RECORDS)
    parser.add_argument("--out", type=Path, required=True)
    told = parser.parse_args()
    told.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        rows = soak(Path(folder), told.hours, told.accelerate, told.samples, told.record)
        for agent in range(3):
            print((Path(folder) / "logs" / f"agent-{agent}.log").read_text().splitlines()[-1])
    with (told.out / "memory.csv").open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["simulated_h", "agent_0_mb", "agent_1_mb", "agent_2_mb"])
        table.writerows([[round(value, 3) for value in row] for row in rows])
    draw(rows, told.out / "memory.png")
    middle, last = rows[len(rows) // 2], rows[-1]
    for agent in range(3):
        print(
            f"agent {agent}: {middle[agent + 1]:.2f} MB at {middle[0]:g} h, {last[agent + 1]:.2f} MB at {last[0]:g} h"
        )


def draw(rows: list[list[float]], file: Path) -> None:
    """The curves."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3), layout="constrained")
    axes = figure.subplots()
    for agent in range(3):
        axes.plot([row[0] for row in rows], [row[agent + 1] for row in rows], label=f"board {agent}")
    axes.axhline(40, color="0.6", linewidth=0.8, linestyle="--")
    axes.set(xlabel="simulated time [h]", ylabel="resident memory [MB]", ylim=(0, 45))
    axes.legend(loc="lower right")
    figure.savefig(file)


if __name__ == "__main__":
    main()
