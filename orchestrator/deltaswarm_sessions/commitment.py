"""A commitment to a session's plan and code before the first participant: its hash can be published, and shows neither.

The hash covers a random nonce, so nobody can find the plan by trying plans.
"""

import json
import secrets
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import frozen, provenance
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.frozen import HASH, Entry, Table, as_read, changed_keys
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.scenario import Scenario, content_of
from deltaswarm_sessions import roster
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.roster import COMMITMENT
from deltaswarm_sessions.settings import SessionSettings
from deltaswarm_sessions.variables import MEASURES
from deltaswarm_wire import checked

ENTRY = {"date": str, "code": dict, "nonce": str, "plan": dict, HASH: str}
NAME = "session"

MAX_NAMED = 8
"""Maximum number of differing values named in a message."""

OF_PARTICIPANT = (
    "schema",
    "operator.probes.participant",
    "operator.probes.condition",
    "operator.probes.consent",
    "operator.probes.form",
    "operator.page.end_text",
    "operator.page.place",
    "operator.page.language.",
)
"""Scenario keys that differ between participants or places, and follow from the session's own table."""


def plan_of(settings: SessionSettings, beside: Path) -> Table:
    """Return what a session fixes: design and seed, questions, exclusions, scenarios, and which measures there are."""
    runs = plan(settings, 1, beside)
    return as_read(
        {
            "session": checked.plain(settings),
            "consent": (beside / settings.consent).read_text(encoding="utf-8") if settings.consent else "",
            "scenario": {run.label: _of_condition(run.scenario) for run in sorted(runs, key=lambda run: run.label)},
            "measures": list(MEASURES),
        }
    )


def _of_condition(scenario: Scenario) -> Table:
    """Return the keys of a scenario that are the same in all runs of a condition, by dotted names."""
    return {name: value for name, value in flattened(content_of(scenario)) if not name.startswith(OF_PARTICIPANT)}


def freeze(settings: SessionSettings, beside: Path, sessions: Path) -> tuple[Path, str]:
    """Write the commitment before the first session; return its file and its hash."""
    entry = {
        "date": provenance.now(),
        "code": _code(),
        "nonce": secrets.token_hex(32),
        "plan": plan_of(settings, beside),
    }
    entry[HASH] = frozen.hash_of(entry, NAME)
    sessions.mkdir(parents=True, exist_ok=True)
    with roster.held(sessions):
        if was := read(sessions):
            raise CommandError(
                f"{sessions / COMMITMENT} must not be there yet: the plan was frozen on {was['date']} with the hash "
                f"{was[HASH]}; to change it, use another --out"
            )
        noted = roster.read(sessions)
        begun = [folder.name for folder in sorted(sessions.glob("participant-*"))]
        if begun := begun or [f"participant {number}" for number in sorted(noted.used)]:
            raise CommandError(
                f"the plan must be frozen before the first session (got {begun[0]} in {sessions}); use another --out"
            )
        file = frozen.write(sessions / COMMITMENT, entry, 0o600)
        roster.write(sessions, noted)
    return file, str(entry[HASH])


def read(sessions: Path) -> Table:
    """Return the commitment of a folder of sessions; {} if there is none."""
    file = sessions / COMMITMENT
    if not file.exists():
        return {}
    try:
        entry: Table = json.loads(file.read_text(encoding="utf-8"))
        frozen.check_entry(entry, ENTRY)
        if frozen.hash_of(entry, NAME) != entry[HASH]:
            raise ValueError("its content has another hash")
    except (OSError, ValueError, LookupError, TypeError):
        raise CommandError(f"{file} was changed or damaged after it was written; restore it") from None
    return entry


def check_plan(settings: SessionSettings, beside: Path, sessions: Path) -> tuple[str, list[str]]:
    """Refuse a plan that differs from the frozen one. Return the frozen hash and warnings; "" if nothing is frozen."""
    entry = read(sessions)
    if not entry:
        return "", []
    if changed := changed_keys(entry["plan"], plan_of(settings, beside)):
        raise CommandError(
            f"the plan must be as it was frozen on {entry['date']} (other values of {', '.join(changed[:MAX_NAMED])}): "
            "undo the change, or use another --out"
        )
    return str(entry[HASH]), [f"{line}: --against will show it" for line in code_problems(entry)]


def code_problems(entry: Entry) -> list[str]:
    """Say how the code in use differs from the frozen one."""
    was, now = entry["code"], _code()
    if was["digest"] == now["digest"]:
        return []
    return [f"the code must be that of version {was['version']}, commit {was['commit']} (got commit {now['commit']})"]


def run_problem(entry: Entry, label: str, seed: int, done: Scenario) -> str:
    """Say in which keys a run's scenario differs from the frozen one and its seed; empty if in none."""
    was = entry["plan"]["scenario"].get(label, {})
    changed = [*changed_keys(was, as_read(_of_condition(done))), *(["seed"] if done.seed != seed else [])]
    return f"must be as frozen (other values of {', '.join(changed[:MAX_NAMED])})" if changed else ""


def settings_of(entry: Entry) -> SessionSettings:
    return checked.load(SessionSettings, entry["plan"]["session"], "session")


def _code() -> dict[str, Any]:
    return {
        "version": provenance.versions()["deltaswarm"],
        "commit": provenance.commit(),
        "digest": provenance.code_digest(),
    }
