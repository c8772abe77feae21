"""`deltaswarm limits`, with runs so short that a test can wait for them."""

import json
import re
from pathlib import Path

import pytest

from deltaswarm_orchestrator.analysis import intervals
from deltaswarm_orchestrator.analysis.report import to_markdown
from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.limits import recovery
from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS, MODES
from deltaswarm_orchestrator.limits.findings import Findings
from deltaswarm_orchestrator.limits.page import limits_page
from tests.swarms import is_running, running, wait_until

SMALL = ("--quick", "--repeats", "2", "--prove", "0", "-j", "1", "--set", "agents.count=6")


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch: pytest.MonkeyPatch) -> None:
    """The intervals' digits are not what is tested here."""
    monkeypatch.setattr(intervals, "RESAMPLES", 49)
    monkeypatch.setattr(recovery, "RESAMPLES", 49)


@pytest.mark.processes
def test_a_limit_that_is_always_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Runs, tables, figures and page; a second time nothing is run, another experiment takes over what is shared."""
    command = ["limits", "network-loss", *SMALL, "--set", "run.duration_s=90", "--out", str(tmp_path / "out")]
    page = tmp_path / "docs" / "on-limits.md"
    page.parent.mkdir()
    assert main([*command, "--page", str(page), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert len(printed["answer"]) == 6
    (doubt,) = printed["doubts"]
    assert "too few replicates for any difference, however large, to be significant in the runs of loss" in doubt
    assert all(Path(file).is_file() for file in printed["files"])
    found = Findings.load(page.with_suffix(""))
    assert len(found.runs) == 5 * 3 * 2
    assert page.read_text() == to_markdown(limits_page(found, blank=True), "on-limits/figures")
    figures = sorted(file.name for file in (tmp_path / "docs" / "on-limits" / "figures").iterdir())
    assert figures == ["network-loss-messages.png", "network-loss-waiting.png"]
    assert "too few replicates" in page.read_text()
    assert main(command) == 0
    again = capsys.readouterr()
    assert "30 of 30 runs are there already" in again.err
    assert again.out.splitlines()[0] == doubt
    other = ["limits", "network-bandwidth", *SMALL, "--set", "run.duration_s=90", "--out", str(tmp_path / "out")]
    assert main(other) == 0
    assert "network-bandwidth: 6 runs are those of other experiments" in capsys.readouterr().err
    assert (tmp_path / "out" / "report.html").read_text().count("<img") == 2


@pytest.mark.processes
def test_the_roots_are_lost(tmp_path: Path) -> None:
    """Where there are any; the page has the time that each mode needs to come back, with its figures over time."""
    keys = {
        "run.duration_s": "5100",
        "run.step_s": "5",
        "arena.width_m": "30",
        "arena.height_m": "30",
        "events.density.mean_m": "[15.0, 15.0]",
        "events.density.covariance_m2": "[[9.0, 0.0], [0.0, 9.0]]",
    }
    few = ["--repeats", "1", *(word for key, value in keys.items() for word in ("--set", f"{key}={value}"))]
    assert main(["limits", "lose-the-roots", *SMALL, *few, "--out", str(tmp_path)]) == 0
    found = Findings.load(tmp_path)
    killed = found.runs[found.runs["level"] == "roots lost"].groupby("mode")["killed"].sum()
    assert killed["decentralised"] == 0
    assert killed["hierarchical"] > 0
    assert killed["hybrid 3"] > 0
    assert (found.runs.loc[found.runs["level"] == "none lost", "killed"] == 0).all()
    nothing_happened = found.recovery[found.recovery["mode"] == "decentralised"]
    assert (nothing_happened["worst"] == 1.0).all()
    before = found.windows[found.windows["time_s"] < 4500].set_index("level")[["messages_per_s", "in_trees"]]
    same = before.loc["none lost"].to_numpy() == before.loc["roots lost"].to_numpy()
    assert same.all(), "before the fault the same arrivals make the same swarm"
    drawn = {file.name for file in (tmp_path / "figures").glob("*.png")}
    assert drawn == {f"lose-the-roots-{name}-over-time.png" for name in ("waiting", "messages", "in-trees")}


@pytest.mark.processes
def test_each_experiment_is_a_sweep_and_has_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By the commands for sweeps of one's own, too."""
    few = ["--repeats", "1", "--prove", "0", "--set", "run.duration_s=30", "--out", str(tmp_path), "--series"]
    assert main(["sweep", "jamming", *few]) == 0
    assert main(["report", str(tmp_path)]) == 0
    assert "20 m, hybrid 3" in (tmp_path / "report.md").read_text()
    assert main(["sweep", "uplink-outage", "--dry-run"]) == 0
    assert [line for line in capsys.readouterr().out.splitlines() if line.startswith("outage, ")] == [
        f"outage, {mode}" for mode in MODES
    ]


@pytest.mark.processes
def test_the_roots_processes_are_killed_while_the_run_goes_on(tmp_path: Path) -> None:
    """The fault of `lose-the-roots`, early, with real processes: those of the roots are gone, all others live."""
    fault = 'fault=[{kind="kill", at_s=60, roots=true}]'
    options = ("--set", "run.duration_s=100000", "--set", "events.rate_hz=0.3", "--set", fault, "--record", "off")
    with running(tmp_path / "run", *options) as swarm:
        wait_until(lambda: len(swarm.pids) == 8 and "(kill)" in swarm.log("world"), "the fault")
        swarm.wait_for_steps(1)
        gone = {name for name, pid in swarm.pids.items() if not is_running(pid)}
        ordered = re.search(r"agents? ([\d, ]+)\(kill\)", swarm.log("world"))
        assert ordered is not None
        assert gone == {f"agent {number}" for number in re.findall(r"\d+", ordered[1])}
        assert gone


def test_mistakes_in_names_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, what was meant perhaps, and nothing is begun."""
    out = tmp_path / "out"
    assert main(["limits", "network-lose", "xyz", "--out", str(out)]) == 2
    errors = capsys.readouterr().err
    assert "no experiment is called 'network-lose'; did you mean 'network-loss'?" in errors
    assert f"'xyz'; there are {', '.join(EXPERIMENTS)}" in errors
    assert main(["limits", "jamming", "--page", "page.html", "--out", str(out)]) == 2
    assert main(["limits", "jamming", "--set", "radio.lose=1", "--out", str(out)]) == 2
    assert "did you mean 'loss'?" in capsys.readouterr().err
    assert main(["limits", "jamming", "-j", "0", "--out", str(out)]) == 2
    assert not out.exists() or not list(out.glob("*/runs/*"))
    (tmp_path / "file").write_text("")
    assert main(["limits", "jamming", "--out", str(tmp_path / "file")]) == 2
