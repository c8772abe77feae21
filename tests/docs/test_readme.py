"""Every command of README and docs/SWEEPS.md works as written (with short runs, in this virtual environment)."""

import csv
import re
from collections import Counter
from pathlib import Path

import pytest

from tests.support.pages import ROOT, commands, files, serve, shell

README, SWEEPS = ((ROOT / name).read_text() for name in ("README.md", "docs/SWEEPS.md"))

PUBLISHED = {
    "decentralised": "decentralised",
    "hierarchical, rho 2": "hierarchical",
    "hybrid, delta 3": "hybrid 3",
    "hierarchical, rho 6": "rho 6",
    "adaptive": "adaptive",
    "central": "central",
}
"""The study's variant by the start of a row of the README."""

SHORTER = {
    "run": "--set run.duration_s=20 --set agents.count=6",
    "run hard.toml": "--in-process --set run.duration_s=4510 --set run.step_s=10",
    "sweep": "--set run.duration_s=20 --set agents.count=3 --repeats 1 --prove 0",
    "study lose-the-roots": "--repeats 1 --prove 0 --set agents.count=3 --set run.duration_s=6000 --set run.step_s=10",
}


def shortened(command: str) -> str:
    """The `deltaswarm` part of a command, with a short run."""
    own = command[command.index("deltaswarm ") :]
    before, sign, target = own.partition(" > ")
    verb = " ".join(before.split()[1:3])
    less = SHORTER.get(verb, SHORTER.get(verb.split()[0], ""))
    return f"{before} {less}{sign}{target}"


@pytest.mark.processes
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("page", "least", "studies"),
    [
        pytest.param(README, 8, False, id="README"),
        pytest.param(README, 9, True, marks=pytest.mark.slow, id="README with its study"),
        pytest.param(SWEEPS, 6, True, marks=pytest.mark.slow, id="SWEEPS"),
    ],
)
def test_the_commands_work(page: str, least: int, studies: bool, tmp_path: Path) -> None:
    """In the order in which they stand, in one folder, with exit code 0."""
    lines = [line for line in commands(page) if "deltaswarm " in line]
    lines = [line for line in lines if studies or "deltaswarm study " not in line or "--plan" in line]
    assert len(lines) >= least
    for name, text in files(page).items():
        (tmp_path / name).write_text(text)
    for line in lines:
        if line.startswith("deltaswarm replay"):
            serve(line, tmp_path)
            continue
        done = shell(shortened(line), tmp_path)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"


def test_the_gate_runs_the_readmes_own_test_command() -> None:
    """The block that .ci/run takes is there, sets up its environment and calls pytest, in one line."""
    found = re.search(r"<!-- tests -->\n```sh\n(.*)\n```", README)
    assert found is not None
    assert found[1].startswith("python3 -m venv .venv && ")
    assert found[1].endswith("-m pytest -q -n 6")
    main = re.search(r"<!-- run -->\n```sh\n(.*)\n```", README)
    assert main is not None
    assert main[1].endswith("deltaswarm run paper-25")


def test_the_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert target.startswith("http") or (ROOT / target).exists(), target


def test_the_moving_pictures_load_quickly() -> None:
    """Together they have at most 1.5 MB, and they move."""
    pictures = [ROOT / target for target in re.findall(r"\]\((\S+\.webp)\)", README)]
    assert len(pictures) == 2
    assert sum(picture.stat().st_size for picture in pictures) <= 1.5e6
    assert all(b"ANIM" in picture.read_bytes()[:64] for picture in pictures)


def test_the_results_are_the_published_ones() -> None:
    """Verdicts and medians of the README are those of the study's tables."""
    page, folder = (ROOT / "README.md").read_text(), ROOT / "docs" / "studies" / "paper"
    with (folder / "claims.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["source"] != "Our readings"]
    verdicts = Counter(row["verdict"] for row in rows if not row["calibrated"])
    chosen = Counter(row["verdict"] for row in rows if row["calibrated"])
    lines = page.partition("<!-- verdicts: paper -->\n")[2].partition("<!-- end -->")[0].strip().splitlines()
    _, contradicted, undecided, holds = lines
    total = verdicts.total()
    assert f"{verdicts['refuted'] + verdicts['differs']} of {total} claims are refuted" in contradicted
    assert f"{chosen['refuted'] + chosen['differs']} of {chosen.total()} numbers" in contradicted
    assert f"and with {verdicts['depends on the metric']} it depends on the metric" in undecided
    assert f"{verdicts['holds'] + verdicts['agrees']} of the {total} claims" in holds
    with (folder / "estimates.csv").open() as file:
        medians = {(row["variant"], row["metric"]): float(row["median"] or "nan") for row in csv.DictReader(file)}
    for start, variant in PUBLISHED.items():
        row = re.findall(rf"^\| {start}.*$", page, re.MULTILINE)[0]
        shown = [float(cell.split()[0]) for cell in row.strip("| ").split(" | ")[1:]]
        found = [medians[variant, metric] for metric in ("waiting", "told_s", "completion_s", "messages")]
        assert shown == pytest.approx(found, rel=0.005, abs=0.06), variant
