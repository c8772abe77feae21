"""Questions to the person at the station: ISA during the run, NASA-TLX at its end.

ISA (instantaneous self-assessment): workload from 1 to 5, at intervals of simulated time with optional jitter. An
answer that does not come in time is missing. NASA-TLX: six scales from 0 to 100, raw, and optionally 15 pairwise
weights.
"""

import math
from collections.abc import Mapping
from random import Random
from typing import Any, NamedTuple

from deltaswarm_scenario.operator_settings import ProbeSettings
from deltaswarm_scenario.person_tables import ProbeRow

ISA, TLX, SHEET = "isa", "tlx", "sheet"
SCALES = ("mental", "physical", "temporal", "performance", "effort", "frustration")
PAIRS = 15


class _Asked(NamedTuple):
    kind: str
    number: int
    asked_s: float
    asked_wall_s: float
    held_s: float = 0.0
    """Wall time since then in which the run was held [s]."""

    def row(self, item: str, value: int | None = None, latency_s: float | None = None) -> ProbeRow:
        """Make the row of an answer to an item, or of its absence."""
        return ProbeRow(
            self.kind, self.number, item, value, self.asked_s, latency_s, asked_monotonic_s=self.asked_wall_s
        )


class Probes:
    """The questions of one run. `wall_s` is any monotonic clock, such as `time.monotonic`."""

    def __init__(self, settings: ProbeSettings, rng: Random) -> None:
        self.rows: list[ProbeRow] = []
        self._settings = settings
        self._rng = rng
        self.answers: list[int] = []
        """The answers to ISA."""
        self._missing = 0
        self._tlx: dict[str, float] = {}
        """The scores of NASA-TLX, once it is answered."""
        self._isa_number = 0
        self._isa_due_s = self._next_isa_s(0.0)
        self._asked: _Asked | None = None
        self._is_over = False
        self._is_consented = False
        self._held_since_wall_s: float | None = None

    def _next_isa_s(self, after_s: float) -> float:
        every_s = self._settings.isa_every_s
        if not every_s:
            return float("inf")
        return after_s + every_s + self._rng.uniform(0.0, self._settings.isa_jitter_s)

    def start(self, wall_s: float) -> None:
        """Ask for the session's sheet, if there is one not yet filled in."""
        if self._settings.has_sheet and not self._is_consented:
            self._asked = _Asked(SHEET, 0, 0.0, wall_s)

    @property
    def is_sheet_open(self) -> bool:
        """Whether the session's sheet must still be filled in."""
        return self._asked is not None and self._asked.kind == SHEET

    def hold(self, wall_s: float, *, is_held: bool) -> None:
        """Note that the run is held, or goes on: meanwhile the time for an answer does not pass."""
        if self._held_since_wall_s is not None and self._asked is not None:
            since_wall_s = max(self._held_since_wall_s, self._asked.asked_wall_s)
            self._asked = self._asked._replace(held_s=self._asked.held_s + wall_s - since_wall_s)
        self._held_since_wall_s = wall_s if is_held else None

    def _waited_s(self, asked: _Asked, wall_s: float) -> float:
        """Return how long a question has been open, without the time in which the run was held [wall s]."""
        held = self._held_since_wall_s
        held_s = 0.0 if held is None else wall_s - max(held, asked.asked_wall_s)
        return wall_s - asked.asked_wall_s - asked.held_s - held_s

    def state(self) -> dict[str, Any]:
        """Return all that is needed to resume, for JSON."""
        due_s = self._isa_due_s if math.isfinite(self._isa_due_s) else None
        open_isa_s = self._asked.asked_s if self._asked is not None and self._asked.kind == ISA else None
        return {
            "isa_number": self._isa_number,
            "isa_due_s": due_s,
            "open_isa_s": open_isa_s,
            "consented": self._is_consented,
            "answers": self.answers,
            "missing": self._missing,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Resume from another object's `state`; an ISA question open at that time is missing."""
        self._isa_number, self._is_consented = state["isa_number"], state["consented"]
        if state["open_isa_s"] is not None:
            self.rows.append(ProbeRow(ISA, self._isa_number - 1, ISA, None, state["open_isa_s"], None))
        self.answers, self._missing = list(state["answers"]), state["missing"]
        self._isa_due_s = math.inf if state["isa_due_s"] is None else state["isa_due_s"]

    def tick(self, now_s: float, is_last: bool, wall_s: float) -> None:
        """Ask the question that is due at a simulated time; a question not answered in time is missing."""
        self._expire(wall_s, at_once=is_last)
        if is_last:
            if self._settings.tlx and not self._is_over:
                self._asked = _Asked(TLX, 0, now_s, wall_s)
            self._is_over = True
        elif now_s >= self._isa_due_s and self._asked is None:
            self._asked = _Asked(ISA, self._isa_number, now_s, wall_s)
            self._isa_number += 1
            self._isa_due_s = self._next_isa_s(max(self._isa_due_s, now_s))

    def _expire(self, wall_s: float, *, at_once: bool) -> None:
        asked = self._asked
        if asked is None or asked.kind != ISA:
            return
        if at_once or self._waited_s(asked, wall_s) >= self._settings.isa_wait_s:
            self._miss(asked)

    def _miss(self, asked: _Asked) -> None:
        items = SCALES if asked.kind == TLX else (asked.kind,)
        self.rows += [asked.row(item) for item in items]
        self._missing += 1
        self._asked = None

    def close(self) -> None:
        """At the end, whoever still is asked has not answered."""
        if self._asked is not None and self._asked.kind != SHEET:
            self._miss(self._asked)

    def open(self, wall_s: float) -> dict[str, Any] | None:
        """Return the open question in the page's format, or None."""
        self._expire(wall_s, at_once=False)
        asked = self._asked
        if asked is None:
            return None
        if asked.kind != ISA:
            return {"kind": asked.kind}
        left_s = self._settings.isa_wait_s - self._waited_s(asked, wall_s)
        return {"kind": ISA, "number": asked.number, "asked_s": asked.asked_s, "left_s": round(left_s, 1)}

    def answer_isa(self, number: Any, answer: Any, wall_s: float) -> None:
        """Take an ISA answer. Raises ValueError: the question is not open, or the answer is not from 1 to 5."""
        self._expire(wall_s, at_once=False)
        asked = self._asked
        if asked is None or asked.kind != ISA or asked.number != number:
            raise ValueError("this question is no longer open")
        if type(answer) is not int or not 1 <= answer <= 5:
            raise ValueError("the answer must be from 1 to 5")
        self._add(asked, {ISA: answer}, wall_s)
        self.answers.append(answer)

    def answer_tlx(self, scales: Any, weights: Any, wall_s: float) -> None:
        """Take the NASA-TLX form. Raises ValueError: the form is not open, or not filled in correctly."""
        asked = self._asked
        if asked is None or asked.kind != TLX:
            raise ValueError("NASA-TLX is not open")
        _check_table(scales, 100, "each scale must be from 0 to 100")
        answers = {scale: scales[scale] for scale in SCALES}
        if self._settings.tlx_weights:
            _check_table(weights, 5, "each weight must be from 0 to 5")
            if sum(weights.values()) != PAIRS:
                raise ValueError(f"the weights must add up to {PAIRS}")
            answers |= {f"{scale} weight": weights[scale] for scale in SCALES}
        self._add(asked, answers, wall_s)
        self._tlx = {"raw": sum(scales.values()) / len(SCALES)}
        if self._settings.tlx_weights:
            self._tlx["weighted"] = sum(scales[scale] * weights[scale] for scale in SCALES) / PAIRS

    @property
    def outcomes(self) -> dict[str, Any]:
        """Numbers of questions and of missing answers, and the scores of NASA-TLX, for JSON."""
        asked = self._isa_number + bool(self._tlx) + (self._is_over and self._settings.tlx and not self._tlx)
        return {"questions": asked, "answers_missing": self._missing, "tlx": self._tlx or None}

    def take_sheet(self) -> None:
        """Note that the session's sheet is filled in. Raises ValueError: it is not open."""
        if not self.is_sheet_open:
            raise ValueError("the session's sheet is not open")
        self._asked = None
        self._is_consented = True

    def _add(self, asked: _Asked, answers: Mapping[str, int], wall_s: float) -> None:
        latency_s = round(self._waited_s(asked, wall_s), 3)
        for item, value in answers.items():
            self.rows.append(asked.row(item, value, latency_s)._replace(answered_monotonic_s=wall_s))
        self._asked = None


def _check_table(table: Any, most: int, problem: str) -> None:
    if not isinstance(table, Mapping) or table.keys() != set(SCALES):
        raise ValueError(f"an answer to each of {', '.join(SCALES)} is needed")
    if not all(type(value) is int and 0 <= value <= most for value in table.values()):
        raise ValueError(problem)
