"""`deltaswarm reproduce`, with runs so short that a test can wait for them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.cli import reports as cli_reports
from deltaswarm_orchestrator.reproduction import conditions
from deltaswarm_orchestrator.reproduction.conditions import Extent
from deltaswarm_orchestrator.reproduction.paper_claims import REMARKS

pytestmark = pytest.mark.processes

TINY = Extent("quick", 2, 90.0, 1, judges_convergence=False)


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conditions, "QUICK", TINY)


@pytest.fixture(scope="module")
def done_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a reproduction of figure 2."""
    folder = tmp_path_factory.mktemp("figure-2") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conditions, "QUICK", TINY)
        main(["reproduce", "--figure", "2", "--out", str(folder)])
    return folder


@pytest.fixture
def figure_2(done_once: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(done_once, tmp_path / "out"))


@pytest.fixture(scope="module")
def swept_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small sweep."""
    folder = tmp_path_factory.mktemp("swept") / "s"
    short = ["--set", "run.duration_s=20", "--repeats", "1", "--prove", "0", "--out", str(folder)]
    assert main(["sweep", "smoke", *short]) == 0
    return folder


def test_a_reproduction_writes_its_report(tiny: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All conditions, one page, five figures, a verdict on each claim; and the code says whether all are well."""
    code = main(["reproduce", "--quick", "--out", str(tmp_path), "--json"])
    printed = json.loads(capsys.readouterr().out)
    failed = {claim["claim"]: claim["p"] for claim in printed["claims"] if claim["verdict"] == "does not hold"}
    assert failed, "runs of 90 s cannot show the paper's waiting times"
    orders = {name for name, p in failed.items() if p is not None and name not in REMARKS}
    assert code == (3 if orders else 0)
    table = pd.read_csv(tmp_path / "sweep" / "table.csv")
    assert table.groupby("variant").size().unique().tolist() == [TINY.repeats]
    assert sorted(file.name for file in (tmp_path / "figures").glob("*.png")) == [
        f"figure-{n}.png" for n in range(1, 6)
    ]
    assert len(list((tmp_path / "figures").glob("*.svg"))) == 5
    page, text = (tmp_path / "report.html").read_text(), (tmp_path / "report.md").read_text()
    for claim in printed["claims"]:
        assert claim["claim"] in text
    assert page.count("<img") + page.count("<svg") >= 5
    assert json.loads((tmp_path / "sweep" / "manifest.json").read_text())["digest"] in text
    first = text.index("does not hold")
    assert "| holds |" not in text[:first]


def test_one_figure_needs_only_its_runs(tiny: None, figure_2: Path) -> None:
    """Figure 2 shows three control structures; the next command adds to the same folder and loses nothing."""
    table = pd.read_csv(figure_2 / "sweep" / "table.csv")
    assert set(table["variant"]) == set(conditions.FIGURES[2])
    assert [file.name for file in (figure_2 / "figures").glob("*.png")] == ["figure-2.png"]
    main(["reproduce", "--figure", "4", "--out", str(figure_2)])
    more = pd.read_csv(figure_2 / "sweep" / "table.csv")
    assert set(more["variant"]) == {*conditions.FIGURES[2], *conditions.FIGURES[4]}
    kept = more.merge(table[["variant", "replicate", "digest"]], on=["variant", "replicate", "digest"])
    assert len(kept) == len(table)


def test_figure_1_needs_no_sweep(tmp_path: Path) -> None:
    """It shows three moments, which are run on the spot."""
    assert main(["reproduce", "--figure", "1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "figures" / "figure-1.png").stat().st_size > 10_000


def test_processes_have_the_same_digests(figure_2: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs by real processes stand beside those in one process, digest by digest; here one of each condition."""
    monkeypatch.setattr(conditions, "QUICK", replace(TINY, repeats=1))
    main(["reproduce", "--figure", "2", "--processes", "--out", str(figure_2)])
    table = pd.read_csv(figure_2 / "sweep" / "table.csv")
    assert len(table) == len(conditions.FIGURES[2])
    assert (table["digest_in_process"] == table["digest_processes"]).all()


@pytest.mark.parametrize("arguments", [["--figure", "6"], ["--quick", "--full"], ["-j", "0"], ["--scheduler", "x"]])
def test_nonsense_ends_with_2(arguments: list[str], tmp_path: Path) -> None:
    """Nothing is run."""
    try:
        code = main(["reproduce", *arguments, "--out", str(tmp_path / "new")])
    except SystemExit as ended:
        code = int(ended.code or 0)
    assert code == 2
    assert not (tmp_path / "new").exists()


def test_a_report_of_a_sweep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`deltaswarm report` on a user's own sweep, with a reference and a further figure of the runs."""
    file = tmp_path / "mine.toml"
    file.write_text(
        'schema = 1\nbase = "smoke"\n[sweep]\nrepeats = 3\nprove = 0\n[sweep.axes]\nradio.loss = [0.0, 0.2, 0.4]\n'
    )
    short = ["--set", "run.duration_s=60", "--series", "--out", str(tmp_path / "mine")]
    assert main(["sweep", str(file), *short]) == 0
    capsys.readouterr()
    arguments = ["--reference", "loss=0.4", "--figure", "bytes_sent_per_s.mean", "--json"]
    assert main(["report", str(tmp_path / "mine"), *arguments]) == 0
    files = [Path(name) for name in json.loads(capsys.readouterr().out)]
    assert all(name.exists() for name in files)
    assert "loss=0.0 against loss=0.4" in (tmp_path / "mine" / "report.md").read_text()


@pytest.mark.parametrize("wrong", ["nothing", "reference", "figure"])
def test_a_report_that_cannot_be_made_ends_with_2(
    wrong: str, swept_once: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder without a sweep, a variant or a figure that is not there: one line says so."""
    folder = tmp_path / "s" if wrong == "nothing" else swept_once
    capsys.readouterr()
    extra = {"nothing": [], "reference": ["--reference", "nobody"], "figure": ["--figure", "none.such"]}[wrong]
    assert main(["report", str(folder), *extra]) == 2
    assert capsys.readouterr().err.startswith("deltaswarm: ")


def test_the_commands_name_the_figures() -> None:
    """What the parser allows is what can be drawn."""
    assert set(cli_reports.FIGURES) == set(conditions.FIGURES)
