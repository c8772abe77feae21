"""The columns of the tables about participants and runs, with their meaning. Pure."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from deltaswarm_scenario.person_tables import Column

SITUATION_RIGHT_SHARE = "person.situation_right_share"
"""Path of the share of right answers about the situation, which is known only after the run."""

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
    "language": (
        TEXT,
        Column("", "tag of the page's language when the session last went on; empty: the page's own English"),
    ),
    "runs": (WHOLE, Column("", "runs that were planned")),
    "complete": (WHOLE, Column("", "runs that are complete")),
    "answers_missing": (WHOLE, Column("", "questions without an answer, in all complete runs")),
    "training_runs": (WHOLE, Column("", "training runs that are complete")),
    "training_outcome": (
        TEXT,
        Column("", "the training's criterion: reached, not reached, or open before its last run; empty: there is none"),
    ),
}

RUN_ITSELF = {
    "attempt": Variable(WHOLE, Column("", "number of the attempt at the run, from 1"), "attempt"),
    "scenario": Variable(TEXT, Column("", "name of the condition's scenario"), "scenario"),
    "set": Variable(TEXT, Column("", "scenario keys that the condition sets, divided by semicolons"), "set"),
    "complete": Variable(WHOLE, Column("", "1: it reached its last step"), "complete"),
    "valid": Variable(WHOLE, Column("", "1: nothing was lost on the fabric"), "valid"),
    "stream": Variable(WHOLE, Column("", "stream of arrivals, from 0; empty: one of its own"), "stream"),
    "seed": Variable(WHOLE, Column("", "seed of the run"), "seed"),
    "digest": Variable(TEXT, Column("", "digest of all messages"), "digest"),
    "training_value": Variable(
        NUMBER, Column("", "of a training run: what the training's criterion is about"), "training_value"
    ),
}
"""Which run it is, and what became of it."""

MEASURES = {
    "waiting_time_s": Variable(
        NUMBER, Column("s", "mean waiting time, restricted to the horizon"), "waiting_time_s.restricted_mean"
    ),
    "completion_s": Variable(NUMBER, Column("s", "mean time to complete an event, restricted"), "completion_s.mean"),
    "completed": Variable(WHOLE, Column("", "completed events"), "completed"),
    "messages_per_s": Variable(NUMBER, Column("1/s", "messages to the operator"), "operator_messages_per_s.mean"),
    "time_above_threshold_s": Variable(
        NUMBER, Column("s", "time with the message rate above the threshold"), "operator_time_above_threshold_s"
    ),
    "items": Variable(WHOLE, Column("", "items of the inbox"), "person.items"),
    "read": Variable(WHOLE, Column("", "items that were read"), "person.read"),
    "missed": Variable(WHOLE, Column("", "items that were unread for too long"), "person.missed"),
    "missed_share": Variable(
        NUMBER, Column("", "items that were unread for too long, as a share of all"), "person.missed_share"
    ),
    "acknowledge_s": Variable(NUMBER, Column("s", "mean time until an item was read"), "person.acknowledge_s"),
    "commands": Variable(WHOLE, Column("", "commands given"), "person.commands"),
    "commands_done": Variable(WHOLE, Column("", "commands carried out by an agent"), "person.commands_by_state.done"),
    "share_right": Variable(NUMBER, Column("", "reported events that were judged right"), "task.share_right"),
    "hits": Variable(WHOLE, Column("", "targets that were judged to be targets"), "task.hits"),
    "misses": Variable(WHOLE, Column("", "targets that were judged to be decoys"), "task.misses"),
    "false_alarms": Variable(WHOLE, Column("", "decoys that were judged to be targets"), "task.false_alarms"),
    "correct_rejections": Variable(
        WHOLE, Column("", "decoys that were judged to be decoys"), "task.correct_rejections"
    ),
    "unjudged": Variable(WHOLE, Column("", "reported events without a judgement"), "task.unjudged"),
    "d_prime": Variable(NUMBER, Column("", "sensitivity d' of the judgements, log-linear"), "task.d_prime"),
    "criterion": Variable(NUMBER, Column("", "criterion c of the judgements; above 0: rather decoy"), "task.criterion"),
    "situation_right_share": Variable(
        NUMBER,
        Column("", "right answers about the situation (SAGAT, SPAM), as a share of those asked for"),
        SITUATION_RIGHT_SHARE,
    ),
    "isa": Variable(NUMBER, Column("", "mean ISA answer, from 1 to 5"), "person.isa"),
    "questions": Variable(WHOLE, Column("", "questions asked"), "person.questions"),
    "answers_missing": Variable(WHOLE, Column("", "questions without an answer"), "person.answers_missing"),
    "tlx_raw": Variable(NUMBER, Column("", "NASA-TLX, mean of the six scales, from 0 to 100"), "person.tlx.raw"),
    "tlx_weighted": Variable(NUMBER, Column("", "NASA-TLX, weighted by the 15 pairs"), "person.tlx.weighted"),
}
"""What the participant and the swarm did in it."""

RUN = RUN_ITSELF | MEASURES


def value_at(summary: Mapping[str, Any], path: str) -> Any:
    """Return what a run's summary has at a dotted name, with 1 for true; None if it has nothing there."""
    value: Any = summary
    for name in path.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return int(value) if isinstance(value, bool) else value
