"""A study's page: whole in one file, the same from its tables, and honest about what cannot be shown."""

import base64
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from jinja2 import UndefinedError
from markdown_it import MarkdownIt

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.sweeps.table import read_table, write_table
from deltaswarm_studies.design import design
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.metrics import BUILT_IN
from deltaswarm_studies.origin import CODE, QUESTIONS, RUNS
from deltaswarm_studies.page import pages, write, write_index
from deltaswarm_studies.rendering import render, table
from tests.support.studying import FIGURES, OWN, SWEEP, made, series
from tests.support.studying import table as runs_table

ASKED = OWN + (
    '[[contrast]]\nid = "limit"\ntext = "Loss <b>against</b> none"\nfactor = "loss"\nreference = "loss=0.0"\n'
    'metrics = ["waiting_all", "messages"]\n'
    '[[claim]]\nid = "c"\ntext = "Hybrid | waits less"\nless = "loss=0.0, hybrid 3"\nmore = "loss=0.0, decentralised"\n'
    '[[recovery]]\nmetric = "waiting_all"\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "loss=0.0"\n'
    'after_s = 300.0\n'
    '[[fit]]\ntext = "Fit"\nfactor = "mode"\n'
    'targets = [{ level = "hybrid 3", metric = "messages", says = 26.0, iqr = 4.0 }]\n'
    '[[grid]]\ntext = "Grid"\nmetric = "messages"\nrows = "loss"\nfactor = "mode"\n'
    'columns = { own = ["hybrid 3"], best = ["hybrid 3", "decentralised"] }\n'
    '[[finding]]\nheading = "Waiting"\nresults = [{ claim = "c" }]\nremark = "By <b>runs</b>."\n'
)  # fmt: skip
DRAWN = ASKED + FIGURES
PROVENANCE = pd.DataFrame({"what": ["runs"], "value": ["60"]})


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return Evidence.of_sweep(made(DRAWN), runs_table(), series(lambda level, mode, replicate, time_s: 20.0 + replicate))


def test_the_html_page_needs_nothing_else(evidence: Evidence) -> None:
    """No script, nothing fetched; figures are in it; what a file says is text, not markup."""
    html, _, pictures = pages(made(DRAWN), evidence, PROVENANCE)
    assert [picture.name for picture in pictures] == ["boxes", "levels", "time", "plane", "frontier"]
    assert html.count("data:image/") == 5
    assert not re.search(r"<script|<link|(?:src|href)=\"(?!data:|#)", html)
    assert "Loss &lt;b&gt;against&lt;/b&gt; none" in html
    assert "<b>against" not in html


def test_the_markdown_page_has_the_same_tables(evidence: Evidence) -> None:
    html, markdown, pictures = pages(made(DRAWN), evidence, PROVENANCE)
    rendered = MarkdownIt("commonmark").enable("table").render(markdown)
    assert rendered.count("<table>") == html.count("<table>") >= 5
    assert rendered.count("<tr>") == len(re.findall(r"<tr[ >]", html))
    for row in re.findall(r"<tr>(.*?)</tr>", rendered, flags=re.DOTALL):
        assert "<td></td>" * 3 not in row
    assert [f"figures/{picture.name}.png" in markdown for picture in pictures] == [True] * 5


def test_the_page_can_be_made_again_from_its_tables(evidence: Evidence, tmp_path: Path) -> None:
    """Byte for byte, without a run; figures too, as PNG, SVG and PDF, and the same within the page as beside it."""
    study = made(DRAWN)
    first = write(study, evidence, PROVENANCE, tmp_path)
    before = {file.name: file.read_bytes() for file in first}
    again = write(study, Evidence.of_folder(study, tmp_path), PROVENANCE, tmp_path)
    assert [file.name for file in again] == list(before)
    for file in again:
        if file.suffix != ".parquet":
            assert file.read_bytes() == before[file.name], file.name
    assert {f"time.{kind}" for kind in ("png", "svg", "pdf")} <= set(before)
    drawings = {
        base64.b64decode(data) for data in re.findall(r"data:image/svg\+xml;base64,([^\"]+)", first[0].read_text())
    }
    assert drawings == {data for name, data in before.items() if name.endswith(".svg")}


def test_findings_stand_before_the_design(evidence: Evidence) -> None:
    """With their headings and remarks, as text."""
    html, markdown, _ = pages(made(ASKED), evidence, PROVENANCE)
    head = markdown.partition("\n## Design\n")[0]
    heading, sentence, remark = [line for line in head.splitlines() if line.lstrip().startswith("- ")]
    assert heading == "- **Waiting**"
    assert sentence.startswith("  - It is open whether the mean waiting time of sensed events is longer")
    assert remark == "  - By <b>runs</b>."
    assert "By &lt;b&gt;runs&lt;/b&gt;." in html


def test_a_page_says_how_many_tests_and_families_it_holds(evidence: Evidence) -> None:
    """A family is a contrast with a metric, or all claims of one source; one in twenty may show what is not there."""
    contrasts = {(row["contrast"], row["metric"]) for _, row in evidence.contrasts.iterrows()}
    sources = {row["source"] for _, row in evidence.claims.iterrows()}
    tests, families = len(evidence.contrasts) + len(evidence.claims), len(contrasts) + len(sources)
    assert min(len(contrasts), len(sources)) > 0
    said = pages(made(ASKED), evidence, PROVENANCE)[1]
    assert f"{tests} tests in {families} families" in said
    [expected] = re.findall(r"at most (\S+) families", said)
    assert abs(float(expected) - families / 20) < 0.06


def test_the_head_of_a_page_has_the_headings_of_ademp(evidence: Evidence) -> None:
    """In their order, before the first section, filled from the study: another sweep has other lines."""
    head = pages(made(ASKED), evidence, PROVENANCE)[1].partition("\n## Design\n")[2].partition("\n## ")[0]
    assert re.findall("### (.*)", head) == [
        "Aims", "Data-generating mechanism", "Estimands", "Methods", "Performance",
    ]  # fmt: skip
    assert "`smoke`: 6 agents, 40 m wide, 40 m high, 0.1 events per s, 1000 s long, 1 s a step" in head
    assert "10 of each of 6 variants. Their seeds are derived from 1;" in head
    assert "frames lost [share] (`radio.loss`): 0.0, 0.5, 0.9." in head.partition("### Methods")[0]
    assert "control (`control.mode`): decentralised, hybrid 3." in head.partition("### Methods")[2]
    other = dict(
        design(
            made(
                ASKED.replace("metrics = [", "margin = 1.3\nmetrics = [", 2).replace("margin = 1.3\n", "", 1),
                SWEEP.replace("repeats = 10", "repeats = 9"),
            )
        )
    )
    assert any("9 of each of 6 variants" in line for line in other["Data-generating mechanism"])
    assert any(line.startswith("Differences within 1.3 times count as none") for line in other["Performance"])


def test_every_estimate_has_its_standard_error(evidence: Evidence) -> None:
    """In parentheses, in the tables of contrasts, claims, fits, medians, estimates, and of recovery in a column."""
    assert evidence.estimates["mcse"].notna().all()
    markdown = pages(made(ASKED), evidence, PROVENANCE)[1]
    for heading, cell in (
        ("Verdicts", r"1\.00 \(0(\.0+)?\) "),
        ("Contrasts", r"1\.00 \(0(\.0+)?\) "),
        ("Closest to what is published", r"\d\.\d\d \(\d\.\d\d\)"),
        ("Medians", r"\d\.\d \(\d\.\d+\)"),
        ("Estimates", r"\d\.\d \(\d\.\d+\) \["),
    ):
        section = markdown.partition(f"## {heading}\n")[2].partition("\n## ")[0]
        assert re.search(cell, section), (heading, section)
    assert "Standard error [s]" in markdown.partition("## Recovery")[2]


def test_a_page_says_which_code_made_it_and_whether_the_study_changed(evidence: Evidence) -> None:
    """What it runs and what it asks are told apart; a provenance of before says nothing of it."""
    study = made(ASKED)
    runs, questions = study.digests
    known = pd.DataFrame({"what": [CODE, RUNS, QUESTIONS], "value": [provenance.code_digest(), runs, questions]})
    assert pages(study, evidence, known)[1].count("unchanged since the runs") == 1
    assert "not that of the runs" in pages(study, evidence, known.assign(value="0"))[1]
    other_question = made(ASKED.replace("It is open.", "It is still open."))
    text = pages(other_question, evidence, known)[1]
    assert "what it asks" in text
    assert "what it runs" not in text.replace(RUNS, "")
    other_runs = made(ASKED, SWEEP.replace("0.9]", "0.8]").replace("repeats = 10", "repeats = 9"))
    assert other_runs.digests[0] != runs
    assert "not known" in pages(study, evidence, PROVENANCE)[1]


def test_a_number_of_fewer_replicates_says_so(evidence: Evidence) -> None:
    holed = evidence.runs.copy()
    holed.loc[(holed["variant"] == holed["variant"].iloc[0]) & (holed["replicate"] > 5), "messages"] = float("nan")
    found = Evidence(made(ASKED), holed, evidence.courses, evidence.recovery)
    assert pages(made(ASKED), found, PROVENANCE)[1].count("(n = 6)") == 1


def test_labels_that_look_like_something_else_are_text(tmp_path: Path) -> None:
    frame = pd.DataFrame({"variant": ["10", "true", "None", "1e3"], "value": [1.0, 2.0, None, 4.0]})
    write_table(tmp_path / "t", frame)
    found = read_table(tmp_path / "t.csv")
    assert found["variant"].tolist() == ["10", "true", "None", "1e3"]
    assert found["value"].isna().tolist() == [False, False, True, False]


def test_a_table_shows_few_digits_and_marks_verdicts() -> None:
    """Numbers with the decimals of a typical one, missing ones as a dash, a colour beside the word."""
    frame = pd.DataFrame({"name": ["a", "b"], "value": [12.3456, None], "verdict": ["holds", "refuted"]})
    found = table(frame, {"name": "Name", "value": "Value"})
    assert found.rows == [("a", "12.3"), ("b", "-")]
    assert found.marks == ["good", "bad"]
    assert found.numeric == [False, True]


def test_nothing_is_left_out_silently_in_a_template() -> None:
    with pytest.raises(UndefinedError):
        render("page.md.jinja", {"title": "t"})


def test_a_figure_that_cannot_be_drawn_costs_no_page(evidence: Evidence) -> None:
    nothing = evidence.runs.assign(waiting=float("nan"))
    found = Evidence(made(DRAWN), nothing, evidence.courses, evidence.recovery)
    _, markdown, pictures = pages(made(DRAWN), found, PROVENANCE)
    assert "boxes" not in [picture.name for picture in pictures]
    assert "'boxes' is missing" in markdown


def test_an_index_links_the_pages_that_are_there(evidence: Evidence, tmp_path: Path) -> None:
    study = made(ASKED)
    write(study, evidence, PROVENANCE, tmp_path / study.name)
    index = write_index("mine", [study, replace(study, name="other")], tmp_path)
    for file in (index, index.with_suffix(".md")):
        links = re.findall(r"(?:href=\"|\]\()([^#\")]+)", file.read_text())
        assert links == [f"{study.name}/page{file.suffix}"]
        assert (tmp_path / links[0]).exists()
        count, families = len(evidence.contrasts) + len(evidence.claims), 3  # two metrics of a contrast, and the claims
        assert f"1 pages hold {count} tests in {families} families" in file.read_text()


def test_a_page_speaks_of_titles_and_never_of_keys(evidence: Evidence) -> None:
    """In its figures' words, the heads of its tables, its cells and its warnings; a level is named as its file does."""
    worse = evidence.runs.assign(waiting=1 / evidence.runs["waiting"])
    few = worse[worse["replicate"] < 6]
    found = Evidence(made(DRAWN), few, evidence.courses, evidence.recovery)
    _, markdown, _ = pages(made(DRAWN), found, PROVENANCE)
    told = re.sub(r"!\[.*?\]\(.*?\)|`[^`]*`", "", markdown.partition("## Where this comes from")[0])
    assert "frames lost [share]: 0.5" in told
    keys = "|".join(re.escape(name) for name in ("loss=", *(name for name in BUILT_IN if "_" in name)))
    lines = [line for line in told.splitlines() if re.search(keys, line) and "runs are missing" not in line]
    assert not lines  # but for the names of runs, by which a reader finds them
