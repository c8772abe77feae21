"""What the conductor is told of the person: the newest acts and answers. Pure."""

from collections import deque
from collections.abc import Iterable
from typing import Any

from deltaswarm_scenario.isa import ISA
from deltaswarm_scenario.person_tables import OperatorAction, ProbeRow

ACT_COLUMNS = ("time_s", "kind", "by", "name", "target", "value", "items", "event", "text")
"""Columns of an act that the page shows."""

ACTS_KEPT = 200


class RecentActs:
    """What the conductor is told of the person: the newest acts and answers, also for a page that connects late."""

    def __init__(self) -> None:
        self.acts: deque[dict[str, Any]] = deque(maxlen=ACTS_KEPT)

    def take(self, rows: Iterable[OperatorAction | ProbeRow]) -> list[dict[str, Any]]:
        """Return the acts in new rows, for the page."""
        new = [act for row in rows if (act := act_of(row)) is not None]
        self.acts += new
        return new


def act_of(row: OperatorAction | ProbeRow) -> dict[str, Any] | None:
    """Return a row in the page's format; None for an answer to ISA, which is an act too."""
    if isinstance(row, OperatorAction):
        return {name: value for name in ACT_COLUMNS if (value := getattr(row, name)) not in ("", None)}
    if row.probe == ISA and row.value is not None:
        return None
    value = "no answer" if row.value is None else row.value
    return {"time_s": row.asked_s, "kind": "answer", "name": f"{row.probe}: {row.item}", "value": value}
