"""What a page shows of single events: curves, rings and tables, the same from its tables, and why one is missing."""

import math
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_orchestrator.base.seal import SealError
from deltaswarm_orchestrator.sweeps.table import read_table
from deltaswarm_studies import style
from deltaswarm_studies.drawing import Drawing, draw
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.looks import of_levels
from deltaswarm_studies.page import pages, write
from tests.support.studying import FAST, OWN, SAME, SLOW, made
from tests.support.studying import table as runs_table

REPLICATES = 8
NAMES = f'variants = ["{SAME}", "{SLOW}"]\n'
ASKED = (
    f'[[survival]]\ntext = "Told"\nreference = "{SAME}"\n{NAMES}'
    f'[[rings]]\ntext = "Around"\nrings = 2\n{NAMES}'
    f'[[figure]]\nname = "told"\nkind = "survival"\nmetric = "told_s"\n{NAMES}'
    f'[[figure]]\nname = "around"\nkind = "rings"\nmetric = "told_s"\nrings = 2\nfacet = "mode"\n{NAMES}'
)
PROVENANCE = pd.DataFrame({"what": ["runs"], "value": ["60"]})


def events(*variants: str, wait_s: float = 20.0) -> pd.DataFrame:
    """Four events in each run, told after 20 s and more, twice as late under `SLOW`, the last one never."""
    rows = [
        {"variant": name, "replicate": replicate, "event": place, "x_m": 0.0, "y_m": 0.0, "from_densest_m": place + 1.0,
         "arrived_s": 0.0, "sensed_s": 1.0, "worked_s": math.nan, "completed_s": math.nan, "end_s": 1000.0,
         "told_s": (wait_s + place + replicate) * (2 if name == SLOW else 1) if place < 3 else math.nan}
        for name in variants
        for replicate in range(REPLICATES)
        for place in range(4)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def evidence_of(own: str = ASKED, rows: pd.DataFrame | None = None) -> Evidence:
    study = made(OWN + own)
    return Evidence.of_sweep(study, runs_table(), pd.DataFrame(), (), events(SAME, SLOW) if rows is None else rows)


def drawn(number: int, own: str = ASKED) -> Drawing:
    study = made(OWN + own)
    return draw(study.file.figure[number], study, evidence_of(own))


def test_a_curve_for_each_variant_with_its_band() -> None:
    """From all to what is left at the horizon; the axes have words and units, the legend what is drawn."""
    drawing = drawn(0)
    [axes] = drawing.figure.axes
    assert [list(line.get_ydata())[::400] for line in axes.lines] == [[1.0, 0.25], [1.0, 0.25]]
    assert axes.get_xlim() == (0.0, 100.0)
    assert len(axes.collections) == 2
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "time since arrival [s]",
        "events not yet told to the\noperator [share]",
    )
    [legend] = drawing.figure.legends
    study = made(OWN)
    assert [text.get_text() for text in legend.get_texts()] == [
        style.shown(study.variant_title(name)) for name in (SAME, SLOW)
    ]
    assert drawing.notes == ("Kaplan-Meier curves of all events; bands are 95 % intervals over 8 runs.",)


def test_a_hue_gives_each_level_its_look_of_all_figures() -> None:
    names = f'variants = ["{FAST}", "{SLOW}"]\n'
    own = ASKED.replace('kind = "survival"', 'kind = "survival"\nhue = "mode"').replace(NAMES, names)
    own = own.replace(f'reference = "{SAME}"\n', "")
    study = made(OWN + own)
    drawing = draw(study.file.figure[0], study, evidence_of(own, events(FAST, SLOW)))
    halves = [
        next(x for x, y in zip(*line.get_data(), strict=True) if y <= 0.5) for line in drawing.figure.axes[0].lines
    ]
    assert halves[1] == pytest.approx(2 * halves[0], abs=0.5)
    looks = of_levels(study, "mode")
    assert [line.get_color() for line in drawing.figure.axes[0].lines] == [look.colour for look in looks.values()]


def test_rings_are_drawn_at_their_mean_distance() -> None:
    figure = drawn(1).figure
    [axes] = figure.axes
    at = [line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2]
    assert [sum(x) / 2 for x in zip(*at[:1], at[-1], strict=True)] == pytest.approx([1.5, 3.5])
    assert axes.get_ylabel() == "mean time until told to\nthe operator [s]"


def test_tables_by_hand() -> None:
    """Times beyond the horizon are longer than that; differences and p-values are those of eight replicates."""
    _, markdown, _ = pages(made(OWN + ASKED), evidence_of(), PROVENANCE)
    of_loss = "| frames lost [share]: {}, hybrid 3 | 8 | 32 |"
    [same] = [line for line in markdown.splitlines() if line.startswith(of_loss.format(SAME.split(", ")[0][-3:]))]
    [slow] = [line for line in markdown.splitlines() if line.startswith(of_loss.format(SLOW.split(", ")[0][-3:]))]
    assert same.split(" | ")[3] == slow.split(" | ")[3] == "75.0"
    assert same.split(" | ")[6:] == ["> 100", "-", "-", "- |"]
    # (24.5 + 0, 1, 2 on average, and 100) / 4, or twice the first three. From run to run 0.75 s more, or 1.5 s: a
    # standard deviation of 2.45 times that over 8 runs.
    assert same.split(" | ")[4].startswith("43.4 (0.65) [")
    assert slow.split(" | ")[4].startswith("61.8 (1.3) [")
    assert slow.split(" | ")[7].startswith("18.4 [")
    assert slow.split(" | ")[8:] == ["0.008", "0.008 |"]
    [outer] = [line for line in markdown.splitlines() if line.startswith("| 3.0 to 4.0 |")]
    assert outer.split(" | ")[1] == "16"
    assert outer.split(" | ")[2].startswith("62.8 [")
    assert "the intervals are over runs" in markdown
    assert "This page holds 2 tests in 2 families." in markdown


def test_a_page_is_the_same_from_its_tables(tmp_path: Path) -> None:
    study = made(OWN + ASKED)
    write(study, evidence_of(), PROVENANCE, tmp_path)
    assert {"events.csv", "survival.csv", "rings.csv"} <= {file.name for file in tmp_path.iterdir()}
    again = Evidence.of_folder(study, tmp_path)
    assert again.incomplete == []
    first, second = (pages(study, found, PROVENANCE, "x")[:2] for found in (evidence_of(), again))
    assert first == second
    (tmp_path / "events.csv").write_text((tmp_path / "events.csv").read_text().replace("1000.0", "2000.0"))
    with pytest.raises(SealError, match=r"events\.csv"):
        Evidence.of_folder(study, tmp_path)


def test_runs_without_events_leave_a_reason_in_place_of_figures(tmp_path: Path) -> None:
    evidence = evidence_of(rows=pd.DataFrame())
    _, markdown, pictures = pages(made(OWN + ASKED), evidence, PROVENANCE)
    assert pictures == []
    assert evidence.incomplete == ["This study's runs carry no events: nothing is said of their times."]
    assert evidence.undrawn == [
        "The figure 'told' is missing: this study's runs carry no events.",
        "The figure 'around' is missing: this study's runs carry no events.",
    ]
    assert "Times of events" not in markdown
    some = evidence_of(rows=events(SAME))
    pages(made(OWN + ASKED), some, PROVENANCE)
    assert some.incomplete == [f"There are no events of {SLOW!r}."]
    assert some.undrawn[0] == f"The figure 'told' is missing: events.csv has no events of {SLOW!r}."


def test_a_study_that_asks_nothing_about_events_keeps_them(tmp_path: Path) -> None:
    study = made(OWN)
    write(study, evidence_of(""), PROVENANCE, tmp_path)
    assert len(read_table(tmp_path / "events.csv")) == 2 * REPLICATES * 4
    assert "Times" not in (tmp_path / "page.md").read_text()
