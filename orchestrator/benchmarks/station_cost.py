"""Measure the cost of the operator's station in a run of processes: steps/s without it, with it, with pages open."""

import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import urlsplit

from websockets.client import ClientProtocol
from websockets.extensions.permessage_deflate import ClientPerMessageDeflateFactory
from websockets.uri import parse_uri

from deltaswarm_orchestrator.base import dies_with_parent
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.bench.speed import bench_scenario, speed_of
from deltaswarm_orchestrator.processes.station import address
from deltaswarm_orchestrator.scenarios.load import to_toml

ARMS = {"none": None, "station": 0, "one_page": 1, "three_pages": 3}
"""Number of pages open at the station; None: there is no station."""

PATIENCE_S = 60.0


def measure(agents: int, steps: int, rounds: int) -> dict[str, Any]:
    """Measure steps/s as fast as possible and the share lost against the same round's `none`; return medians.

    A page is a connection that receives data and draws nothing, so the browser's own cost is not measured.

    Raises:
        CommandError: a run is not valid, or its station does not come.
    """
    speeds: defaultdict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory(prefix="deltaswarm-bench-") as name:
        scenario = Path(name) / "bench.toml"
        scenario.write_text(to_toml(bench_scenario(agents, steps)), encoding="utf-8")
        for index in range(rounds):
            for arm, pages in ARMS.items():
                speeds[arm].append(_steps_per_s(scenario, Path(name) / f"{arm}-{index}", pages))
    lost = {
        arm: [1 - speed / plain for speed, plain in zip(row, speeds["none"], strict=True)]
        for arm, row in speeds.items()
    }
    return {
        "agents": agents,
        "steps": steps,
        "rounds": rounds,
        "steps_per_s": {arm: median(values) for arm, values in speeds.items()},
        "lost_share": {arm: median(values) for arm, values in lost.items() if arm != "none"},
    }


def _steps_per_s(scenario: Path, out: Path, pages: int | None) -> float:
    command = [sys.executable, "-P", "-m", dies_with_parent.__name__, str(os.getpid()), "deltaswarm_orchestrator"]
    command += ["run", str(scenario), "--out", str(out), "--json"]
    if pages is not None:
        command += ["--station", "--speed", "0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    ) as run:
        try:
            if pages:
                url = _address(out.with_name(f"{out.name}.part"), run)
                for _ in range(pages):
                    threading.Thread(target=_look_on, args=(url,), daemon=True).start()
            printed, _ = run.communicate()
        except BaseException:
            run.terminate()
            run.wait()  # it writes into a folder that is about to be removed
            raise
    return speed_of(json.loads(printed or "{}"))


def _address(folder: Path, run: subprocess.Popen[str]) -> str:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline and run.poll() is None:
        try:
            if url := address(folder):
                return url
        except ValueError:
            pass  # only partly written
        time.sleep(0.02)
    raise CommandError(f"the station was not there within {PATIENCE_S:.0f} s", FAILED)


def _look_on(url: str) -> None:
    page = urlsplit(url)
    live = parse_uri(f"ws://{page.netloc}{page.path}live")
    protocol = ClientProtocol(live, origin=f"http://{page.netloc}", extensions=[ClientPerMessageDeflateFactory()])  # type: ignore[arg-type]
    protocol.send_request(protocol.connect())
    with suppress(OSError), socket.create_connection((page.hostname, page.port)) as link:  # the run may be over
        link.sendall(b"".join(protocol.data_to_send()))
        while link.recv(1 << 18):
            pass
