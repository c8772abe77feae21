"""The page on limited networks: made from the numbers, answer first, what is not significant said so."""

import math
import re
from functools import cache
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from deltaswarm_orchestrator.analysis import intervals
from deltaswarm_orchestrator.analysis.report import to_html, to_markdown
from deltaswarm_orchestrator.limits import recovery
from deltaswarm_orchestrator.limits.answers import answer, loss_bar, loss_bar_in_words
from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS
from deltaswarm_orchestrator.limits.findings import NOT_PUBLISHED, Findings
from deltaswarm_orchestrator.limits.page import limits_page
from deltaswarm_orchestrator.limits.sentences import duration, effect_of, harm_in_words, paying_in_words
from tests.limiting import done, found, plain, series, table

DOCS = Path(__file__).parents[1] / "docs"
LOSS = EXPERIMENTS["network-loss"]


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch: pytest.MonkeyPatch) -> None:
    """The intervals' digits are not what is tested here."""
    monkeypatch.setattr(intervals, "RESAMPLES", 49)
    monkeypatch.setattr(recovery, "RESAMPLES", 49)


def crossing(level: str, mode: str, replicate: int) -> float:
    """Hybrid 3 waits half as long as decentralised, as long from half of the frames on, and longer with nine in ten."""
    if mode != "hybrid 3":
        return plain(level, "decentralised", replicate)
    factor = {"loss=0.5": 1.0, "loss=0.9": 1.6}.get(level, 0.5)
    return plain(level, "decentralised", replicate) * factor


@cache
def lost(waiting: float = 1.0) -> Findings:
    """Of a loss that changes hybrid 3's waiting, at any level, by a factor."""

    def changed(level: str, mode: str, replicate: int) -> float:
        is_hurt = mode == "hybrid 3" and level != "loss=0.0"
        nearly = 1 + (replicate - 4.5) / 1000  # equal ratios would be ties, which take the tests long
        return plain(level, mode, replicate) * (waiting * nearly if is_hurt else 1.0)

    return found(done("network-loss", table(LOSS, waiting=changed), series(LOSS, repeats=1)))


def test_the_page_begins_with_the_answer_in_five_sentences() -> None:
    """Whichever experiments were done."""
    findings = found(done("network-loss"), done("lose-the-roots"))
    page = to_markdown(limits_page(findings, blank=True))
    assert page.index("## The answer") < page.index("## Loss") < page.index("## All roots lost")
    sentences = answer(findings)
    assert len(sentences) == 5
    assert all(sentence.endswith(".") and sentence.count(". ") == 0 for sentence in sentences)


def test_where_hybrid_stops_paying_is_said() -> None:
    """From the level on at which its waiting is not shown to be shorter any more; longer, where it is longer."""
    findings = found(done("network-loss", table(LOSS, waiting=crossing)))
    assert "longer than decentralised's with 90 % of the frames lost: " in paying_in_words(findings, LOSS)
    assert "Hybrid 3 waits longer than decentralised with 90 % of the frames lost" in answer(findings)[1]

    def half(level: str, mode: str, replicate: int) -> float:
        return crossing("loss=0.5" if level == "loss=0.9" else level, mode, replicate)

    findings = found(done("network-loss", table(LOSS, waiting=half)))
    text = paying_in_words(findings, LOSS)
    assert "is shown no more with 50 % of the frames lost and beyond" in text
    assert "no proof" in text
    never = found(
        done(
            "network-loss", table(LOSS, waiting=lambda level, mode, replicate: plain(level, "decentralised", replicate))
        )
    )
    assert "not even without the limit" in paying_in_words(never, LOSS)


def test_what_is_not_shown_is_said_so() -> None:
    """Of each mode, of which suffers more, and in the answer."""
    findings = lost()
    assert "no change of waiting is shown" in effect_of(findings, LOSS, "hybrid 3")
    assert "is not shown" in harm_in_words(findings, LOSS, "waiting_s")
    assert "3 of 3 changes of waiting are not significant" in answer(findings)[4]
    assert "No loss of agents was tried" in answer(findings)[3]


def test_what_is_shown_has_its_numbers() -> None:
    """The levels, the ratio, the p, and who suffers more."""
    text = effect_of(lost(1.5), LOSS, "hybrid 3")
    assert "events wait longer with 10 % of the frames lost, with 30 %" in text
    assert "(at the hardest level 1.50 [1." in text
    assert "more in hybrid 3 than in decentralised" in harm_in_words(lost(1.5), LOSS, "waiting_s")
    assert "hybrid 3 with 90 % of the frames lost (1.50 times)" in answer(lost(1.5))[0]


@pytest.mark.parametrize(("factor", "holds"), [(1.48, True), (1.52, False)])
def test_the_bar_for_loss(factor: float, holds: bool) -> None:
    """At most 1.5 times as long with 30 % loss; the other levels are told, too."""
    bar = loss_bar(lost(factor))
    assert bar is not None
    assert bar.holds == holds
    (text,) = loss_bar_in_words(lost(factor))
    assert ("does not hold" not in text) == holds
    assert "with 10 % of the frames lost" in text
    assert "with 50 % of the frames lost" in text
    assert loss_bar_in_words(found(done("partition"))) == []


def test_too_few_replicates_are_a_warning() -> None:
    """Else nothing being significant would look like an answer."""
    few = found(done("network-loss", table(LOSS, repeats=3)))
    assert answer(few)[1] == "Hybrid 3 has too few replicates to show whether it pays in the runs of loss."
    assert "too few replicates" in to_markdown(limits_page(few, blank=True))
    assert "too few replicates" not in to_markdown(limits_page(lost(), blank=True))


def test_all_experiments_make_one_page(tmp_path: Path) -> None:
    """With figures, each with its command; the tables read again make the same page."""
    findings = found(*(done(name, repeats=3) for name in EXPERIMENTS))
    report = limits_page(findings, blank=True)
    names = [picture.name for picture in report.pictures()]
    assert len(names) == len(set(names)) == 5 * 2 + 5 * 2 + 2
    for picture in report.pictures():
        assert picture.command in {f"deltaswarm limits {name}" for name in EXPERIMENTS}
        assert picture.name.startswith(picture.command.rpartition(" ")[2])
    findings.save(tmp_path, without=NOT_PUBLISHED)
    assert not (tmp_path / "windows.csv").exists()
    assert to_markdown(limits_page(Findings.load(tmp_path), blank=True)) == to_markdown(report)


def test_figures_show_what_the_tables_have() -> None:
    """Against the limit, a line per mode; over time, with the time of the limit in grey."""
    report = limits_page(found(done("jamming")))
    waiting, _, over_time, _ = report.pictures()
    assert isinstance(waiting.drawing, Figure)
    assert isinstance(over_time.drawing, Figure)
    (axes,) = waiting.drawing.axes
    assert axes.get_xlabel() == "radius of the jammed circle [m]"
    assert len(axes.containers) == 3
    (axes,) = over_time.drawing.axes
    assert [patch.get_extents().width > 0 for patch in axes.patches] == [True]
    assert to_html(report).count("<img") == 4


def test_a_swarm_without_values_has_a_page_all_the_same() -> None:
    """Runs that ended before their fault: nothing to compare, no figure against the limit, no traceback."""
    experiment = EXPERIMENTS["jamming"]
    rows = series(experiment)
    findings = found(done("jamming", None, rows[rows["time_s"] < 600]))
    page = to_markdown(limits_page(findings))
    assert "nothing to compare" in page
    assert "not known" in page
    assert "jamming-waiting.png" not in page
    assert "jamming-waiting-over-time.png" in page


def test_times_are_written_for_people() -> None:
    """Never as inf or nan."""
    assert [duration(value) for value in (300.0, math.inf, math.nan)] == ["300 s", "not by the end", "-"]


# The page in the repository


def test_the_published_page_is_what_its_tables_say() -> None:
    """Every number and every word of docs/network-limits.md follows from the tables beside it."""
    findings = Findings.load(DOCS / "network-limits")
    page = (DOCS / "network-limits.md").read_text()
    assert page == to_markdown(limits_page(findings, blank=True), "network-limits/figures")
    for file in re.findall(r"\]\((network-limits/figures/[^)]+)\)", page):
        assert (DOCS / file).is_file()


def test_the_published_runs_are_those_of_the_sweeps() -> None:
    """All nine experiments, all their replicates, whole runs; and loss over the 20 seeds that its bar asks for."""
    findings = Findings.load(DOCS / "network-limits")
    assert findings.sweeps["experiment"].tolist() == list(EXPERIMENTS)
    assert (findings.sweeps["duration_s"] == 9000.0).all()
    assert (findings.sweeps["by_processes"] == findings.sweeps["equal_digests"]).all()
    per_variant = findings.runs.groupby(["experiment", "level", "mode"]).size()
    assert (per_variant.loc["network-loss"] == 20).all()
    assert per_variant.min() == 10
    assert isinstance(findings.windows, pd.DataFrame)
    assert findings.windows.empty
