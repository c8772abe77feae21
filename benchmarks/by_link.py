"""How many people one machine carries in a study by link: `python -m benchmarks.by_link --people 40 --speed 5`.

Scripted participants go through their sessions at once; each input must be noted once, by the tables. Prints what a
participant costs while all runs are under way (CPU, memory), how soon inputs are answered, and how often pages are
shown something new. The clients run on the same machine, and are not counted.
"""

import argparse
import csv
import json
import os
import statistics
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

from tests.support.by_link import Message, Participant, a_study, bad_links, serving
from tests.support.swarms import told

TICKS_PER_S = os.sysconf("SC_CLK_TCK")
SETTLE_S, MEASURE_S = 20.0, 20.0


def processes(word: bytes, folder: Path) -> list[int]:
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes()
        except OSError:
            continue
        if word in words and os.fsencode(folder) in words:
            found.append(int(entry.parent.name))
    return found


def cpu_s(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def memory_mb(pid: int) -> float:
    """Proportional set size: shared pages count in part."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=40)
    parser.add_argument("--speed", type=float, default=5.0)
    parser.add_argument("--bad-links", action="store_true", help="links that are slow, cut, stall, die and come back")
    parser.add_argument("--duration-s", type=int, default=600, help="of each of the two runs [simulated s]")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        each = {"training_s": given.duration_s, "condition_s": given.duration_s, "more": f"at_once = {given.people}\n"}
        file = a_study(folder, speed=given.speed, **each)
        file.write_text(file.read_text().replace('"smoke"', '"paper-25"'))
        told("serve", str(file), "--out", str(folder / "out"), "--links", str(given.people))
        links = json.loads((folder / "out" / "links.json").read_text())["links"]
        with serving(file) as service, ExitStack() as stack:
            base = service.open_link.partition("/j/")[0]
            people = [Participant(f"{base}/p/{link['token']}/") for link in links]
            if given.bad_links:
                people = stack.enter_context(bad_links(service, [link["token"] for link in links]))
            ends: list[Message | None] = [None] * len(people)

            def go(index: int) -> None:
                ends[index] = people[index].go_through()

            threads = [threading.Thread(target=go, args=(index,), daemon=True) for index in range(len(people))]
            began = time.monotonic()
            for thread in threads:
                thread.start()
            while len(processes(b"deltaswarm_serving.hosted", folder)) < given.people:
                time.sleep(0.2)
            print(f"all sessions started after {time.monotonic() - began:.1f} s")
            time.sleep(SETTLE_S)
            hosted = processes(b"deltaswarm_serving.hosted", folder)
            front = [service.process.pid]
            before = {pid: cpu_s(pid) for pid in [*hosted, *front]}
            shown, since = sum(one.pictures for one in people), time.monotonic()
            time.sleep(MEASURE_S)
            span_s = time.monotonic() - since
            used = {pid: (cpu_s(pid) - before[pid]) / span_s for pid in before}
            rate_hz = (sum(one.pictures for one in people) - shown) / span_s / given.people
            each_cpu = statistics.median(used[pid] for pid in hosted)
            each_mb = statistics.median(memory_mb(pid) for pid in hosted)
            print(f"a session's process: {100 * each_cpu:.1f} % of a core, {each_mb:.0f} MB (median of {len(hosted)})")
            print(f"the front: {100 * used[front[0]]:.1f} % of a core, {memory_mb(front[0]):.0f} MB")
            print(f"pictures: {rate_hz:.1f} per s at each page")
            for thread in threads:
                thread.join()
        delays = sorted(delay for one in people for delay in one.delays_s)
        print(
            f"inputs answered within {1000 * delays[int(0.95 * len(delays))]:.0f} ms (95th percentile of {len(delays)})"
        )
        complete = sum(bool(end and end["state"] == "complete") for end in ends)
        right = 0
        for number, one in enumerate(people, 1):
            acts = []
            for table in sorted((folder / "out" / f"participant-{number:03}").glob("*/actions.csv")):
                with table.open(newline="") as stream:
                    acts += [row["input"] for row in csv.DictReader(stream) if row["kind"] == "command"]
            right += acts == one.orders
        print(f"complete: {complete} of {given.people}; every order noted once: {right} of {given.people}")


if __name__ == "__main__":
    main()
