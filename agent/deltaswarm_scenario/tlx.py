"""NASA-TLX after the last step: six scales from 0 to 100, raw, and optionally 15 pairwise weights."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from random import Random
from typing import Any

from deltaswarm_scenario.questions import NUMBER, QuestionSettings
from deltaswarm_scenario.technique import AFTER, Answers, Measure, Technique
from deltaswarm_wire.checked import key

TLX = "tlx"
SCALES = ("mental", "physical", "temporal", "performance", "effort", "frustration")
"""The scales, each from 0 to 100."""
EVENLY, ENDS = ("very low", "very high"), {"performance": ("perfect", "failure")}
PAIRS = 15
"""Pairs of scales, of which a person says each time which weighs more."""


@dataclass(frozen=True)
class TlxSettings:
    tlx: bool = key(False, "ask NASA-TLX at the end: six scales from 0 to 100")
    tlx_weights: bool = key(False, "ask for the 15 pairwise weights of NASA-TLX too")


class Tlx(Technique):
    name = kind = TLX
    title = "NASA-TLX"
    has_numbers = True
    measures: Sequence[Measure] = (
        Measure("person.tlx.raw", "NASA-TLX, mean of the six scales, from 0 to 100", "tlx_raw", "operator.probes.tlx"),
        Measure(
            "person.tlx.weighted", "NASA-TLX, weighted by the 15 pairs", "tlx_weighted", "operator.probes.tlx_weights"
        ),
    )
    when = AFTER

    def __init__(self, settings: TlxSettings) -> None:
        self._has_weights = settings.tlx_weights
        self._pairs = [list(pair) for pair in combinations(SCALES, 2)]
        if not self._has_weights:
            self.measures = self.measures[:1]

    @classmethod
    def of(cls, settings: TlxSettings) -> Iterable[Technique]:
        return [cls(settings)] if settings.tlx else []

    @property
    def questions(self) -> Sequence[QuestionSettings]:
        return [
            QuestionSettings(scale, f"{self.title}, {scale}", NUMBER, 0.0, 100.0, *ENDS.get(scale, EVENLY))
            for scale in SCALES
        ]

    def draw(self, rng: Random, duration_s: float) -> None:
        """Draw the order of the pairs, and of the scales in each."""
        if self._has_weights:
            self._pairs = [rng.sample(pair, 2) for pair in rng.sample(self._pairs, PAIRS)]

    def shown(self, number: int, asked_s: float, left_s: float | None) -> dict[str, Any]:
        return {"kind": TLX} | ({"pairs": self._pairs} if self._has_weights else {})

    def items(self, number: int) -> Sequence[str]:
        """Return the scales; weights have rows only if they are given."""
        return SCALES

    def answers(self, number: int, message: Mapping[str, Any]) -> Answers:
        scales = message["scales"]
        _check_table(scales, 100, "each scale must be from 0 to 100")
        answers = {scale: scales[scale] for scale in SCALES}
        if self._has_weights:
            weights: Any = message.get("weights")
            _check_table(weights, 5, "each weight must be from 0 to 5")
            if sum(weights.values()) != PAIRS:
                raise ValueError(f"the weights must add up to {PAIRS}")
            answers |= {weight_of(scale): weights[scale] for scale in SCALES}
        return answers

    @staticmethod
    def scores(given: Sequence[Answers]) -> dict[str, Any]:
        """Return the scores of the last answer by kind: raw, and weighted if there are weights; None: no answer."""
        if not given:
            return {TLX: None}
        answers = given[-1]
        scores = {"raw": sum(answers[scale] for scale in SCALES) / len(SCALES)}
        if weight_of(SCALES[0]) in answers:
            scores["weighted"] = sum(answers[scale] * answers[weight_of(scale)] for scale in SCALES) / PAIRS
        return {TLX: scores}

    @property
    def outline(self) -> str:
        return "NASA-TLX with weights" if self._has_weights else "NASA-TLX"


def weight_of(scale: str) -> str:
    """Return the name of a scale's weight, as in probes.csv."""
    return f"{scale} weight"


def _check_table(table: Any, most: int, problem: str) -> None:
    if not isinstance(table, Mapping) or table.keys() != set(SCALES):
        raise ValueError(f"an answer to each of {', '.join(SCALES)} is needed")
    if not all(type(value) is int and 0 <= value <= most for value in table.values()):
        raise ValueError(problem)
