"""Files of sessions, and sessions whose runs are pretended."""

from pathlib import Path
from typing import Any

from deltaswarm_sessions.plan import PlannedRun, plan
from deltaswarm_sessions.session import Attempt, Session
from deltaswarm_sessions.settings import load_session

FILE = """
schema = 1

[session]
speed = 5.0
consent = "consent.txt"

[session.training]
label = "training"
scenario = "smoke"
set = ["run.duration_s=60"]
"""
CONDITION = '\n[[session.condition]]\nlabel = "{0}"\nscenario = "smoke"\nset = ["control.delta={1}"]\n'


def a_file(folder: Path, conditions: int = 3, more: str = "") -> Path:
    """A session's file, and its text of consent."""
    file = folder / "deltas.toml"
    labels = "ABCDEFGHIJKL"[:conditions]
    file.write_text(FILE + more + "".join(CONDITION.format(label, 2 + n) for n, label in enumerate(labels)))
    (folder / "consent.txt").write_text('You may stop at any time.\nSay "stop".\n')
    return file


FORMS = """
[[session.form]]
name = "you"
when = "before"
question = [{ name = "age", text = "How old are you?", kind = "number", low = 18, high = 99 }]

[[session.form]]
name = "trust"
when = "between"
question = [{ name = "reliable", text = "The swarm is reliable." }, { name = "why", text = "Why?", kind = "text" }]

[[session.form]]
name = "end"
when = "after"
question = [{ name = "best", text = "Which run was best?", kind = "choice", choices = ["first", "second"] }]
"""


def with_criterion(metric: str = "read", bound: str = "at_least = 5", more: str = "") -> str:
    """The part of a session's file."""
    return f'\n[session.training.criterion]\nmetric = "{metric}"\n{bound}\n{more}\n'


def a_session(folder: Path, conditions: int = 2, more: str = "", participant: int = 1) -> Session:
    """A session of which nothing is done; its file has no text of consent."""
    settings, beside = load_session(str(a_file(folder, conditions, more)))
    return Session(participant, plan(settings, participant, beside))


def do(session: Session, run: PlannedRun, *, answered: tuple[str, ...] = (), **summary: Any) -> Attempt:
    """Pretend that a run has been done, completely unless its summary says otherwise."""
    number = len(session.attempts[run.folder]) + 1
    name = run.folder if number == 1 else f"{run.folder}-{number}"
    whole = {"complete": True, "digest": "ff", **summary}
    is_repeat = any(attempt.is_valid for attempt in session.attempts[run.folder])
    attempt = Attempt(name, whole, run.attempt(number, is_repeat=is_repeat), frozenset(answered))
    session.attempts[run.folder].append(attempt)
    return attempt
