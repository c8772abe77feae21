"""Reports: well-formed, self-contained, the same each time, and plain text stays plain text."""

import base64
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from deltaswarm_orchestrator.analysis import markdown, words
from deltaswarm_orchestrator.analysis.report import (
    Column,
    Command,
    Notes,
    Picture,
    Report,
    Section,
    Table,
    save_pictures,
    to_html,
    to_markdown,
)

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"><circle id="a" r="4"/></svg>'
VOID = {"meta", "img", "br", "link", "hr", "input"}
EVIL = "<script>alert(1)</script> & \"quoted\" 'single' | bar"


def drawn() -> Figure:
    figure = Figure(figsize=(2, 1.5))
    figure.add_subplot().plot([1, 3, 2], label="waiting time")
    return figure


def a_report(word: str = "word") -> Report:
    table = Table([Column("variant"), Column("waiting", "s"), Column("ok")], [("a", 1.5, True), (word, None, False)])
    blocks = [f"A paragraph with {word} and `code`.", table, Notes([word]), Notes(["take care"], is_warning=True)]
    pictures = [
        Picture(drawn(), "plot", f"A plot of {word}", "deltaswarm report x"),
        Picture(SVG, "circle", "A circle"),
    ]
    return Report(
        f"Title {word}", "The lead.", [Section("First", [*blocks]), Section("Second", [*pictures, Command("ls")])]
    )


class Page(HTMLParser):
    """Checks that tags nest, and gathers what the page holds."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """A tag opens, and is kept."""
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """The last tag that was opened closes."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Words, as a reader sees them."""
        self.words.append(data)

    def sources(self) -> list[str]:
        """All addresses on the page."""
        return [
            str(found[name]) for _, found in self.tags for name in ("src", "href", "srcset", "poster") if name in found
        ]


@settings(max_examples=25, deadline=None)
@given(st.text(alphabet="ab<>&\"'`|*_[]()\\#-1. {}%$", max_size=12))
def test_the_page_is_well_formed_whatever_the_words(word: str) -> None:
    """Tags nest, no word becomes a tag, and no word is lost."""
    page = Page(to_html(Report("T", word, [Section(word, [word, Table([Column(word)], [(word,)]), Notes([word])])])))
    assert {tag for tag, _ in page.tags} <= {
        *("html", "head", "meta", "title", "style", "body", "header", "h1", "p", "main", "section", "h2", "div"),
        *("table", "thead", "tbody", "tr", "th", "td", "strong", "ul", "li", "code"),
    }
    shown = "".join(page.words)
    kept = word.replace("`", "") if word.count("`") % 2 == 0 else word
    assert shown.count(kept) >= 5


def test_markup_in_the_words_is_escaped() -> None:
    """Also in attributes."""
    html = to_html(a_report(EVIL))
    page = Page(html)
    assert "script" not in [tag for tag, _ in page.tags]
    assert "<script>" not in html
    assert f"A plot of {EVIL}" in [found.get("alt") for tag, found in page.tags if tag == "img"]


def test_nothing_is_fetched() -> None:
    """Pictures are within the page, the style too; links go to places in the page."""
    page = Page(to_html(Report("T", "", [*a_report().sections, Section("Third"), Section("Fourth")])))
    assert len([source for source in page.sources() if source.startswith("data:image/")]) == 2
    assert [source for source in page.sources() if not source.startswith(("data:", "#"))] == []
    style = "".join(page.words[: page.words.index("Title word") if "Title word" in page.words else len(page.words)])
    assert "url(" not in style
    assert "@import" not in style
    assert {"script", "link", "iframe", "object"}.isdisjoint(tag for tag, _ in page.tags)
    ids = {found["id"] for _, found in page.tags if "id" in found}
    assert {source[1:] for source in page.sources() if source.startswith("#")} == ids


def test_the_pictures_are_svg_that_can_be_read() -> None:
    """Ids of one cannot meet those of another, since each is an image of its own."""
    for source in Page(to_html(a_report())).sources():
        kind, data = source.split(",")
        assert kind == "data:image/svg+xml;base64"
        assert ElementTree.fromstring(base64.b64decode(data)).tag == "{http://www.w3.org/2000/svg}svg"


def test_a_drawing_of_many_points_goes_in_as_png() -> None:
    """As SVG it would make the page heavy."""
    figure = Figure(figsize=(2, 1.5))
    figure.add_subplot().scatter(range(9000), range(9000))
    (source,) = Page(to_html(Report("T", "", [Section("S", [Picture(figure, "many", "Many")])]))).sources()
    assert source.startswith("data:image/png;base64,iVBOR")


def test_the_same_report_gives_the_same_bytes() -> None:
    """From figures drawn anew, and when written twice."""
    report = a_report()
    assert to_html(report) == to_html(report) == to_html(a_report())
    assert not re.search(r"20\d\d-\d\d", to_html(report))


def test_numbers_are_aligned() -> None:
    """Flush right with as many decimals in a column; text flush left."""
    frame = pd.DataFrame({"variant": ["a", "b"], "wait": [42.123, 7.0], "n": [10, 9]})
    table = Table.of(frame, {"variant": Column("Variant"), "wait": Column("Waiting", "s"), "n": Column("n")})
    assert table.numeric() == [False, True, True]
    assert table.texts() == [["a", "42.1", "10"], ["b", "7.0", "9"]]
    html = to_html(Report("T", "", [Section("S", [table])]))
    assert '<td class="number">42.1</td>' in html
    assert "<td>a</td>" in html
    assert "| Variant | Waiting [s] | n |\n| --- | ---: | ---: |\n| a | 42.1 | 10 |" in to_markdown(
        Report("T", "", [Section("S", [table])])
    )


def test_missing_cells_are_shown_as_such() -> None:
    """None and NaN alike, and a column of nothing but them."""
    table = Table.of(pd.DataFrame({"x": [1.5, None], "y": [None, None]}))
    assert table.texts() == [["1.50", "-"], ["-", "-"]]


def test_tables_that_do_not_fit_are_refused() -> None:
    """A row too short, a mark too many, and SVG that is none."""
    with pytest.raises(ValueError, match="2 cells"):
        Table([Column("a"), Column("b")], [(1,)])
    with pytest.raises(ValueError, match="marks"):
        Table([Column("a")], [(1,)], marks=("good", "bad"))
    with pytest.raises(ValueError, match="no SVG"):
        Picture("<svg>", "x", "")
    with pytest.raises(ValueError, match="name"):
        Picture(SVG, "../x", "")


def test_marks_colour_rows() -> None:
    """The words say it too; the colour is for the eye."""
    html = to_html(Report("T", "", [Section("S", [Table([Column("a")], [("no",)], marks=("bad",))])]))
    assert '<tr class="bad">' in html


def test_markdown_shows_the_pictures_that_are_saved(tmp_path: Path) -> None:
    """Every link has its file."""
    report = a_report()
    saved = {file.name for file in save_pictures(report, tmp_path / "figures")}
    linked = re.findall(r"!\[.*]\(figures/(.*)\)", to_markdown(report, "figures"))
    assert linked == ["plot.png", "circle.svg"]
    assert set(linked) <= saved
    with pytest.raises(ValueError, match="one name"):
        save_pictures(Report("T", "", [Section("S", [Picture(SVG, "x", ""), Picture(SVG, "x", "")])]), tmp_path)


def test_markdown_has_what_the_page_has() -> None:
    """Headings, captions with their numbers, commands, warnings."""
    text = to_markdown(a_report())
    for part in (
        "# Title word\n\nThe lead.\n\n## First",
        "Figure 1: A plot of word",
        "Figure 2: A circle",
        "Made by `deltaswarm report x`",
        "> [!WARNING]\n> - take care",
        "```sh\nls\n```",
    ):
        assert part in text


@settings(max_examples=200)
@given(st.text(alphabet="ab<>&;`|*_[]()\\#-+1. ~!:$", max_size=14))
def test_plain_text_means_nothing_to_markdown(plain: str) -> None:
    """A Markdown reader shows the words as they are: no emphasis, link, list, heading or HTML."""
    folded = " ".join(plain.split())
    if "`" in folded or not folded:
        return
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(markdown.text(plain))
    assert [token.type for token in tokens] == ["paragraph_open", "inline", "paragraph_close"]
    children = tokens[1].children or []
    assert {child.type for child in children} <= {"text", "text_special"}
    assert "".join(child.content for child in children) == folded


@settings(max_examples=100)
@given(st.text(alphabet="ab|\\`*<> ", max_size=8))
@example("`a|b`")
@example("a|b")
def test_cells_stay_in_their_columns(cell: str) -> None:
    """Whatever bars, backslashes and code they hold: the next cell is still the next."""
    text = markdown.table(["one", "two"], [[cell, "next"]], [False, True])
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(text)
    assert [token.content for token in tokens if token.type == "inline"][3] == "next"
    assert (tokens[0].type, tokens[-1].type) == ("table_open", "table_close")


def test_numbers_for_readers() -> None:
    """Three significant digits, no minus before zero, thousands apart only where they are many."""
    shown = [words.number(value) for value in (42.12, 3.918, 0.0351, 9000, 12345.6, -0.00001, None, 7)]
    assert shown == ["42.1", "3.92", "0.0351", "9000", "12,346", "-0.000010", "-", "7"]
    assert words.number(-0.001, 1) == "0.0"
    assert words.with_interval(42.12, 40.0, 44.444) == "42.1 [40.0, 44.4]"
    assert [words.p_equals(p) for p in (0.0004, 0.0312)] == ["p < 0.001", "p = 0.031"]
    assert [words.count(n, "run") for n in (1, 2)] == ["1 run", "2 runs"]
