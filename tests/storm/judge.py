"""What must hold of a run, whatever was done to it."""

import csv
import json
import re
import signal
from pathlib import Path
from random import Random

from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, USAGE
from deltaswarm_orchestrator.inspect import info
from deltaswarm_orchestrator.processes.process import HOW, UNKNOWN
from deltaswarm_orchestrator.recording import ACTIONS
from deltaswarm_orchestrator.recording.reader import read_recording
from tests.storm.storm import FORK_SERVER, ORCHESTRATOR, Seen, can_be_resumed, edit, play, resume

KILL = signal.SIGKILL
KILLED = re.compile(r"(.+) was killed by (SIG[A-Z]+)(?: (?:in|after) step \d+)?")


def play_and_judge(folder: Path, rng: Random) -> tuple[Seen, list[str]]:
    """Play a stormy run below `folder`, and resume it if it can be; return what does not hold, one line each."""
    seen = play(folder, rng)
    found = _judge(folder, seen)
    if seen.code != 0 and (run := can_be_resumed(folder)):
        file, before = edit(run, rng)
        refused = resume(run)
        file.write_bytes(before)
        if refused.returncode != USAGE or len(refused.stderr.splitlines()) != 1:
            return seen, [*found, f"a run whose {file.name} was edited is resumed: {refused.stderr}"]
        resumed = resume(run)
        seen.printed += resumed.stdout + resumed.stderr
        if not json.loads((folder / "run" / "summary.json").read_text())["complete"]:
            found.append(f"the resumed run ended with exit code {resumed.returncode}, and is not complete")
        problems = _records(folder / "run", resumed.returncode, was_killed=False)
        found += [f"resumed: {problem}" for problem in problems]
    return seen, found


def _judge(folder: Path, seen: Seen) -> list[str]:
    if seen.code is None:
        return ["it does not end in time"]
    found = [f"left behind: {what}" for what in seen.left]
    if "Traceback" in seen.printed:
        found.append("a traceback")
    part, run = folder / "run.part", folder / "run"
    if part.exists() and run.exists():
        found.append("both the run's folder and its .part are there")
    was_killed = seen.landed_on(ORCHESTRATOR, KILL)
    if run.exists():
        return found + _records(run, seen.code, was_killed) + _whys(run, seen)
    if part.exists():
        return found + (_of_a_killed(part) if was_killed else ["a .part without a killed orchestrator"])
    return (
        found if was_killed or seen.code in (FAILED, INTERRUPTED) else [*found, f"no folder, and exit code {seen.code}"]
    )


def _records(run: Path, code: int, was_killed: bool) -> list[str]:
    """Exit code, manifest, summary, recording and `info` tell one story."""
    found = []
    manifest, summary = (json.loads((run / f"{name}.json").read_text()) for name in ("manifest", "summary"))
    if manifest["exit_reason"] == "running":
        found.append("the manifest says it is running")
    complete = {summary["complete"], manifest["complete"], manifest["exit_reason"] == "finished"}
    if len(complete) != 1:
        found.append(f"complete or not: {summary['complete']}, {manifest['complete']}, {manifest['exit_reason']!r}")
    if not was_killed and (code == 0) != summary["valid"]:
        found.append(f"exit code {code} and valid {summary['valid']}")
    if manifest["why"] != summary["why"] or (manifest["exit_reason"] == "failed" and not summary["why"]):
        found.append(f"why: {manifest['why']} and {summary['why']}")
    state = info.describe(run)["state"]
    if (state == "complete") != summary["complete"] or state.startswith("running"):
        found.append(f"info says {state!r}")
    if (run / ACTIONS).exists():
        rows = list(csv.DictReader((run / ACTIONS).read_text().splitlines()))
        times = [float(row["time_s"]) for row in rows]
        found += ["the operator's table goes back in time, or has a row twice"] * (
            times != sorted(times) or len({tuple(row.items()) for row in rows}) != len(rows)
        )
    return found + _recording(run)


def _whys(run: Path, seen: Seen) -> list[str]:
    """Who is said to have been killed was, by that signal; nobody ends for an unknown reason.

    And why it failed begins with one that was struck.
    """
    manifest = json.loads((run / "manifest.json").read_text())
    struck = {(blow.target, blow.number.name) for blow in seen.landed}
    killed = [match.groups() for line in manifest["why"] if (match := KILLED.fullmatch(line))]
    found = [f"why says {part} was killed by {name}" for part, name in killed if (part, name) not in struck]
    found += [f"why says: {line}" for line in manifest["why"] if HOW[UNKNOWN] in line]
    targets = [target for target, _ in struck if target != FORK_SERVER]
    if manifest["exit_reason"] == "failed" and targets and not any(one in manifest["why"][0] for one in targets):
        found.append(f"why begins with none that was struck: {manifest['why']}")
    return found


def _of_a_killed(part: Path) -> list[str]:
    """What an orchestrator that was killed has left can be read, and is called what it is."""
    try:
        state = info.describe(part)["state"]
    except info.NotARunError as error:
        return [] if not (part / "scenario.toml").exists() else [f"info: {error}"]
    manifest = json.loads((part / "manifest.json").read_text())
    expected = "complete" if manifest["exit_reason"] == "finished" else "incomplete"
    found = [] if state.startswith(expected) else [f"info says {state!r} of a run that was killed"]
    return found + _recording(part)


def _recording(folder: Path) -> list[str]:
    try:
        if any(folder.glob("recording.mcap*")):
            read_recording(next(folder.glob("recording.mcap*")))
    except Exception as error:
        return [f"the recording: {error!r}"]
    return []
