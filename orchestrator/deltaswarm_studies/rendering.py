"""Render a page from its parts: tables, pictures, and numbers with few digits, as self-contained HTML or Markdown."""

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from deltaswarm_studies import style
from deltaswarm_studies.claim_settings import ANYWAY, DEPENDS

MAX_SVG_BYTES = 400_000
"""A drawing whose SVG is larger than this goes into the page as PNG."""

MISSING = "-"
SIGNIFICANT = 3
MAX_DECIMALS = 6
GROUPED_FROM = 10_000

MARKS = dict.fromkeys(("undecided", DEPENDS, ANYWAY), "unsure") | dict.fromkeys(("holds", "alike", "agrees"), "good")
MARKS |= dict.fromkeys(("refuted", "differs"), "bad")
"""The colour of a row by its verdict; the row also shows the verdict as a word."""


@dataclass(frozen=True)
class CaptionedFigure:
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
    numeric = [all(value is None or _is_number(value) for value in frame[name].tolist()) for name in headings]
    marks = [MARKS.get(str(verdict), "") for verdict in frame["verdict"]] if "verdict" in frame else [""] * len(frame)
    return Table(title, list(headings.values()), list(zip(*columns, strict=True)), numeric, marks)


def render(template: str, context: Mapping[str, Any]) -> str:
    """Fill `page.html.jinja` or `page.md.jinja`; the same context gives the same bytes.

    Text between backticks is set as code; everything else is shown as it is.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("deltaswarm_studies"),
        autoescape="html" in template,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "code": _with_code,
        "cell": lambda text: " ".join(text.split()).replace("|", "\\|"),
        "counts": lambda counts: ", ".join(f"{name} {count}" for name, count in counts.items()),
    }
    return environment.get_template(template).render(context) + "\n"


def _texts(values: Sequence[Any]) -> list[str]:
    """Format a column; numbers get as many decimals as a typical one needs for three significant digits."""
    numbers = [value for value in values if _is_number(value)]
    decimals = 0 if all(isinstance(value, int) for value in numbers) else decimals_for(numbers)
    return [number(value, decimals) if value is None or _is_number(value) else str(value) for value in values]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def decimals_for(values: Iterable[float | None]) -> int:
    """Return how many decimals show a typical one of these values with three significant digits."""
    sizes = sorted(abs(value) for value in values if value is not None and math.isfinite(value) and value)
    if not sizes:
        return 0
    typical = sizes[len(sizes) // 2]
    return min(max(SIGNIFICANT - 1 - math.floor(math.log10(typical)), 0), MAX_DECIMALS)


def number(value: float | None, decimals: int) -> str:
    """Format a number with this many decimals; None and NaN become `-`."""
    if value is None or math.isnan(value):
        return MISSING
    if math.isinf(value):
        return str(value)
    text = f"{value:,.{decimals}f}" if abs(value) >= GROUPED_FROM else f"{value:.{decimals}f}"
    return text.removeprefix("-") if not any(digit in text for digit in "123456789") else text


def with_interval(value: float | None, low: float | None, high: float | None, error: float | None = None) -> str:
    """Format a number with its standard error in parentheses and its interval in brackets, if it has them.

    Number and interval have the same number of decimals, the error at least two significant digits.
    """
    decimals = decimals_for([value, low, high])
    shown = number(value, decimals)
    if error is not None:
        shown += f" ({number(error, max(decimals, decimals_for([error]) - 1))})"
    return shown if low is None or high is None else f"{shown} [{number(low, decimals)}, {number(high, decimals)}]"


def p_value(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _with_code(text: str) -> Markup:
    pieces = text.split("`")
    if len(pieces) % 2 == 0:  # an unpaired backtick is an ordinary character
        return escape(text)
    marked = (Markup("<code>{}</code>").format(text) if i % 2 else escape(text) for i, text in enumerate(pieces))
    return Markup("").join(marked)
