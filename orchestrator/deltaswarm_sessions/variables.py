"""The columns of the tables about participants and runs, with their meaning. Pure."""

from typing import NamedTuple

from deltaswarm_orchestrator.results.summary import EVERY_KEY
from deltaswarm_scenario.columns import MONOTONIC, Column
from deltaswarm_scenario.tlx import SCALES
from deltaswarm_sessions.exclusion import COLUMNS

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
    "frozen": (TEXT, Column("", "hash of the commitment to plan and code that was made before; empty: there is none")),
    "language": (
        TEXT,
        Column("", "tag of the page's language when the session last went on; empty: the page's own English"),
    ),
    "started": (TEXT, Column("", "when the first run began")),
    "order": (TEXT, Column("", "conditions in the order of the runs, divided by semicolons; also of runs to come")),
    "versions": (TEXT, Column("", "versions of deltaswarm in the runs, with the commits, divided by semicolons")),
    "consent": (TEXT, Column("", "SHA-256 of the text that the participant agreed to; empty: none was shown")),
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
    "started": Variable(
        TEXT, Column("", "when the run was started, before the participant filled in its sheet"), "started"
    ),
    "wall_duration_s": Variable(NUMBER, Column(MONOTONIC, "time from its first step to its last"), "wall_duration_s"),
    "screen": Variable(TEXT, Column("", "sizes of the page in pixels, in order, divided by semicolons"), "screen"),
    "page_hidden_s": Variable(
        NUMBER, Column(MONOTONIC, "time during the run for which its page was hidden behind another"), "page_hidden_s"
    ),
    "median_answer_s": Variable(
        NUMBER, Column(MONOTONIC, "median time of the answers during the run"), "median_answer_s"
    ),
    **{
        f"tlx_{scale}": Variable(NUMBER, Column("", f"NASA-TLX, {scale}, from 0 to 100"), f"tlx_scale.{scale}")
        for scale in SCALES
    },
    **{name: Variable(WHOLE, column, name) for name, column in COLUMNS.items()},
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

QUESTION = {
    "condition": KEYS["condition"],
    "probe": (TEXT, Column("", "as in probes.tsv")),
    "item": (TEXT, Column("", "as in probes.tsv")),
    "language": PARTICIPANT["language"],
    "text": (TEXT, Column("", "the question in this language; of ISA and NASA-TLX what it asks, in English")),
    "kind": (TEXT, Column("", "likert, number, text or choice")),
    "low": (NUMBER, Column("", "least answer")),
    "high": (NUMBER, Column("", "greatest answer")),
    "low_text": (TEXT, Column("", "meaning of the least answer")),
    "high_text": (TEXT, Column("", "meaning of the greatest answer")),
    "choices": (TEXT, Column("", "the answers to choose from, divided by semicolons")),
}

RESTRICTED = {metric.session for metric in EVERY_KEY if metric.session and metric.is_restricted}
"""Columns with times that the horizon bounds."""
