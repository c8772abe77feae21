"""Render a page from its parts: one template for self-contained HTML, one for Markdown."""

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from deltaswarm_orchestrator.report import words
from deltaswarm_orchestrator.report.plots import style

MAX_SVG_BYTES = 400_000
"""A drawing whose SVG is larger than this goes into the page as PNG."""

MARKS = {"holds": "good", "refuted": "bad", "undecided": "unsure", "alike": "good"}
"""The colour of a row by its verdict; the row also shows the verdict as a word."""


@dataclass(frozen=True)
class Picture:
    """A figure with its caption."""

    name: str
    """Name of the files, without a suffix."""
    drawing: Figure
    caption: str
    _files: dict[str, bytes] = field(default_factory=dict, init=False, repr=False, compare=False)

    def file(self, kind: str) -> bytes:
        """Return the drawing as PNG, SVG or PDF; each is rendered once, for the page and for its own file."""
        if kind not in self._files:
            self._files[kind] = style.rendered(self.drawing, kind)
        return self._files[kind]

    @property
    def uri(self) -> str:
        """The drawing within the page, as an image, so that the names in one drawing cannot clash with another's."""
        kind, data = "svg+xml", self.file("svg")
        if len(data) > MAX_SVG_BYTES:
            kind, data = "png", self.file("png")
        return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


@dataclass(frozen=True)
class Table:
    """A table of formatted cells with headings."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Sequence[bool]
    """Which columns are right-aligned."""
    marks: Sequence[str]
    """A colour for each row."""


def table(frame: pd.DataFrame, headings: Mapping[str, str], title: str = "") -> Table:
    """Make a table of the columns that have a heading, in the headings' order; a column `verdict` colours the rows."""
    columns = [_texts(frame[name].tolist()) for name in headings]
    numeric = [all(_is_number(value) or _is_missing(value) for value in frame[name].tolist()) for name in headings]
    marks = [MARKS.get(str(verdict), "") for verdict in frame["verdict"]] if "verdict" in frame else [""] * len(frame)
    return Table(title, list(headings.values()), list(zip(*columns, strict=True)), numeric, marks)


def render(template: str, context: Mapping[str, Any]) -> str:
    """Fill `page.html.jinja` or `page.md.jinja`; the same context gives the same bytes.

    Text between backticks is set as code; everything else is shown as it is.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("deltaswarm_orchestrator.report"),
        autoescape="html" in template,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"code": _with_code, "cell": lambda text: " ".join(text.split()).replace("|", "\\|")}
    return environment.get_template(template).render(context) + "\n"


def _texts(values: Sequence[Any]) -> list[str]:
    """Format a column; numbers get as many decimals as a typical one needs for three significant digits."""
    numbers = [float(value) for value in values if _is_number(value) and not _is_missing(value)]
    whole = all(isinstance(value, int) for value in values if _is_number(value))
    decimals = 0 if whole else words.decimals_for(numbers)
    return [_text(value, decimals) for value in values]


def _text(value: Any, decimals: int) -> str:
    if _is_missing(value):
        return words.MISSING
    if not _is_number(value):
        return str(value)
    return str(value) if math.isinf(value) else words.number(float(value), decimals)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def _with_code(text: str) -> Markup:
    """Escape a text, and mark what is between backticks as code."""
    pieces = text.split("`")
    if len(pieces) % 2 == 0:  # an unpaired backtick is an ordinary character
        return escape(text)
    shown = (Markup("<code>{}</code>").format(one) if index % 2 else escape(one) for index, one in enumerate(pieces))
    return Markup("").join(shown)
