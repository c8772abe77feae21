"""Forms that a person at the station fills in before or after a run, and the sheet that a session begins with."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deltaswarm_scenario.technique import AFTER, BEFORE, Answers, Technique
from deltaswarm_wire.checked import Problem, key, plain

FORM, SHEET = "form", "sheet"
LIKERT, NUMBER, TEXT, CHOICE = "likert", "number", "text", "choice"
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
        if self.kind == LIKERT and not self.low.is_integer():
            problems.append(Problem("low", f"{self.low:g}", "must be a whole number, as the points of a scale are"))
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


@dataclass(frozen=True)
class FormsSettings:
    """The key of forms."""

    form: tuple[FormSettings, ...] = key((), "forms before and after the run")


class FormTechnique(Technique):
    """A technique that asks by a form."""

    kind = FORM
    hides = False
    """Whether the page hides what is known meanwhile."""

    def form(self, number: int) -> FormSettings:
        """Return the form of a question."""
        raise NotImplementedError

    @property
    def questions(self) -> Sequence[QuestionSettings]:
        """Return the form's questions."""
        return self.form(0).question

    def items(self, number: int) -> Sequence[str]:
        """Return the names of the form's questions."""
        return tuple(question.name for question in self.form(number).question)

    def shown(self, number: int, asked_s: float, left_s: float | None) -> dict[str, Any]:
        """Return the form."""
        return self._shown(number, left_s, self.form(number), is_prompt=False)

    def prompt(self, number: int) -> FormSettings:
        """Return what is asked before the question, if it has a prompt: a form without questions."""
        raise NotImplementedError

    def shown_prompt(self, number: int, left_s: float | None) -> dict[str, Any]:
        """Return the prompt in the page's format."""
        return self._shown(number, left_s, self.prompt(number), is_prompt=True)

    def _shown(self, number: int, left_s: float | None, form: FormSettings, *, is_prompt: bool) -> dict[str, Any]:
        ask = {"kind": FORM, "number": number, "hides": self.hides, "left_s": left_s, "form": plain(form)}
        return ask | ({"prompt": True} if is_prompt else {})

    def is_meant(self, number: int, message: Mapping[str, Any]) -> bool:
        """Compare the form's name, and the question's number if it is given."""
        return bool(message["form"] == self.name and message.get("number", number) == number)

    def answers(self, number: int, message: Mapping[str, Any]) -> Answers:
        """Return an answer, or None, to each question of the form, if it takes them."""
        answers, items = message["answers"], self.items(number)
        if not isinstance(answers, Mapping) or not answers.keys() <= set(items):
            raise ValueError("an answer is of no question of this form")
        for question in self.form(number).question:
            question.check(answers.get(question.name))
        return {item: answers.get(item) for item in items}

    def act(self, answers: Answers) -> dict[str, Any]:
        """Return the form's name."""
        return {"name": self.name}


class Form(FormTechnique):
    """One of a run's own forms."""

    def __init__(self, settings: FormSettings) -> None:
        self._form = settings
        self.name, self.when = settings.name, settings.when

    @classmethod
    def of(cls, settings: FormsSettings) -> Iterable[Technique]:
        """Return one for each form."""
        return [cls(form) for form in settings.form]

    def form(self, number: int) -> FormSettings:
        """Return the form."""
        return self._form


@dataclass(frozen=True)
class SheetSettings:
    """The keys of the sheet that a session begins with."""

    consent: str = key("", "text that a participant must agree to before the run begins")
    participant: str = key("", "participant's code, filled in on the session's sheet")
    condition: str = key("", "condition, filled in on the session's sheet")

    @property
    def has_sheet(self) -> bool:
        """Whether a sheet is filled in before the run begins."""
        return bool(self.consent or self.participant)


class Sheet(Technique):
    """The session's sheet. What is filled in is an act and no answer, so it has no items."""

    name = kind = SHEET
    when = BEFORE

    @classmethod
    def of(cls, settings: SheetSettings) -> Iterable[Technique]:
        """Return the sheet if there is one."""
        return [cls()] if settings.has_sheet else []
