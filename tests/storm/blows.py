"""One blow per run, at a random time to a random part, and a judge that knows which cause must be told first."""

import json
import re
import signal
from pathlib import Path
from random import Random

from deltaswarm_orchestrator.base.exits import INTERRUPTED
from tests.storm.storm import AGENTS, FORK_SERVER, ORCHESTRATOR, QUIET, Blow, Seen, strike
from tests.support.swarms import UNHURRIED, sets

ENDING = (signal.SIGTERM, signal.SIGHUP, signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT)
"""Signals that end a part, some of which it may heed."""

HEEDED = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
"""Signals on which the orchestrator ends the run in order."""

SETS = ("run.duration_s=200", "run.step_timeout_s=1", "run.start_timeout_s=8")
OVER_S = 5.0
"""Blows come within so long after the launch [s]; a part that is not there by then is struck as soon as it is."""

LATER = (r"operator (lost its world|was (killed|ended) by SIG\w+|has not) .*", r"agent \d+ lost its world.*")
"""What may follow from the end of another part."""


def draw(rng: Random) -> Blow:
    """Draw a blow; a part that is stopped is continued in half of the runs, the orchestrator always."""
    target = rng.choice([ORCHESTRATOR, FORK_SERVER, *2 * ("world", "operator"), f"agent {rng.randrange(AGENTS)}"])
    heeded = (signal.SIGINT,) if target == ORCHESTRATOR else ()
    number = rng.choice([*ENDING, *heeded, signal.SIGSTOP])
    at_s = rng.uniform(0.0, OVER_S)
    goes_on = number == signal.SIGSTOP and (target == ORCHESTRATOR or rng.random() < 0.5)
    return Blow(at_s, target, number, at_s + rng.uniform(0.5, 3.0) if goes_on else None)


def play_and_judge(folder: Path, rng: Random) -> tuple[Seen, list[str]]:
    """Play a run below `folder` with one blow; return what does not hold, one line each."""
    blow = draw(rng)
    seen = Seen("one blow", [blow])
    strike(folder, seen, [*sets(*SETS), *UNHURRIED], QUIET, waits=True)
    return seen, _judge(folder, seen, blow)


def _judge(folder: Path, seen: Seen, blow: Blow) -> list[str]:
    if seen.code is None:
        return ["it does not end in time"]
    found = [f"left behind: {what}" for what in seen.left]
    if "Traceback" in seen.printed:
        found.append("a traceback")
    if seen.landed and blow.target == ORCHESTRATOR and blow.number in set(ENDING) - set(HEEDED):
        return found + ([] if seen.code == -blow.number else [f"exit code {seen.code}"])
    if (folder / "run.part").exists():
        found.append("a .part is left")
    run = folder / "run"
    if not (run / "summary.json").exists():
        is_early = blow.target == ORCHESTRATOR and seen.code == INTERRUPTED and not run.exists()
        return found if is_early else [*found, "no summary"]
    summary, manifest = (json.loads((run / f"{name}.json").read_text()) for name in ("summary", "manifest"))
    return found + _told(summary, manifest, seen, blow)


def _told(summary: dict, manifest: dict, seen: Seen, blow: Blow) -> list[str]:
    """Whether summary and manifest tell of this blow, first of all, and of nothing else."""
    why, name, target = summary["why"], blow.number.name, re.escape(blow.target)
    is_complete = summary["complete"]
    found = [] if manifest["why"] == why else ["manifest and summary differ"]
    if is_complete != (manifest["exit_reason"] == "finished"):
        found.append(f"complete {is_complete}, {manifest['exit_reason']!r}")
    if (seen.code == 0) != summary["valid"]:
        found.append(f"exit code {seen.code} and valid {summary['valid']}")
    expected, may_be_silent = f"{target} was (killed|ended) by {name}.*", is_complete
    if blow.target == FORK_SERVER or not seen.landed or blow.goes_on_at_s is not None:
        expected, may_be_silent = "", True  # nothing is lost: the run is as if nothing had been
        may_hang = seen.landed and blow.target.startswith("agent")  # for longer than a step waits
        found += [] if is_complete and (summary["valid"] or may_hang) else [f"not complete and valid: {why}"]
    elif blow.target == ORCHESTRATOR:
        expected, may_be_silent = "", True
        if not is_complete and manifest["exit_reason"] != f"stopped by {name}":
            found.append(f"exit reason {manifest['exit_reason']!r}")
    elif blow.number == signal.SIGSTOP:
        expected = {
            "world": "the world said nothing .*is stopped by a signal|world was not ready .*",
            "operator": "operator was stopped by a signal; .*",
        }.get(blow.target, f"{target} was stopped by a signal; .*")
        may_be_silent = is_complete
    counts, is_agent = summary["agent_steps"], blow.target.startswith("agent")
    missed = (counts["due"] or 0) - (counts["answered"] or 0)
    if is_complete and missed and not is_agent:
        found.append(f"{missed} agent-steps without an answer, though no agent was struck")
    if is_complete and not missed and is_agent and why:
        found.append("every agent-step is answered, though an agent ended")
    if not why:
        return found if may_be_silent else [*found, "why is empty"]
    if not re.fullmatch(expected, why[0]):
        found.append(f"why begins with {why[0]!r}")
    found += [f"why says {line!r}" for line in why[1:] if not any(re.fullmatch(one, line) for one in LATER)]
    return found
