"""Each command, killed with -9 as it starts, in its midst and as it ends: no process outlives it by five seconds."""

import os
import pty
import subprocess
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.studying import OWN, SWEEP
from tests.support.swarms import COMMAND, SMOKE_PROCESSES, UNHURRIED, kill, running, wait_until
from tests.support.sweeping import MARK, all_gone, marked, written

pytestmark = pytest.mark.processes

GONE_WITHIN_S = 5.0
"""On a machine with a core for each process that wants one."""


class Killed(NamedTuple):
    process: subprocess.Popen[bytes]
    mark: str
    folder: Path
    """Where it writes."""

    def has(self, *patterns: str) -> bool:
        return any(next(self.folder.glob(pattern), None) for pattern in patterns)

    def has_processes(self, count: int) -> bool:
        return len(marked(self.mark)) >= count


Stage = Callable[[Killed], bool]


def exists(*patterns: str) -> Stage:
    return lambda killed: killed.has(*patterns)


def processes(count: int) -> Stage:
    return lambda killed: killed.has_processes(count)


def printed(killed: Killed) -> bool:
    """The stage at which a command has printed something."""
    assert killed.process.stdout is not None
    return bool(killed.process.stdout.peek(1))  # type: ignore[attr-defined]


RUN_ENDS = exists("out.part/series.csv", "out")
SMOKE = ("run", "smoke", "--out", "{out}")
STATION = (*SMOKE, "--station", "--speed", "0")
SWEEPING = ("sweep", "{sweep}", "--out", "{out}")
STUDYING = ("study", "{study}", "--out", "{out}")
EXPORTING = ("export", "{run}", "--format", "csv", "--out", "{out}")

CASES: dict[str, tuple[tuple[str, ...], Stage]] = {
    "run, start": (SMOKE, exists("out.part")),
    "run, middle": ((*SMOKE, *UNHURRIED), processes(SMOKE_PROCESSES + 2)),
    "run, end": (SMOKE, RUN_ENDS),
    "run --station, start": (STATION, exists("out.part")),
    "run --station, middle": ((*STATION, *UNHURRIED), processes(SMOKE_PROCESSES + 3)),
    "run --station, end": (STATION, RUN_ENDS),
    "replay, start": (("replay", "{run}"), processes(1)),
    "replay, middle": (("replay", "{run}"), printed),
    "sweep, start": (SWEEPING, exists("out")),
    "sweep, middle": (SWEEPING, exists("out/runs/*.json")),
    "sweep, end": (SWEEPING, exists("out/table.csv")),
    "sweep --processes, middle": ((*SWEEPING, "--processes", "-j", "1"), processes(SMOKE_PROCESSES)),
    "study, start": (STUDYING, exists("out")),
    "study, middle": (STUDYING, exists("out/**/*.json")),
    "study, end": (STUDYING, exists("out/**/*.csv")),
    "export, start": (EXPORTING, processes(1)),
    "export, middle": (EXPORTING, exists("out*")),
    "top, start": (("top", "{live}"), processes(1)),
    "top, middle": (("top", "{live}"), printed),
    "station, start": (("station", "{live}"), processes(1)),
}
SLOW = {name for name in CASES if name.split(",")[0] in ("study", "export", "sweep --processes")}
SLOW |= {"run, end", "run --station, start", "run --station, end", "sweep, start", "sweep, end", "top, start"}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What commands read: a recorded run, a sweep and a study."""
    folder = tmp_path_factory.mktemp("files")
    subprocess.run([*COMMAND, "run", "smoke", "--in-process", "--out", str(folder / "run")], check=True)
    study = folder / "study.toml"
    study.write_text(SWEEP.replace("1000.0", "300.0").replace("repeats = 10", "repeats = 1") + OWN)
    return {"run": str(folder / "run"), "sweep": str(written(folder)), "study": str(study)}


@contextmanager
def started(command: list[str], folder: Path, *, on_terminal: bool) -> Iterator[Killed]:
    """The command under way, with its output on a terminal or a pipe; nothing is left of it afterwards."""
    mark, terminal, other_end = uuid.uuid4().hex, *pty.openpty()
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), other_end)
    if not on_terminal:
        streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    environment = {**os.environ, MARK: mark, "TMPDIR": str(folder)}
    process = subprocess.Popen([*COMMAND, *command], **streams, env=environment, start_new_session=True)  # type: ignore[call-overload]
    os.close(other_end)
    process.stdout = process.stdout or os.fdopen(terminal, "rb", closefd=False)
    try:
        yield Killed(process, mark, folder)
    finally:
        kill(marked(mark))
        process.wait()
        process.stdout.close()
        os.close(terminal)


def patience_s() -> float:
    """The five seconds, longer on a machine on which more processes want to run than it has cores."""
    return GONE_WITHIN_S * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in CASES])
def test_no_process_outlives_a_command_that_is_killed(name: str, files: dict[str, str], tmp_path: Path) -> None:
    """It can do nothing itself any more, so all that it has started must notice."""
    words, stage = CASES[name]
    folder = tmp_path / "killed"
    folder.mkdir()
    options = {**files, "out": str(folder / "out"), "live": str(tmp_path / "live")}
    command = [word.format(**options) for word in words]
    with ExitStack() as stack:
        if "{live}" in words:
            pages = ["--station"] if words[0] == "station" else []
            live = stack.enter_context(running(tmp_path / "live", *UNHURRIED, *pages))
            if pages:  # its first step waits for a person
                wait_until((tmp_path / "live.part" / "station.json").exists, "the page's address")
            else:
                live.wait_until_under_way()
        killed = stack.enter_context(started(command, folder, on_terminal=words[0] == "top"))
        wait_until(lambda: stage(killed) or killed.process.poll() is not None, f"the stage {name}")
        killed.process.kill()
        killed.process.wait()
        all_gone(killed.mark, patience_s())
