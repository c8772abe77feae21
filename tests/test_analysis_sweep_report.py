"""The report of a sweep: what was swept, comparisons in words, drawings that fit, warnings that are not missed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pytest

from deltaswarm_orchestrator.analysis.figure_names import FIGURES, named
from deltaswarm_orchestrator.analysis.report import Notes, Picture, Report, Section, Table, to_html, to_markdown
from deltaswarm_orchestrator.analysis.statistics import compare_all
from deltaswarm_orchestrator.analysis.sweep_report import in_words, sweep_report

WAIT = "waiting_time_s.mean"


def a_table(
    variants: Mapping[str, Mapping[str, Any]], waits: Sequence[float] | None = None, repeats: int = 8
) -> pd.DataFrame:
    """A sweep's table: variants with their swept keys; each variant waits 5 s longer than the one before."""
    noise = np.random.default_rng(1).normal(0, 1, (len(variants), repeats))
    rows = []
    for place, (label, keys) in enumerate(variants.items()):
        for replicate in range(repeats):
            wait = 20 + 5 * place if waits is None else waits[place]
            head = {"variant": label, **keys, "replicate": replicate, "seed": 100 + replicate}
            figures = {WAIT: wait + replicate + noise[place][replicate], "trees.mean": float(place), "valid": True}
            rows.append({**head, **figures, "agents_late": place})
    return pd.DataFrame(rows)


MODES = {mode: {"control.mode": mode} for mode in ("decentralised", "hierarchical", "hybrid 3")}
LOSSES = {
    f"{mode} {loss}": {"radio.loss": loss, "control.mode": mode}
    for mode in ("hybrid", "other")
    for loss in (0, 0.2, 0.5)
}


def a_manifest(**more: Any) -> dict[str, Any]:
    known = {"name": "mine", "base": "paper-25", "seed": 1, "repeats": 8, "swept": ["control.mode"], "runs": 24}
    proofs = {"checked": 2, "equal": 2}
    return {
        **known,
        "digest": "abc",
        "failed": [],
        "proofs": proofs,
        "versions": {"python": "3.11"},
        "wall_s": 3.0,
        **more,
    }


def section(report: Report, heading: str) -> Section:
    (found,) = [section for section in report.sections if section.heading == heading]
    return found


def of_kind(section: Section, kind: type) -> list[Any]:
    return [block for block in section.blocks if isinstance(block, kind)]


def test_the_report_says_what_was_swept() -> None:
    """Keys, values, seed, proofs, digest; and has a section for each main figure that the table has."""
    report = sweep_report("sweeps/mine", a_manifest(), a_table(MODES))
    (facts,) = of_kind(report.sections[0], Table)
    known = dict(facts.rows)
    assert known["`control.mode`"] == "decentralised, hierarchical, hybrid 3"
    assert known["proven by real processes"] == "2 runs, of which 2 with an equal digest"
    assert known["runs"] == "24 finished of 24, 0 failed"
    assert of_kind(report.sections[0], Notes) == []
    assert [s.heading for s in report.sections[2:]] == ["Mean waiting time", "Trees"]
    assert "deltaswarm report sweeps/mine" in to_markdown(report)


def test_the_report_says_whose_seconds_they_are_and_when_nothing_was_compared() -> None:
    """The wall time is that of all sessions; runs by one means alone prove nothing."""
    manifest = a_manifest(sessions=3, means="processes", proofs={"checked": 0, "equal": 0})
    (facts,) = of_kind(sweep_report("x", manifest, a_table(MODES)).sections[0], Table)
    known = dict(facts.rows)
    assert known["wall time of 3 sessions"] == "3.00 s"
    assert known["proven by real processes"] == "none: no run was done by both means"


def test_what_is_wrong_is_a_warning() -> None:
    """Failed runs, missing ones, digests that differ, runs that are not valid."""
    table = a_table(MODES).iloc[:-1]
    table.loc[3, "valid"] = False
    manifest = a_manifest(failed=["hybrid 3, replicate 7: crashed"], proofs={"checked": 2, "equal": 1}, digest=None)
    (warning,) = of_kind(sweep_report("x", manifest, table).sections[0], Notes)
    assert warning.is_warning
    text = "\n".join(warning.lines)
    for part in (
        "crashed",
        "1 of 24 runs are missing",
        "1 run had another digest",
        "not valid: decentralised, replicate 3",
    ):
        assert part in text


def test_differences_are_told_in_words() -> None:
    """Longer or shorter, by how much, with interval, p and family; the interval has the sentence's own direction."""
    table = a_table(MODES)
    up, _ = compare_all(table, WAIT, "decentralised").to_dict("records")
    sentence = in_words(up, named(WAIT), 2)
    assert sentence.startswith("hierarchical against decentralised: longer by 4.75 s (95 % interval 4.19 to 5.44); ")
    assert "p = 0.016, Holm over 2, effect 1.00." in sentence
    down, _ = compare_all(table, WAIT, "hybrid 3").to_dict("records")
    sentence = in_words(down, named(WAIT), 2)
    assert "shorter by 10" in sentence or "shorter by 9." in sentence
    low, high = (float(end) for end in sentence.split("interval ")[1].split(")")[0].split(" to "))
    assert 0 < low < high


def test_what_does_not_show_is_not_called_a_difference() -> None:
    """Whatever its sign."""
    row, _ = compare_all(a_table(MODES, waits=[20, 20.1, 19.9]), WAIT, "decentralised").to_dict("records")
    assert "no difference shown" in in_words(row, named(WAIT), 2)


def test_too_few_replicates_are_said() -> None:
    """Of 3 pairs no comparison can show anything; with 8 there is no such warning."""
    small = section(sweep_report("x", a_manifest(), a_table(MODES, repeats=3)), "Mean waiting time")
    assert [note.is_warning for note in of_kind(small, Notes)] == [False, True]
    assert "0.500" in of_kind(small, Notes)[1].lines[0]
    large = section(sweep_report("x", a_manifest(), a_table(MODES)), "Mean waiting time")
    assert [note.is_warning for note in of_kind(large, Notes)] == [False]


def test_the_reference_can_be_chosen() -> None:
    """By its label."""
    report = sweep_report("x", a_manifest(), a_table(MODES), reference="hybrid 3")
    (notes,) = of_kind(section(report, "Mean waiting time"), Notes)
    assert all("against hybrid 3: shorter" in line for line in notes.lines)
    with pytest.raises(ValueError, match="no variant is called 'hybird'"):
        sweep_report("x", a_manifest(), a_table(MODES), reference="hybird")


def test_a_swept_number_is_drawn_as_lines() -> None:
    """One per group; two values alone, or variants that share no line, are drawn as boxes."""
    swept = a_manifest(swept=["radio.loss", "control.mode"])
    (picture,) = of_kind(section(sweep_report("x", swept, a_table(LOSSES)), "Mean waiting time"), Picture)
    assert picture.caption.startswith("Mean waiting time over `radio.loss`")
    two = {label: keys for label, keys in LOSSES.items() if keys["radio.loss"] < 0.5}
    (picture,) = of_kind(section(sweep_report("x", swept, a_table(two)), "Mean waiting time"), Picture)
    assert "over" not in picture.caption
    (picture,) = of_kind(section(sweep_report("x", a_manifest(), a_table(MODES)), "Mean waiting time"), Picture)
    assert "quartiles" in picture.caption


def test_more_variants_than_looks_are_drawn_in_parts() -> None:
    """Rather than not at all."""
    many = {f"v{number}": {"control.mode": f"v{number}"} for number in range(7)}
    pictures = of_kind(section(sweep_report("x", a_manifest(), a_table(many)), "Mean waiting time"), Picture)
    assert [picture.name for picture in pictures] == [f"{WAIT}.1", f"{WAIT}.2"]
    assert [picture.caption[-12:] for picture in pictures] == ["Part 1 of 2.", "Part 2 of 2."]


def test_figures_can_be_added() -> None:
    """Any column of numbers; text and unknown names are refused by name."""
    report = sweep_report("x", a_manifest(), a_table(MODES), figures=["agents_late"])
    assert report.sections[-1].heading == "Agents late"
    with pytest.raises(ValueError, match="'agents_latte'"):
        sweep_report("x", a_manifest(), a_table(MODES), figures=["agents_latte"])
    with pytest.raises(ValueError, match=r"control\.mode holds no numbers"):
        sweep_report("x", a_manifest(), a_table(MODES), figures=["control.mode"])


def test_a_figure_without_any_value_does_not_end_the_report() -> None:
    """Nor does one that a single variant lacks."""
    table = a_table(MODES)
    table["trees.mean"] = None
    table.loc[table["variant"] == "hierarchical", WAIT] = np.nan
    report = sweep_report("x", a_manifest(), table)
    assert section(report, "Trees").blocks == ["No run has a value."]
    (notes, *_) = of_kind(section(report, "Mean waiting time"), Notes)
    assert notes.lines[0] == "hierarchical against decentralised: nothing to compare."
    assert "nan" not in to_html(report).lower().split("</style>")[1].split("data:image")[0]


def test_one_variant_of_one_run_is_a_report_too() -> None:
    """Without comparisons and intervals."""
    table = a_table({"only": {"control.mode": "hybrid"}}, repeats=1)
    report = sweep_report("x", a_manifest(runs=1), table)
    assert of_kind(section(report, "Mean waiting time"), Notes) == []
    to_html(report)
    with pytest.raises(ValueError, match="no finished run"):
        sweep_report("x", a_manifest(), table.iloc[:0])


def test_a_series_is_drawn_over_time() -> None:
    """The agents in trees."""
    rows = [
        {"variant": mode, "replicate": r, "time_s": t, "agents_in_trees": float(r + t)}
        for mode in MODES
        for r in range(3)
        for t in (0.0, 60.0)
    ]
    report = sweep_report("x", a_manifest(), a_table(MODES), pd.DataFrame(rows))
    (picture,) = of_kind(section(report, "Over time"), Picture)
    assert picture.name == "agents_in_trees"


def test_the_same_sweep_gives_the_same_page() -> None:
    """Tables, intervals and drawings."""
    pages = [to_html(sweep_report("x", a_manifest(), a_table(MODES))) for _ in range(2)]
    assert pages[0] == pages[1]


def test_figures_have_names_and_units() -> None:
    """The main ones by hand, others from the table's own name."""
    assert named(WAIT) is FIGURES[WAIT]
    for figure, label in (
        ("bytes_sent_per_s.mean", "Bytes sent [1/s]"),
        ("waiting_time_s.median", "Waiting time median [s]"),
        ("frames_dropped.loss", "Frames dropped loss"),
        ("covered_area_m2.mean_while_trees", "Covered area mean while trees [m²]"),
    ):
        assert named(figure).label == label
