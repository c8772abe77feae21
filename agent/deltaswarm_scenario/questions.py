"""Forms that a person at the station fills in: questions, which answers they take, and those about the situation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from deltaswarm_wire.checked import Problem, key

LIKERT, NUMBER, TEXT, CHOICE = "likert", "number", "text", "choice"
BEFORE, AFTER = "before", "after"
MAX_TEXT, MAX_POINTS = 2000, 11


@dataclass(frozen=True)
class QuestionSettings:
    """One question of a form."""

    name: str = key("", "name of the answer in probes.csv")
    text: str = key("", "the question")
    kind: str = key(LIKERT, "likert: one of the points from low to high", choices=(LIKERT, NUMBER, TEXT, CHOICE))
    low: float = key(1.0, "least answer; what it means is low_text")
    high: float = key(7.0, "greatest answer; what it means is high_text")
    low_text: str = key("", "meaning of the least point")
    high_text: str = key("", "meaning of the greatest point")
    choices: tuple[str, ...] = key((), "choice: the answers")
    required: bool = key(True, "whether the form needs an answer to it")

    def problems(self) -> list[Problem]:
        """Check what involves several keys."""
        problems = []
        if not self.name or not self.text:
            problems.append(Problem("name", repr(self.name or self.text), "must be given, and text too"))
        if self.kind == CHOICE and len(set(self.choices)) < 2:
            problems.append(Problem("choices", repr(list(self.choices)), "must be at least two different answers"))
        if self.kind == LIKERT and not 1 <= self.high - self.low < MAX_POINTS:
            problems.append(Problem("high", f"{self.high:g}", f"must give 2 to {MAX_POINTS} points from low on"))
        if self.kind == NUMBER and self.low > self.high:
            problems.append(Problem("high", f"{self.high:g}", "must be at least low"))
        return problems

    def check(self, answer: Any) -> None:
        """Raise ValueError, with a text for the person, if the question does not take this answer."""
        if answer is None or answer == "":
            if self.required:
                raise ValueError(f"an answer is needed: {self.text}")
            return
        if self.kind == CHOICE:
            fits = answer in self.choices
        elif self.kind == TEXT:
            fits = isinstance(answer, str) and len(answer) <= MAX_TEXT
        else:
            is_number = type(answer) is int or (self.kind == NUMBER and type(answer) is float and math.isfinite(answer))
            fits = is_number and self.low <= answer <= self.high
        if not fits:
            raise ValueError(f"this is no answer to: {self.text}")


@dataclass(frozen=True)
class FormSettings:
    """A form, which is filled in before the run begins or after its last step."""

    name: str = key("", "name of the form in probes.csv")
    title: str = key("", "its heading")
    text: str = key("", "what is said above the questions; a form may have a text alone, such as instructions")
    when: str = key(AFTER, "before the run begins, or after its end", choices=(BEFORE, AFTER))
    question: tuple[QuestionSettings, ...] = key((), "its questions")

    def problems(self) -> list[Problem]:
        """A form has questions of different names, or a text."""
        names = [question.name for question in self.question]
        if self.name and (names or self.text) and len(set(names)) == len(names):
            return []
        return [
            Problem(
                "question",
                ", ".join(names) or "none",
                "must be questions of different names, or a text, in a named form",
            )
        ]


SCALES = ("mental", "physical", "temporal", "performance", "effort", "frustration")
"""The scales of NASA-TLX, each from 0 to 100."""
PAIRS = 15
"""Pairs of scales, of which a person says each time which weighs more."""


def weight_of(scale: str) -> str:
    """Return the name of a scale's weight, as in probes.csv."""
    return f"{scale} weight"


def tlx_scores(answers: Mapping[str, float]) -> dict[str, float]:
    """Return the scores of NASA-TLX by kind, from the answers by name: raw, and weighted if there are weights."""
    scores = {"raw": sum(answers[scale] for scale in SCALES) / len(SCALES)}
    if weight_of(SCALES[0]) in answers:
        scores["weighted"] = sum(answers[scale] * answers[weight_of(scale)] for scale in SCALES) / PAIRS
    return scores


OPEN_EVENTS, IN_TREES, TREES, MOST_EVENTS = "open_events", "agents_in_trees", "trees", "most_events"
QUARTERS = ("top left", "top right", "bottom left", "bottom right")
_MANY = 9999.0

SITUATION = {
    question.name: question
    for question in (
        QuestionSettings(OPEN_EVENTS, "How many events are open in the whole area now?", NUMBER, 0.0, _MANY),
        QuestionSettings(IN_TREES, "How many agents are in trees now, roots included?", NUMBER, 0.0, _MANY),
        QuestionSettings(TREES, "How many trees are there now?", NUMBER, 0.0, _MANY),
        QuestionSettings(MOST_EVENTS, "Which quarter of the area has most open events now?", CHOICE, choices=QUARTERS),
    )
}
"""Questions about the situation (SAGAT, Endsley 1988), whose answers are compared with the truth after the run."""
