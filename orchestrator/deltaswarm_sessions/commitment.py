"""A commitment to a session's plan and code before the first participant: its hash can be published, and shows neither.

The hash covers a random nonce, so nobody can find the plan by trying plans. The canonical form is that of the frozen
protocols of studies.
"""

import json
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.scenario import Scenario, content_of
from deltaswarm_sessions import ledger
from deltaswarm_sessions.ledger import COMMITMENT
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.settings import SessionSettings
from deltaswarm_sessions.variables import MEASURES
from deltaswarm_wire import checked
from deltaswarm_wire.files import write_whole

ENTRY = {"date": str, "code": dict, "nonce": str, "plan": dict, "hash": str}

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


def plan_of(settings: SessionSettings, beside: Path) -> dict[str, Any]:
    """Return what a session fixes: design and seed, questions, exclusions, scenarios, and which measures there are."""
    runs = plan(settings, 1, beside)
    content = {
        "session": checked.plain(settings),
        "consent": (beside / settings.consent).read_text(encoding="utf-8") if settings.consent else "",
        "scenario": {run.label: fixed(run.scenario) for run in sorted(runs, key=lambda run: run.label)},
        "measures": list(MEASURES),
    }
    return dict(json.loads(json.dumps(content)))


def fixed(scenario: Scenario) -> dict[str, Any]:
    """Return the keys of a scenario that are the same in all runs of a condition, by dotted names."""
    return {name: value for name, value in flattened(content_of(scenario)) if not name.startswith(OF_PARTICIPANT)}


def freeze(settings: SessionSettings, beside: Path, sessions: Path) -> tuple[Path, str]:
    """Write the commitment before the first session; return its file and its hash.

    Raises:
        CommandError: there is one already, or a session has begun.
    """
    entry = {
        "date": provenance.now(),
        "code": _code(),
        "nonce": secrets.token_hex(32),
        "plan": plan_of(settings, beside),
    }
    found = hash_of(entry)
    data = json.dumps(entry | {"hash": found}, indent=2, ensure_ascii=False).encode() + b"\n"
    sessions.mkdir(parents=True, exist_ok=True)
    with ledger.held(sessions):
        if was := read(sessions):
            raise CommandError(
                f"{sessions / COMMITMENT} must not be there yet: the plan was frozen on {was['date']} with the hash "
                f"{was['hash']}; to change it, use another --out"
            )
        roster = ledger.read(sessions)
        begun = [folder.name for folder in sorted(sessions.glob("participant-*"))]
        if begun := begun or [f"participant {number}" for number in sorted(roster.used)]:
            raise CommandError(
                f"the plan must be frozen before the first session (got {begun[0]} in {sessions}); use another --out"
            )
        write_whole(sessions / COMMITMENT, data, 0o600)
        ledger.write(sessions, roster)
    return sessions / COMMITMENT, found


def hash_of(entry: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a commitment in canonical form, without the hash that is written in it."""
    from deltaswarm_studies import protocol  # imports pandas

    return protocol.hash_of(entry, "session", "")


def read(sessions: Path) -> dict[str, Any]:
    """Return the commitment of a folder of sessions; {} if there is none.

    Raises:
        CommandError: it cannot be read, or was changed.
    """
    file = sessions / COMMITMENT
    if not file.exists():
        return {}
    try:
        entry = json.loads(file.read_text(encoding="utf-8"))
        is_whole = (
            all(isinstance(entry[name], kind) for name, kind in ENTRY.items()) and hash_of(entry) == entry["hash"]
        )
    except (OSError, ValueError, LookupError, TypeError):
        is_whole = False
    if not is_whole:
        raise CommandError(f"{file} was changed or damaged after it was written; restore it")
    return dict(entry)


def check_plan(settings: SessionSettings, beside: Path, sessions: Path) -> tuple[str, list[str]]:
    """Return the hash that sessions of this plan are under, and warnings; "" and none if nothing was frozen.

    Raises:
        CommandError: the session's file, or a scenario in it, is no longer as it was frozen.
    """
    entry = read(sessions)
    if not entry:
        return "", []
    if changed := list(differences(entry["plan"], plan_of(settings, beside))):
        raise CommandError(
            f"the plan must be as it was frozen on {entry['date']} (other values of {', '.join(changed[:8])}): "
            "undo the change, or use another --out"
        )
    return str(entry["hash"]), [f"{line}: --against will show it" for line in code_problems(entry)]


def code_problems(entry: Mapping[str, Any]) -> list[str]:
    """Say how the code in use differs from the frozen one."""
    was, now = entry["code"], _code()
    if was["digest"] == now["digest"]:
        return []
    return [f"the code must be that of version {was['version']}, commit {was['commit']} (got commit {now['commit']})"]


def differences(old: Any, new: Any, path: str = "") -> Iterator[str]:
    """Yield the dotted names of values that differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in {**old, **new}:
            yield from differences(old.get(name), new.get(name), f"{path}.{name}" if path else name)
    elif old != new:
        yield path


def run_problems(entry: Mapping[str, Any], label: str, seed: int, done: Scenario) -> list[str]:
    """Name what of a run's scenario is not as it was frozen, or not what its place in the order demands."""
    changed = list(differences(entry["plan"]["scenario"].get(label), json.loads(json.dumps(fixed(done)))))
    return [*changed, *(["seed"] if done.seed != seed else [])]


def settings_of(entry: Mapping[str, Any]) -> SessionSettings:
    """Return the settings of a frozen session."""
    return checked.load(SessionSettings, entry["plan"]["session"], "session")


def _code() -> dict[str, Any]:
    return {
        "version": provenance.versions()["deltaswarm"],
        "commit": provenance.commit(),
        "digest": provenance.code_digest(),
    }
