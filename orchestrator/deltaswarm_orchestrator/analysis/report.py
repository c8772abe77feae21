"""A report in sections, written as one HTML file that needs nothing else, or as Markdown.

The same report gives the same bytes: there is no date in it that was not put there.
In any text, `backticks` set code; everything else is shown as it is.
"""

import base64
import io
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import jinja2
import matplotlib.figure
import pandas as pd
from markupsafe import Markup, escape

from deltaswarm_orchestrator.analysis import markdown, words
from deltaswarm_orchestrator.figures import style

Cell = str | int | float | bool | None
Mark = Literal["", "good", "bad", "unsure"]

MAX_SVG_BYTES = 400_000
"""A drawing that is larger as SVG goes into the page as PNG."""


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    title: str
    unit: str = ""
    decimals: int | None = None
    """By default as many as three significant digits of a typical value need."""
    is_numeric: bool | None = None
    """Whether it is set flush right; by default whether its cells are numbers."""

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True)
class Table:
    """Rows of cells below titled columns; None and NaN are shown as `-`."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    marks: Sequence[Mark] = ()
    """A colour for each row; the words in the row must say the same."""

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError(f"every row of {self.caption or 'the table'!r} needs {len(self.columns)} cells")
        if self.marks and len(self.marks) != len(self.rows):
            raise ValueError(f"{self.caption or 'the table'!r} has {len(self.rows)} rows and {len(self.marks)} marks")

    @classmethod
    def of(cls, frame: pd.DataFrame, columns: Mapping[str, Column] | None = None, caption: str = "") -> "Table":
        """The frame's columns that are named, in that order; by default all, under their own names.

        Raises:
            KeyError: When the frame lacks a column.
        """
        chosen = columns or {str(name): Column(str(name)) for name in frame.columns}
        cells = [[_cell(value) for value in frame[name].tolist()] for name in chosen]
        return cls(list(chosen.values()), list(zip(*cells, strict=True)), caption)

    def numeric(self) -> list[bool]:
        """Which columns are set flush right."""
        return [self._is_numeric(index) for index in range(len(self.columns))]

    def texts(self) -> list[list[str]]:
        """The cells as they are shown."""
        columns = [self._texts(index) for index in range(len(self.columns))]
        return [list(row) for row in zip(*columns, strict=True)]

    def _is_numeric(self, index: int) -> bool:
        given = self.columns[index].is_numeric
        cells = [row[index] for row in self.rows if row[index] is not None]
        return given if given is not None else bool(cells) and all(_is_number(cell) for cell in cells)

    def _texts(self, index: int) -> list[str]:
        cells = [row[index] for row in self.rows]
        numbers = [float(cell) for cell in cells if _is_number(cell) and isinstance(cell, int | float)]
        whole = all(isinstance(cell, int) for cell in cells if _is_number(cell))
        decimals = self.columns[index].decimals
        decimals = (0 if whole else words.decimals_for(numbers)) if decimals is None else decimals
        return [_shown(cell, decimals) for cell in cells]


@dataclass(frozen=True)
class Picture:
    """A figure with its caption and the command that makes it."""

    drawing: matplotlib.figure.Figure | str
    """A figure of matplotlib, or SVG text."""
    name: str
    """The name of its file, without a suffix."""
    caption: str
    command: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w.-]+", self.name):
            raise ValueError(f"{self.name!r} is no name for a file")
        if isinstance(self.drawing, str):
            try:
                ElementTree.fromstring(self.drawing)
            except ElementTree.ParseError as error:
                raise ValueError(f"{self.name} is no SVG: {error}") from None

    @property
    def file(self) -> str:
        """The file that `save_pictures` writes and Markdown shows."""
        return f"{self.name}.svg" if isinstance(self.drawing, str) else f"{self.name}.png"


@dataclass(frozen=True)
class Notes:
    """Remarks, or warnings that a reader must not miss."""

    lines: Sequence[str]
    is_warning: bool = False


@dataclass(frozen=True)
class Command:
    """Something to type."""

    text: str


Block = str | Table | Picture | Notes | Command
"""A `str` is a paragraph."""


@dataclass
class Section:
    """A heading and what stands below it, in order."""

    heading: str
    blocks: list[Block] = field(default_factory=list)


@dataclass
class Report:
    """A title, a line or two below it, and sections."""

    title: str
    lead: str = ""
    sections: list[Section] = field(default_factory=list)

    def pictures(self) -> list[Picture]:
        """All pictures, in order."""
        return [block for section in self.sections for block in section.blocks if isinstance(block, Picture)]


def to_html(report: Report) -> str:
    """The report as one HTML page: style and figures are within, nothing is fetched."""
    template = resources.files(__package__).joinpath("report.html.jinja").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["code"] = _with_code
    numbers = {id(picture): number for number, picture in enumerate(report.pictures(), start=1)}
    sections = [
        {"heading": section.heading, "blocks": [_view(block, numbers) for block in section.blocks]}
        for section in report.sections
    ]
    page = environment.from_string(template).render(title=report.title, lead=report.lead, sections=sections)
    return page + "\n"


def to_markdown(report: Report, figures_folder: str = "figures") -> str:
    """The report as GitHub's Markdown.

    Args:
        report: What to write.
        figures_folder: Where the pictures are, as seen from the Markdown file; `save_pictures` puts them there.
    """
    parts = [f"# {markdown.text(report.title)}"]
    if report.lead:
        parts.append(markdown.text(report.lead))
    numbers = {id(picture): number for number, picture in enumerate(report.pictures(), start=1)}
    for section in report.sections:
        parts.append(f"## {markdown.text(section.heading)}")
        parts += [_markdown(block, numbers, figures_folder) for block in section.blocks]
    return "\n\n".join(parts) + "\n"


def save_pictures(report: Report, folder: Path) -> list[Path]:
    """Write the report's pictures: a drawing as PNG and SVG, SVG text as it is.

    Raises:
        ValueError: When two pictures have one name.
        OSError: When a file cannot be written.
    """
    pictures = report.pictures()
    names = [picture.name for picture in pictures]
    if len(set(names)) < len(names):
        raise ValueError(f"two pictures have one name: {', '.join(sorted(names))}")
    folder.mkdir(parents=True, exist_ok=True)
    files: list[Path] = []
    for picture in pictures:
        if isinstance(picture.drawing, str):
            file = folder / picture.file
            file.write_text(picture.drawing, encoding="utf-8")
            files.append(file)
        else:
            files += style.save(picture.drawing, folder / picture.name)
    return files


def _is_number(cell: object) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _cell(value: Any) -> Cell:
    if value is None or value is pd.NA or value is pd.NaT:
        return None
    return value if isinstance(value, str | int | float | bool) else str(value)


def _shown(cell: Cell, decimals: int) -> str:
    if cell is None:
        return words.MISSING
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, int):
        return words.number(cell, decimals)
    if isinstance(cell, float):
        return str(cell) if math.isinf(cell) else words.number(cell, decimals)
    return cell


def _with_code(text: str) -> Markup:
    """Escaped, with what stands between backticks as code."""
    pieces = text.split("`")
    if len(pieces) % 2 == 0:  # one backtick without its partner is only a character
        return escape(text)
    shown = [
        Markup("<code>{}</code>").format(piece) if index % 2 else escape(piece) for index, piece in enumerate(pieces)
    ]
    return Markup("").join(shown)


def _view(block: Block, numbers: Mapping[int, int]) -> dict[str, Any]:
    """What the template needs of a block."""
    match block:
        case str():
            return {"kind": "paragraph", "text": block}
        case Command():
            return {"kind": "command", "text": block.text}
        case Notes():
            return {"kind": "notes", "lines": block.lines, "is_warning": block.is_warning}
        case Table():
            numeric = block.numeric()
            marks = block.marks or [""] * len(block.rows)
            rows = [
                {"mark": mark, "cells": list(zip(texts, numeric, strict=True))}
                for texts, mark in zip(block.texts(), marks, strict=True)
            ]
            titles = list(zip((column.heading for column in block.columns), numeric, strict=True))
            return {"kind": "table", "caption": block.caption, "titles": titles, "rows": rows}
        case Picture():
            return {
                "kind": "picture",
                "number": numbers[id(block)],
                "caption": block.caption,
                "command": block.command,
                "source": _data_uri(block.drawing),
            }


def _data_uri(drawing: matplotlib.figure.Figure | str) -> str:
    """The drawing within the page. As an image, so that the ids within one SVG cannot meet those of the next."""
    kind, data = "svg+xml", _rendered(drawing, "svg") if not isinstance(drawing, str) else drawing.encode()
    if not isinstance(drawing, str) and len(data) > MAX_SVG_BYTES:
        kind, data = "png", _rendered(drawing, "png")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _rendered(figure: matplotlib.figure.Figure, kind: Literal["svg", "png"]) -> bytes:
    stream = io.BytesIO()
    metadata = {"svg": {"Date": None, "Creator": None}, "png": {"Software": None}}
    with style.drawing():
        figure.savefig(stream, format=kind, metadata=metadata[kind])
    return stream.getvalue()


def _markdown(block: Block, numbers: Mapping[int, int], figures_folder: str) -> str:
    match block:
        case str():
            return markdown.text(block)
        case Command():
            return markdown.fenced(block.text)
        case Notes():
            return markdown.notes(block.lines, is_warning=block.is_warning)
        case Table():
            titles = [column.heading for column in block.columns]
            table = markdown.table(titles, block.texts(), block.numeric())
            return f"**{markdown.text(block.caption)}**\n\n{table}" if block.caption else table
        case Picture():
            caption = f"Figure {numbers[id(block)]}: {block.caption}"
            made = f"\n\nMade by {markdown.code(block.command)}" if block.command else ""
            return f"{markdown.picture(caption, f'{figures_folder}/{block.file}')}\n\n{markdown.text(caption)}{made}"
