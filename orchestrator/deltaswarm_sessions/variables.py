"""The columns of the tables about participants and runs, with their meaning. Pure."""

from typing import NamedTuple

from deltaswarm_orchestrator.results.summary import EVERY_KEY
from deltaswarm_scenario.columns import Column

WHOLE, NUMBER, TEXT = "whole number", "number", "text"


class Variable(NamedTuple):
    """A column made from a value in JSON, by the path to it."""

    kind: str
    column: Column
    path: str


KEYS = {
    "participant": (WHOLE, Column("", "the participant's number")),
    "condition": (TEXT, Column("", "label of the condition")),
    "position": (WHOLE, Column("", "place of the run in the participant's session; 0: the training")),
    "run": (TEXT, Column("", "folder of the run")),
}

PARTICIPANT = {
    "participant": KEYS["participant"],
    "withdrawn": (TEXT, Column("", "when the participant withdrew, after which no data is left; empty: did not")),
    "withdrawn_because": (TEXT, Column("", "the reason that was noted for it")),
    "pilot": (WHOLE, Column("", "1: of the pilot")),
    "allocated": (WHOLE, Column("", "the number that decided the order: another one if the number was corrected")),
    "language": (
        TEXT,
        Column("", "tag of the page's language when the session last went on; empty: the page's own English"),
    ),
    "runs": (WHOLE, Column("", "runs that were planned")),
    "complete": (WHOLE, Column("", "runs that are complete and valid")),
    "invalid": (WHOLE, Column("", "attempts that are complete and not valid: they are done again")),
    "answers_missing": (WHOLE, Column("", "questions without an answer, in all valid runs")),
    "training_runs": (WHOLE, Column("", "training runs that are complete and valid")),
    "training_outcome": (
        TEXT,
        Column("", "the training's criterion: reached, not reached, or open before its last run; empty: there is none"),
    ),
}

RUN_ITSELF = {
    "pilot": Variable(WHOLE, Column("", "1: of the pilot"), "pilot"),
    "attempt": Variable(WHOLE, Column("", "number of the attempt at the run, from 1"), "attempt"),
    "scenario": Variable(TEXT, Column("", "name of the condition's scenario"), "scenario"),
    "set": Variable(TEXT, Column("", "scenario keys that the condition sets, divided by semicolons"), "set"),
    "complete": Variable(WHOLE, Column("", "1: it reached its last step"), "complete"),
    "valid": Variable(WHOLE, Column("", "1: its numbers may be used"), "valid"),
    "invalid_because": Variable(TEXT, Column("", "if not, why: reasons, divided by semicolons"), "invalid_because"),
    "answered_share": Variable(
        NUMBER, Column("", "share of agent-steps that were answered in time"), "agent_steps.answered_share"
    ),
    "stream": Variable(WHOLE, Column("", "stream of arrivals, from 0; empty: one of its own"), "stream"),
    "seed": Variable(WHOLE, Column("", "seed of the run"), "seed"),
    "horizon_s": Variable(
        NUMBER, Column("s", "time for which events are followed: the ceiling of their times"), "horizon_s"
    ),
    "digest": Variable(TEXT, Column("", "digest of all messages"), "digest"),
    "training_value": Variable(
        NUMBER, Column("", "of a training run: what the training's criterion is about"), "training_value"
    ),
}
"""Which run it is, and what became of it."""

MEASURES = {
    metric.session: Variable(WHOLE if metric.is_whole else NUMBER, Column(metric.unit, metric.meaning), metric.key)
    for metric in EVERY_KEY
    if metric.session
}
"""What the participant and the swarm did in it."""

OF_SWARM = tuple(name for name, measure in MEASURES.items() if measure.path.split(".")[0] not in ("person", "task"))
"""Measures of the swarm: participants who give it no orders have the same value with the same stream."""

RUN = RUN_ITSELF | MEASURES

RESTRICTED = {metric.session for metric in EVERY_KEY if metric.session and metric.is_restricted}
"""Columns with times that the horizon bounds."""
