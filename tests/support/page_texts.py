"""Finds all texts that the station's page shows to a person.

`python -m tests.support.page_texts > agent/deltaswarm_scenario/page_texts.json` writes the catalogue anew.
"""

import ast
import inspect
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib import import_module
from types import ModuleType
from typing import Any

from deltaswarm_agent.controllers import potential
from deltaswarm_operator.core import autonomy, command_log, intents, probes
from deltaswarm_operator.station import room, rules, server
from deltaswarm_scenario import page_messages
from deltaswarm_scenario.techniques import TECHNIQUES
from deltaswarm_sessions import plan, session
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.plugins import CONTROLLERS, INBOX_POLICIES, find, find_controller

MARKED = re.compile(r'\b(?:t|later)\(\s*("(?:[^"\\]|\\.)*")')
ROLE = re.compile(r"^  (\w+): \[", re.MULTILINE)
SHOWN_ATTRIBUTES = ("title", "aria-label", "placeholder")
ASKING = tuple({import_module(technique.__module__): None for technique in TECHNIQUES})
REFUSING = (autonomy, command_log, intents, probes, *ASKING, rules, room)
"""Modules whose ValueErrors the page shows."""
NOT_OURS = "a message"
"""Refusals that begin so answer what this page never sends."""


def texts() -> list[str]:
    """All texts, sorted."""
    found = {*_scripts(), *_Document().texts, *_built_in(), *_orders(), *_refusals()}
    return sorted(text for text in found if re.search(r"[^\W\d_]", text))


def _scripts() -> Iterator[str]:
    for path in sorted(server.PAGE.glob("*.js")):
        yield from map(json.loads, MARKED.findall(path.read_text()))
    yield from ROLE.findall((server.PAGE / "looks.js").read_text().partition("const ROLES = ")[2].partition("\n}")[0])


class _Document(HTMLParser):
    """The texts of index.html but those that are marked as not to be translated."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        self._open: list[bool] = []
        self.feed((server.PAGE / "index.html").read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        is_meant = given.get("translate") != "no" and (not self._open or self._open[-1])
        if is_meant:
            self.texts += [_joined(given[name] or "") for name in SHOWN_ATTRIBUTES if name in given]
        if tag not in ("meta", "link", "input"):
            self._open.append(is_meant)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        self._open.pop()

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1]:
            self.texts.append(_joined(data))


def _joined(text: str) -> str:
    return " ".join(text.split())


def _built_in() -> Iterator[str]:
    """Questions about the situation, why items are held back, states of an order, the end of a run, a role."""
    for technique in TECHNIQUES:
        yield from technique.texts
    yield from (find(INBOX_POLICIES, name, "").HELD for name in INBOX_POLICIES.shipped)
    yield from (command_log.SENT, command_log.KNOWN, command_log.EXPIRED)
    yield from (
        session.SCORE_TITLE,
        session.SCORE_TEXT,
        plan.MORE,
        plan.WAIT,
        plan.THANKS,
        plan.SCORE_NEXT,
        potential.SPREADING,
        *(why for why in page_messages.WHY_NOT.values() if not why.startswith(NOT_OURS)),
    )


def _orders() -> Iterator[str]:
    """Names and help of the orders of built-in controllers; of an argument the words of its name."""
    for mode in CONTROLLERS.shipped:
        for form in forms_of(find_controller(mode)):
            yield from (form.name, form.help)
            for argument in form.arguments:
                yield from (re.sub(r"_(s|m)$", "", argument.name).replace("_", " "), argument.help, *argument.choices)


def _refusals() -> Iterator[str]:
    """Texts of errors, with a placeholder for each value."""
    for module in REFUSING:
        for call in ast.walk(ast.parse(inspect.getsource(module))):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") in ("ValueError", "RefusedError"):
                found = [text for argument in call.args[:1] for text in _said(argument, module)]
                yield from (text for text in found if not text.startswith(NOT_OURS))


def _said(node: ast.expr, module: ModuleType) -> list[str]:
    if isinstance(node, ast.IfExp):
        return [*_said(node.body, module), *_said(node.orelse, module)]
    if isinstance(node, ast.Name):
        value: Any = getattr(module, node.id, None)
        return [value] if isinstance(value, str) else []
    if isinstance(node, ast.Constant):
        return [str(node.value)]
    if not isinstance(node, ast.JoinedStr):
        return []
    parts = [_named(part) if isinstance(part, ast.FormattedValue) else _said(part, module)[0] for part in node.values]
    return ["".join(parts)]


def _named(value: ast.FormattedValue) -> str:
    """A placeholder with the name of the value, or of the last part of its name."""
    expression = value.value.values[0] if isinstance(value.value, ast.BoolOp) else value.value
    names = re.findall(r"[A-Za-z_]\w*", re.sub(r"'[^']*'", "", ast.unparse(expression)))
    return f"{{{names[-1].lower()}}}"


if __name__ == "__main__":
    print(json.dumps(texts(), indent=2, ensure_ascii=False))
