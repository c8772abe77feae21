"""One stormy run: what is done to whom and when, drawn from a seed, and what was seen."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import NamedTuple

from deltaswarm_wire import checkpoint
from tests.support.swarms import COMMAND, UNHURRIED, is_running, kill, parent_of, sets
from tests.support.sweeping import MARK, marked

AGENTS = 6
OVER_S = 8.0
"""Signals come within so long after the launch [s]."""

AT_MOST_S = 120.0
"""No run takes longer, whatever is done to it; without a storm one takes a few seconds on a quiet machine."""

GONE_WITHIN_S = 30.0
NEWEST = Path(checkpoint.FOLDER) / checkpoint.NEWEST
SIGNALS = (signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM, signal.SIGINT)
ORCHESTRATOR, FORK_SERVER = "orchestrator", "fork server"
STATION, CHECKPOINT = "--station", "--checkpoint"
KINDS: tuple[tuple[str, ...], ...] = ((), (), (STATION, "--speed", "0"), (CHECKPOINT, "50"))
"""The options of a run; half of the runs have none."""


PERSON = ("operator.person.policy=threshold", "operator.threshold_hz=0.5", "operator.person.command_every_s=10")
"""Of half of the runs: the simulated person gives commands, whose table survives the operator."""


class Surroundings(NamedTuple):
    """What a run finds where it is started: variables, and what a shell does before."""

    variables: dict[str, str]
    shell: str = ":"


QUIET = Surroundings({})
SURROUNDINGS = {
    "": QUIET,
    "logs": Surroundings({"RUST_LOG": "trace"}),
    "ascii": Surroundings({"PYTHONIOENCODING": "ascii", "LC_ALL": "C"}),
    "few files": Surroundings({}, "ulimit -Sn 64"),
    "umask": Surroundings({}, "umask 077"),
    "no input": Surroundings({}, "exec <&-"),
    "ignored": Surroundings({}, "trap '' CHLD"),
}


class Blow(NamedTuple):
    """A signal to a part at a time after the launch [s]; one that stops it may be followed by SIGCONT."""

    at_s: float
    target: str
    number: signal.Signals
    goes_on_at_s: float | None = None


@dataclass
class Seen:
    """What became of a run."""

    kind: str
    """The first option of the run, if it has any, and its surroundings."""
    blows: list[Blow]
    landed: list[Blow] = field(default_factory=list)
    code: int | None = None
    """Of the orchestrator; None if it did not end in time."""
    wall_s: float = 0.0
    printed: str = ""
    left: list[str] = field(default_factory=list)
    """Processes and files that are still there."""

    def __str__(self) -> str:
        struck = ", ".join(f"{blow.number.name[3:]} {blow.target} {blow.at_s:.1f}" for blow in self.landed)
        return f"{self.wall_s:6.1f} s  {self.kind:22}  code {self.code}  [{struck}]"

    def landed_on(self, target: str, *numbers: signal.Signals) -> bool:
        return any(blow.target == target and blow.number in numbers for blow in self.landed)


def draw(rng: Random, options: Sequence[str] = ()) -> list[Blow]:
    """Draw one to four blows, in order of time.

    A stopped orchestrator is always continued, since nobody else could end it.
    """
    targets = [ORCHESTRATOR, FORK_SERVER, *2 * ("world", "operator"), *(f"agent {n}" for n in range(AGENTS))]
    targets += 2 * ["station"] if STATION in options else []
    blows = []
    for _ in range(rng.randint(1, 4)):
        at_s, target, number = rng.uniform(0.2, OVER_S), rng.choice(targets), rng.choice(SIGNALS)
        goes_on = number == signal.SIGSTOP and (target == ORCHESTRATOR or rng.random() < 0.5)
        blows.append(Blow(at_s, target, number, at_s + rng.uniform(0.5, 4.0) if goes_on else None))
    return sorted(blows)


def play(folder: Path, rng: Random) -> Seen:
    is_swift = rng.random() < 0.5
    given = [f"run.duration_s={rng.randint(300, 1500) if is_swift else rng.randint(60, 300)}"]
    given += [f"record={rng.choice(['off', 'views', 'wire'])}"]
    given += ["run.start_timeout_s=15", "run.step_timeout_s=1"]
    options = rng.choice(KINDS)
    given += PERSON if STATION not in options and rng.random() < 0.5 else ()
    around = rng.choice([*SURROUNDINGS])
    seen = Seen(" ".join([*options[:1], around]).strip(), draw(rng, options))
    strike(folder, seen, [*options, *(() if is_swift else UNHURRIED), *sets(*given)], SURROUNDINGS[around])
    return seen


def strike(folder: Path, seen: Seen, options: Sequence[str], around: Surroundings, *, waits: bool = False) -> None:
    """Do a run below `folder`, strike it, and note what becomes of it.

    With `waits`, a part that is not there yet is struck as soon as it is.
    """
    (temporary := folder / "tmp").mkdir(parents=True)
    command = [*COMMAND, "run", "smoke", "--out", str(folder / "run"), *options]
    began = time.monotonic()
    process = subprocess.Popen(
        ["bash", "-c", f'{around.shell}; exec "$@"', "bash", *command],
        env={**os.environ, **around.variables, MARK: str(folder), "TMPDIR": str(temporary)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    acts = [(blow.at_s, blow, blow.number) for blow in seen.blows]
    acts += [(blow.goes_on_at_s, blow, signal.SIGCONT) for blow in seen.blows if blow.goes_on_at_s is not None]
    delay_s = 0.0
    for at_s, blow, number in sorted(acts):
        with suppress(subprocess.TimeoutExpired):
            process.wait(max(0.0, began + at_s + delay_s - time.monotonic()))
        pid = _find(folder / "run.part", process.pid, blow.target)
        while waits and pid is None and process.poll() is None:
            time.sleep(0.002)
            pid, delay_s = _find(folder / "run.part", process.pid, blow.target), time.monotonic() - began - at_s
        if process.poll() is None and pid is not None and is_running(pid):
            with suppress(ProcessLookupError):
                os.kill(pid, number)
                seen.landed += [blow] if number == blow.number else []
    with suppress(subprocess.TimeoutExpired):
        seen.printed, seen.code = process.communicate(timeout=AT_MOST_S)[0], process.returncode
    seen.wall_s = time.monotonic() - began
    seen.left = left(str(folder), temporary)
    process.kill()
    kill(marked(str(folder), trackers=True))


def can_be_resumed(folder: Path) -> Path | None:
    """The run below `folder`, if it has a checkpoint."""
    return next((run for run in (folder / "run.part", folder / "run") if (run / NEWEST).exists()), None)


def resume(run: Path) -> subprocess.CompletedProcess[str]:
    """Resume a run from its newest checkpoint, without a storm."""
    command = [*COMMAND, "run", "--resume", str(run)]
    return subprocess.run(command, capture_output=True, text=True, timeout=AT_MOST_S, check=False)


def edit(run: Path, rng: Random) -> tuple[Path, bytes]:
    """Change a digit in an input of a run that can be resumed; return the file and what it held."""
    step = json.loads((run / NEWEST).read_text())["step"]
    files = [run / "scenario.toml", run / NEWEST, *sorted((run / checkpoint.FOLDER / str(step)).iterdir())]
    file = rng.choice(files)
    before = file.read_bytes()
    digits = [place for place, byte in enumerate(before) if chr(byte).isdigit()]
    place = rng.choice(digits or range(len(before)))
    changed = ord("7") if before[place] != ord("7") else ord("3")
    file.write_bytes(before[:place] + bytes([changed]) + before[place + 1 :])
    return file, before


def _find(part: Path, orchestrator: int, target: str) -> int | None:
    """The process of a part, which has its log for standard error; None if there is none yet."""
    if target == ORCHESTRATOR:
        return orchestrator
    name = "world" if target == FORK_SERVER else target
    log = str(part / "logs" / f"{name.replace(' ', '-') if ' ' in name else f'{name}-0'}.log")
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if os.readlink(process / "fd" / "2") == log:
                pid = int(process.name)
                if target != FORK_SERVER:
                    return pid
                # What a fork server leaves behind is adopted by the orchestrator, or by the system's first process.
                parent = parent_of(pid)
                return parent if parent not in (orchestrator, 1) else None
    return None


def left(mark: str, temporary: Path) -> list[str]:
    deadline = time.monotonic() + GONE_WITHIN_S
    while time.monotonic() < deadline and (marked(mark, trackers=True) or any(temporary.iterdir())):
        time.sleep(0.05)
    return [f"process {pid}" for pid in marked(mark, trackers=True)] + [path.name for path in temporary.iterdir()]
