"""Exclusion rules that a session's file states before the data are there, and their columns. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from deltaswarm_orchestrator.results.summary import value_at
from deltaswarm_scenario.columns import Column
from deltaswarm_wire.checked import key

EXCLUDED = "excluded"


@dataclass(frozen=True)
class ExclusionSettings:
    """The table `[session.exclude]`: bounds beyond which a run is marked in the tables. No row is removed."""

    max_page_away_s: float | None = key(None, "greatest time without an answering page [s]", low=0)
    max_page_hidden_s: float | None = key(None, "greatest time for which the page was hidden [s]", low=0)
    max_answers_missing: int | None = key(None, "greatest number of questions without an answer", low=0)
    max_questions_lost: int | None = key(
        None, "greatest number of planned questions that were not asked or were cut off", low=0
    )
    min_d_prime: float | None = key(None, "least sensitivity in the task; 0 is chance")
    min_answer_s: float | None = key(
        None,
        "least median time of the answers during the run [wall s], below which nobody has read the questions",
        low=0,
    )


class Rule(NamedTuple):
    """A column that says whether a run is beyond a bound, and the value that is compared."""

    column: str
    path: str
    meaning: str


RULES = {
    "max_page_away_s": Rule("away_too_long", "person.page_away_s", "the page did not answer for longer"),
    "max_page_hidden_s": Rule("hidden_too_long", "page_hidden_s", "the page was hidden for longer"),
    "max_questions_lost": Rule("too_many_lost", "person.questions_lost", "more planned questions are lost"),
    "max_answers_missing": Rule("too_many_missing", "person.answers_missing", "more answers are missing"),
    "min_d_prime": Rule("d_prime_too_low", "task.d_prime", "the sensitivity d' is less"),
    "min_answer_s": Rule("answers_too_fast", "median_answer_s", "the median time of answers is less"),
}
"""By the keys of the settings."""

COLUMNS = {
    **{
        rule.column: Column("", f"1: {rule.meaning} than session.exclude.{name}; empty: no such rule, or no value")
        for name, rule in RULES.items()
    },
    EXCLUDED: Column("", "1: one of these is 1; 0: none is; empty: the session's file states no rule"),
}


def exclusions(settings: ExclusionSettings, summary: Mapping[str, Any]) -> dict[str, int | None]:
    """Return the columns of a run. A bound itself is allowed, and a run without a value is not excluded by it."""
    found: dict[str, int | None] = {}
    for name, rule in RULES.items():
        bound, value = getattr(settings, name), value_at(summary, rule.path)
        if bound is None or value is None:
            found[rule.column] = None
        else:
            found[rule.column] = int(value > bound if name.startswith("max") else value < bound)
    is_stated = any(getattr(settings, field.name) is not None for field in fields(settings))
    return found | {EXCLUDED: int(any(found.values())) if is_stated else None}
