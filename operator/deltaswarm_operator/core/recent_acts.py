"""The newest acts and answers of the participant, for the conductor's page. Pure."""

from collections import deque
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from deltaswarm_scenario.person_tables import OperatorAction, ProbeRow
from deltaswarm_scenario.questions import FORM
from deltaswarm_scenario.techniques import TECHNIQUES

ACT_COLUMNS = ("time_s", "kind", "by", "name", "target", "value", "items", "event", "text")

ACTS_KEPT = 200
ANSWERED = {FORM, *(technique.kind for technique in TECHNIQUES if technique.title)}
"""Kinds of acts that are told by their answers."""


class RecentActs:
    """Keeps the newest acts and answers, also for a page that connects late."""

    def __init__(self) -> None:
        self.acts: deque[dict[str, Any]] = deque(maxlen=ACTS_KEPT)

    def take(self, rows: Sequence[OperatorAction | ProbeRow]) -> list[dict[str, Any]]:
        """Return the acts in new rows, for the page: one for each form, whose answers are rows of their own."""
        new = [act_of(row) for row in rows if isinstance(row, OperatorAction) and row.kind not in ANSWERED]
        answers = [row for row in rows if isinstance(row, ProbeRow)]
        new += [answers_of(list(form)) for _, form in groupby(answers, lambda row: (row.probe, row.number))]
        self.acts += new
        return new


def act_of(row: OperatorAction) -> dict[str, Any]:
    return {name: value for name in ACT_COLUMNS if (value := getattr(row, name)) not in ("", None)}


def answers_of(rows: Sequence[ProbeRow]) -> dict[str, Any]:
    values = [(row.item, (row.outcome or "no answer") if row.value is None else row.value) for row in rows]
    given = [f"{item}: {value}" if item != rows[0].probe else str(value) for item, value in values]
    time_s = rows[0].planned_s if rows[0].asked_s is None else rows[0].asked_s
    return {"time_s": time_s, "kind": "answer", "name": rows[0].probe, "text": "; ".join(given)}
