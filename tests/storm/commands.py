"""Commands that work on folders, disturbed, and judged: `python -m tests.storm --commands`.

Each storm takes one of `sweep`, `value`, `branch` and `session`, and kills it at a random moment, edits a file that
decides its runs, leaves it no room on the disk, or gives it twice at once. Then it is given again, in peace. What must
hold: no traceback, no process left, a result equal to that of an undisturbed command, and no lost withdrawal.
"""

import contextlib
import csv
import io
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from deltaswarm_cli.main import main as deltaswarm
from deltaswarm_sessions import roster
from tests.support.branching import SCRIPT
from tests.support.sessions import a_file, a_participant
from tests.support.swarms import COMMAND, wait_until
from tests.support.sweeping import kill, marked, marked_command

KILL, EDIT, FULL, TWICE = BLOWS = ("kill", "edit", "full disk", "twice")
ENDED_WITHIN_S = 20.0
"""After its command has ended, how long a process may take to end."""

WALKER = """
from dataclasses import dataclass

from deltaswarm_agent.controller import Decision

class Walker:
    @dataclass(frozen=True)
    class Settings:
        pass

    def __init__(self, context):
        self.speed = context.shared.speed_mps * SLOWER

    def step(self, percept):
        return Decision((self.speed, 0.0), tuple(event.event for event in percept.events))
"""
RIGHT, EDITED = "\nSLOWER = 0.5\n", "\nSLOWER = 0.9\n"
SWEEP = """
schema = 1
base = "smoke"
[sweep]
repeats = 4
prove = 1
[scenario]
run.duration_s = 400
control.mode = "storm_walker:Walker"
[sweep.axes]
"agents.count" = [4, 6]
"""
PARTICIPANTS = 6


@dataclass
class Ground:
    """The folders of a storm, and the command that it strikes."""

    folder: Path
    command: list[str]
    result: Callable[["Ground"], Any]
    """What must come of the command, whatever struck it."""
    again: list[str] = field(default_factory=list)
    """Options of the command when it is given again."""

    @property
    def module(self) -> Path:
        return self.folder / "storm_walker.py"


def _prepared(*words: str) -> None:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        assert deltaswarm(words) == 0


def sweep(folder: Path, random: Random) -> Ground:
    """Prepare a sweep with a controller of its own."""
    (folder / "sweep.toml").write_text(SWEEP)
    means = random.choice([["--jobs", "2"], ["--jobs", "1"]])
    return Ground(folder, ["sweep", str(folder / "sweep.toml"), "--quiet", "--out", str(folder / "out"), *means], rows)


def rows(ground: Ground) -> Any:
    """Return what the runs of a sweep gave: every column but where and when."""
    left_out = ("wall", "steps_per_s", "real_time", "code", "commit")
    with (ground.folder / "out" / "table.csv").open(newline="") as stream:
        return [
            {key: cell for key, cell in row.items() if not key.startswith(left_out)} for row in csv.DictReader(stream)
        ]


def _a_run(folder: Path) -> Path:
    sets = (SCRIPT, "run.duration_s=160", "control.mode=hybrid")
    options = [part for text in sets for part in ("--set", text)]
    _prepared("run", "smoke", "--in-process", "--quiet", "--out", str(folder / "run"), *options)
    return folder / "run"


def value(folder: Path, random: Random) -> Ground:
    run = _a_run(folder)
    jobs = str(random.choice([1, 2]))

    def result(ground: Ground) -> Any:
        return (run / "value" / "commands_value.csv").read_text()

    return Ground(folder, ["value", str(run), "--replicates", "3", "--jobs", jobs, "--quiet"], result)


def branch(folder: Path, random: Random) -> Ground:
    run, at_s = _a_run(folder), random.choice(["30", "77", "89"])

    def result(ground: Ground) -> Any:
        return json.loads((folder / "branch" / "summary.json").read_text())["digest"]

    options = ["--at", at_s, "--drop-command", "1", "--quiet", "--out", str(folder / "branch")]
    return Ground(folder, ["branch", str(run), *options], result, ["--force"])


def session(folder: Path, random: Random) -> Ground:
    """Prepare the sessions of some participants, of whom one withdraws."""
    for number in range(1, PARTICIPANTS + 1):
        a_participant(folder / "out", number, "AB")
    command = ["session", str(a_file(folder, 2)), "--out", str(folder / "out")]
    _prepared(*command, "--table", str(folder / "data"), "--wide", "--format", "bids")
    number = random.randint(1, PARTICIPANTS)

    def result(ground: Ground) -> Any:
        with (folder / "data" / "participants.tsv").open(newline="") as stream:
            there = {row["participant"] for row in csv.DictReader(stream, delimiter="\t") if not row.get("withdrawn")}
        with (folder / "data" / "runs.tsv").open(newline="") as stream:
            there &= {row["participant"] for row in csv.DictReader(stream, delimiter="\t")}
        noted = roster.read(folder / "out")
        left = [path.name for path in (folder / "out").glob(f"participant-{number:03}*")]
        return sorted(there), sorted(one.participant for one in noted.withdrawn), noted.unfinished, left

    return Ground(folder, [*command, "--withdraw", str(number)], result)


COMMANDS = (sweep, value, branch, session)


def play_and_judge(below: Path, random: Random) -> tuple[str, list[str]]:
    """Strike a command, give it again, and judge; return what was done, and what did not hold."""
    (folder := below / "here").mkdir()
    ground = random.choice(COMMANDS)(folder, random)
    ground.module.write_text(WALKER + RIGHT)
    blow = random.choice(BLOWS if ground.command[0] == "sweep" else (KILL, FULL, TWICE))
    os.environ["PYTHONPATH"] = os.pathsep.join([str(folder), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
    began = time.monotonic()
    peaceful = _elsewhere(ground)
    at_s = random.uniform(0.0, 1.1 * (time.monotonic() - began))
    wrong = _struck(ground, blow, at_s, random)
    ground.module.write_text(WALKER + RIGHT)
    code, printed = _given(ground, *ground.again)
    code, printed = _given(ground) if code and not ground.again else (code, printed)
    if code:
        wrong.append(f"given again, it ended with {code}: {printed.strip().splitlines()[-1:]}")
    elif ground.result(ground) != peaceful:
        wrong.append("its result is another than that of an undisturbed command")
    return f"{ground.command[0]:8} {blow:10} at {at_s:4.1f} s", wrong


def _elsewhere(ground: Ground) -> Any:
    """Return the result of the undisturbed command; all is as before."""
    kept = ground.folder.with_name(f"{ground.folder.name}-before")
    shutil.copytree(ground.folder, kept)
    code, printed = _given(ground)
    assert code == 0, printed
    found = ground.result(ground)
    shutil.rmtree(ground.folder)
    kept.rename(ground.folder)
    return found


def _given(ground: Ground, *options: str) -> tuple[int, str]:
    done = subprocess.run([*COMMAND, *ground.command, *options], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def _struck(ground: Ground, blow: str, at_s: float, random: Random) -> list[str]:
    """Strike the command when it has run for `at_s`; return what did not hold."""
    wrong = []
    limit = f"ulimit -f {random.choice([0, 1, 8, 40])}; exec " if blow == FULL else "exec "
    words = [*COMMAND, *ground.command]
    with marked_command("bash", "-c", f'{limit}"$@"', "bash", *words) as (process, mark):
        if blow == KILL:
            time.sleep(at_s)
            process.send_signal(signal.SIGKILL)
        elif blow == EDIT:
            time.sleep(at_s)
            ground.module.write_text(WALKER + EDITED)
        elif blow == TWICE:
            time.sleep(at_s / 2)
            code, printed = _given(ground, *random.choice([[], ground.again]))
            wrong += _of_output(printed) + ([f"the second ended with {code}"] if code not in (0, 1, 2) else [])
        printed = "".join(process.communicate())
        wrong += _of_output(printed)
        if blow in (FULL, EDIT, TWICE) and process.returncode not in (0, 1, 2):
            wrong.append(f"it ended with {process.returncode}")
        try:
            wait_until(lambda: not marked(mark, trackers=True), "the end of all processes", ENDED_WITHIN_S)
        except AssertionError:
            wrong.append(f"processes left: {marked(mark, trackers=True)}")
            kill(marked(mark, trackers=True))
    return wrong


def _of_output(printed: str) -> list[str]:
    return ["a traceback"] if "Traceback (most recent call last)" in printed else []
