"""Translations of the station's page: the texts that it has, and a file with translations."""

import difflib
import json
import re
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from deltaswarm_wire.checked import Problem, key

TEXTS = "page_texts.json"
"""All texts of the page, in English; made by `python -m tests.support.page_texts`."""


@cache
def page_texts() -> tuple[str, ...]:
    """Return all texts of the page: its own, those of built-in questions and orders, and what the operator refuses."""
    return tuple(json.loads(resources.files("deltaswarm_scenario").joinpath(TEXTS).read_text(encoding="utf-8")))


def placeholders(text: str) -> set[str]:
    """Return the names of the values that are put into a text."""
    return set(re.findall(r"\{(\w+)\}", text))


@dataclass(frozen=True)
class LanguageSettings:
    """The language of the page. A text with an empty translation stays English."""

    tag: str = key(
        "", 'the language, such as de; `operator.page.language = "FILE"` reads this key and the next two from a file'
    )
    page: dict[str, str] = key(dict, "translations of the page's own texts, by the English text")
    run: dict[str, str] = key(
        dict, "the same for texts of your own: the page's title, consent, forms, orders and roles of a controller"
    )

    def problems(self) -> list[Problem]:
        """Return a problem for each translation that is no text, or that has other placeholders."""
        problems = []
        for table, texts in (("page", self.page), ("run", self.run)):
            for english, said in typing.cast(Mapping[str, Any], texts).items():
                if not isinstance(said, str):
                    problems.append(Problem(f"{table}.{english}", repr(said)[:60], "must be a string"))
                elif said and placeholders(said) != placeholders(english):
                    names = ", ".join(f"{{{name}}}" for name in sorted(placeholders(english))) or "no placeholder"
                    problems.append(Problem(f"{table}.{english}", repr(said), f"must have {names}"))
        return problems

    @staticmethod
    def unknown(page: Mapping[str, Any]) -> list[Problem]:
        """Return a problem for each entry of a file's table `page` that the page does not have.

        A finished run may keep such an entry: the page may have changed since.
        """
        problems = []
        for english in page.keys() - {*page_texts()}:
            near = difflib.get_close_matches(english, page_texts(), n=1)
            hint = f"did you mean {near[0]!r}?" if near else "a text of your own belongs in the table run"
            problems.append(Problem("page", f"the page has no text {english!r}", hint))
        return sorted(problems, key=str)

    @property
    def told(self) -> dict[str, Any] | None:
        """The language in the page's format; None if the page speaks English."""
        texts = {english: said for english, said in (self.run | self.page).items() if said}
        return {"tag": self.tag, "texts": texts} if texts or self.tag else None

    def of(self, english: str) -> str:
        """Return a text as the page shows it."""
        return self.page.get(english) or self.run.get(english) or english
