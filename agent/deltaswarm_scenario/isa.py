"""ISA (instantaneous self-assessment): workload from 1 to 5, asked at intervals while the run goes on."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from deltaswarm_scenario.questions import NUMBER, QuestionSettings
from deltaswarm_scenario.technique import Answers, Measure, Technique
from deltaswarm_wire.checked import key

ISA = "isa"
LOWEST, HIGHEST = 1, 5
WORDS = ("under-used", "relaxed", "comfortable", "high", "excessive")


@dataclass(frozen=True)
class IsaSettings:
    isa_every_s: float = key(
        120.0, "simulated time between ISA questions (workload from 1 to 5); 0: none [s]", low=0, high=1e6
    )
    isa_jitter_s: float = key(0.0, "maximum of an additional uniform time before each [s]", low=0, high=1e6)
    isa_wait_s: float = key(20.0, "wall time after which an ISA question counts as missing [s]", above=0, high=3600)


class Isa(Technique):
    name = kind = ISA
    title = "ISA"
    has_numbers = True
    measures = (
        Measure(
            "person.isa",
            "mean ISA answer, from 1 to 5",
            "isa",
            "operator.probes.isa_every_s",
            "Mean ISA answer, from 1 to 5",
        ),
    )

    def __init__(self, settings: IsaSettings) -> None:
        self._settings = settings
        self.wait_s = settings.isa_wait_s

    @classmethod
    def of(cls, settings: IsaSettings) -> Iterable[Technique]:
        """Return ISA if it has an interval."""
        return [cls(settings)] if settings.isa_every_s else []

    @property
    def questions(self) -> Sequence[QuestionSettings]:
        low, high = float(LOWEST), float(HIGHEST)
        return [QuestionSettings(ISA, "How busy are you right now?", NUMBER, low, high, WORDS[0], WORDS[-1], WORDS)]

    def due_s(self, number: int, last_s: float, rng: Random) -> float:
        """Return the end of the interval after the last question."""
        return last_s + self._settings.isa_every_s + rng.uniform(0.0, self._settings.isa_jitter_s)

    def items(self, number: int) -> Sequence[str]:
        return (ISA,)

    def shown(self, number: int, asked_s: float, left_s: float | None) -> dict[str, Any]:
        return {"kind": ISA, "number": number, "asked_s": asked_s, "left_s": left_s}

    def is_meant(self, number: int, message: Mapping[str, Any]) -> bool:
        return bool(message["number"] == number)

    def answers(self, number: int, message: Mapping[str, Any]) -> Answers:
        answer = message["answer"]
        if type(answer) is not int or not LOWEST <= answer <= HIGHEST:
            raise ValueError("the answer must be from 1 to 5")
        return {ISA: answer}

    def act(self, answers: Answers) -> dict[str, Any]:
        return {"value": answers[ISA]}

    @staticmethod
    def simulated(load: float) -> Answers:
        """Return the load in five equal bands."""
        return {ISA: min(HIGHEST, LOWEST + math.floor(HIGHEST * load))}

    @staticmethod
    def scores(given: Sequence[Answers]) -> dict[str, Any]:
        return {ISA: sum(answers[ISA] for answers in given) / len(given) if given else None}

    @property
    def outline(self) -> str:
        every_s, jitter_s = self._settings.isa_every_s, self._settings.isa_jitter_s
        return f"ISA every {every_s:g}{f' to {every_s + jitter_s:g}' if jitter_s else ''} s"
