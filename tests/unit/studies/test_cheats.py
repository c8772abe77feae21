"""What an author could do to bend a study's record, and what its page, its checks or its exit code then say.

Every cheat is done to a small study with short runs. What none of this shows is in docs/STUDIES.md.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from deltaswarm import sweeps
from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.base.exits import FAILED, MISSED
from deltaswarm_orchestrator.base.frozen import hashes_of
from deltaswarm_orchestrator.sweeps.engine import ThisProcess
from deltaswarm_orchestrator.sweeps.folder import SweepFolderError
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, nothing_more
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_orchestrator.sweeps.runner import SweepResult
from deltaswarm_studies import protocol
from deltaswarm_studies.checking import check
from deltaswarm_studies.conducting import StudyResult, beforehand, concluded
from deltaswarm_studies.fixed import content
from deltaswarm_studies.freezing import amend, freeze
from deltaswarm_studies.load import load_study
from deltaswarm_studies.origin import WITH_THE_RUNS, seal_tables
from deltaswarm_studies.protocol import ProtocolError, seeded
from deltaswarm_studies.protocol_page import NOT_JUDGED, Record
from deltaswarm_studies.settings import PROTOCOL

STUDY = """
schema = 1
name = "own"
base = "smoke"
scenario.run.duration_s = 100.0
scenario.metrics.horizon_s = 50.0

[sweep]
repeats = 7
prove = 0
series_every_s = 50.0

[[sweep.paired]]
label = ["decentralised", "hybrid"]
control.mode = ["decentralised", "hybrid"]

[study]
metrics = ["messages"]

[[contrast]]
id = "modes"
factor = "mode"
reference = "decentralised"

[[claim]]
id = "near"
text = "Decentralised swarms send about six reports a second"
kind = "value"
metric = "messages"
of = "decentralised"
within = [5.9, 6.0]

[[claim]]
id = "some"
text = "Hybrid swarms report"
kind = "value"
metric = "messages"
of = "hybrid"
within = [0.0, 5.9]
"""
SOME = STUDY[STUDY.index('[[claim]]\nid = "some"') :]
CONTRAST = STUDY[STUDY.index("[[contrast]]") : STUDY.index("[[claim]]")]
NEAR = STUDY[STUDY.index("[[claim]]") : STUDY.index(SOME)]

PLUG_IN = """
from deltaswarm_agent.controllers.potential import PotentialController, PotentialSettings


class Own(PotentialController):
    Settings = PotentialSettings
"""

Edit = Callable[[list[dict[str, Any]]], object]


def conduct(sweep: Sweep, folder: Path) -> SweepResult:
    """Do the missing runs in this process."""
    make = lambda: ThisProcess(nothing_more)  # noqa: E731
    return sweeps.conduct(sweep, folder, make, means=IN_PROCESS, quiet=True, with_series=True)


class Author:
    """Somebody with a study file and the folder of its page."""

    def __init__(self, at: Path, text: str = STUDY) -> None:
        self.file, self.folder = at / "own.toml", at / "own"
        self.write(text)

    def write(self, text: str) -> None:
        self.file.parent.mkdir(exist_ok=True)
        self.file.write_text(text)
        self.study = load_study(str(self.file))

    def freeze(self, replaces: str = "") -> None:
        freeze(self.study, self.folder, self.file, replaces)

    def run(self) -> StudyResult:
        return concluded(seeded(self.study, self.folder), self.folder, conduct, self.file)

    def render(self) -> StudyResult:
        return concluded(seeded(self.study, self.folder), self.folder, None, self.file)

    def edit(self, edit: Edit, *, rehash: bool = False) -> None:
        """Edit the protocol by hand, and perhaps make its hashes right again."""
        record = json.loads((self.folder / PROTOCOL).read_text())
        edit(record["entries"])
        if rehash:
            for place, entry in enumerate(record["entries"]):
                entry["hash"] = hashes_of(record["entries"][: place + 1], "own")[-1]
        (self.folder / PROTOCOL).write_text(json.dumps(record))

    def edit_runs(self, change: Callable[[pd.DataFrame], pd.DataFrame], *, reseal: bool) -> None:
        (self.folder / seal.RECORD).unlink()
        runs = change(pd.read_csv(self.folder / "runs.csv"))
        runs.to_csv(self.folder / "runs.csv", index=False)
        if reseal:
            told = pd.read_csv(self.folder / "provenance.csv", dtype=str)
            seal_tables(self.study, told, self.folder, sorted(self.folder.glob("*.csv")), WITH_THE_RUNS)


def first_line(result: StudyResult) -> str:
    return result.page.with_suffix(".md").read_text().splitlines()[2]


def kinds(result: StudyResult) -> list[str]:
    """Return what contradicts the protocol; the exit code then tells, too, and the page has a warning for each."""
    found = [breach.kind for breach in result.protocol.breaches]
    assert (result.code() in (MISSED, FAILED)) or not found
    page = result.page.with_suffix(".md").read_text()
    assert all(f"> {line}" in page for line in result.protocol.problems)
    assert all(breach.brief in first_line(result) for breach in result.protocol.breaches[:1])
    return found


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a study that was frozen and then run."""
    with pytest.MonkeyPatch.context() as committed:
        committed.setattr(provenance, "uncommitted", list)
        author = Author(tmp_path_factory.mktemp("honest"))
        author.freeze()
        result = author.run()
    assert kinds(result) == []
    assert first_line(result).startswith("Frozen on ")
    assert Record(result.protocol, result.evidence).surprises["verdict"].tolist() == ["refuted", "holds"]
    return author.file.parent


@pytest.fixture
def author(honest: Path, tmp_path: Path) -> Author:
    """The author of a copy of that folder."""
    shutil.copytree(honest, tmp_path / "copy")
    return Author(tmp_path / "copy")


def test_runs_from_before_the_protocol_are_not_its_own(tmp_path: Path) -> None:
    """Cheat: do the runs elsewhere, with the seeds of the file; freeze what they show; move them in."""
    pilot, author = Author(tmp_path / "pilot"), Author(tmp_path / "later")
    assert "pilot" in first_line(pilot.run())
    author.freeze()
    for table in (*pilot.folder.glob("*.csv"), pilot.folder / seal.RECORD):
        shutil.copy(table, author.folder)
    with pytest.MonkeyPatch.context() as later:
        later.setattr(provenance, "now", lambda: "2100-01-01T00:00:00+00:00")
        assert protocol.SEEDS in kinds(author.render())
    shutil.copytree(pilot.folder / "sweep", author.folder / "sweep")
    with pytest.raises(SweepFolderError, match=r"sweep\.seed"):
        author.run()


def test_code_that_changed_between_protocol_and_runs_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cheat: change deltaswarm after freezing; an amendment from before the runs mends it."""
    told = []
    for name in ("silent", "amended"):
        author = Author(tmp_path / name)
        with monkeypatch.context() as before:
            before.setattr(provenance, "code_digest", lambda: "0123456789abcdef")
            files = {**provenance.code_files(), "deltaswarm_agent/core/decide.py": "01234567"}
            before.setattr(provenance, "code_files", lambda files=files: files)
            author.freeze()
        if name == "amended":
            amend(author.study, author.folder, author.file, "A faster loop.")
        assert any("decide.py" in line for line in beforehand(author.study, author.folder)[0]) == (name == "silent")
        result = author.run()
        told.append((kinds(result), "1 file: deltaswarm_agent/core/decide.py" in first_line(result)))
    assert told == [([protocol.CODE_CHANGED], True), ([], False)]


def test_a_plug_in_that_changed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cheat: freeze with one controller, and do the runs with another of the same name."""
    module = tmp_path / "cheating.py"
    module.write_text(PLUG_IN)
    monkeypatch.syspath_prepend(tmp_path)
    author = Author(tmp_path / "study", STUDY.replace('mode = ["decentralised"', 'mode = ["cheating:Own"'))
    author.freeze()
    module.write_text(f"{PLUG_IN}# better\n")
    command = [sys.executable, "-m", "deltaswarm_orchestrator", "study", author.file, "--out", author.folder, "-j", "1"]
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False)
    assert "cheating:Own" in done.stderr, "before hours are spent, too"
    assert kinds(author.render()) == [protocol.PLUGINS_CHANGED]


def test_a_claim_that_is_dropped_still_counts(author: Author) -> None:
    """Cheat: take the refuted claim out of the file; also if no other claim keeps its metric in the table."""
    author.write(STUDY.replace(NEAR, ""))
    result = author.render()
    assert kinds(result) == [protocol.FILE_CHANGED]
    assert "claim.near" in first_line(result)
    counted = Record(result.protocol, result.evidence).surprises.set_index("claim")["is_surprise"]
    assert dict(counted) == {"near": True, "some": False}
    author.edit_runs(lambda runs: runs.rename(columns={"messages": "other"}), reseal=True)
    result = author.render()
    assert set(Record(result.protocol, result.evidence).surprises["verdict"]) == {NOT_JUDGED}
    assert "2 of 2" in first_line(result)


def test_a_criterion_that_is_changed_afterwards_changes_no_surprise(author: Author) -> None:
    """Cheat: widen the margin after the runs; an amendment that says why changes no surprise either."""
    author.write(STUDY.replace("[5.9, 6.0]", "[0.0, 5.9]"))
    result = author.render()
    assert kinds(result) == [protocol.FILE_CHANGED]
    assert result.claims["verdict"].tolist() == ["holds", "holds"]
    assert Record(result.protocol, result.evidence).surprises["is_surprise"].tolist() == [True, False]
    amend(author.study, author.folder, author.file, "It was a typo.")
    result = author.render()
    assert kinds(result) == []
    assert Record(result.protocol, result.evidence).surprises["is_surprise"].tolist() == [True, False]


def test_a_metric_that_is_redefined_afterwards_judges_no_claim(author: Author) -> None:
    """Cheat: take the mean from 50 s on after the runs; with an amendment the old claims cannot be judged."""
    author.write(STUDY.replace('["messages"]\n', '["messages"]\nfrom_s = 50.0\n', 1))
    amend(author.study, author.folder, author.file, "It was a typo.")
    result = author.render()
    assert kinds(result) == []
    assert set(Record(result.protocol, result.evidence).surprises["verdict"]) == {NOT_JUDGED}


def test_an_outcome_is_not_switched_by_freezing_anew(author: Author) -> None:
    """Cheat: freeze again after the runs, with claims that they fit; the older verdicts come first on the page."""
    author.write(STUDY.replace(CONTRAST + NEAR, "").replace('["messages"]', '["waiting_all", "messages"]'))
    with pytest.raises(ProtocolError, match="--replaces"):
        author.freeze()
    (author.folder / PROTOCOL).rename(author.folder / "elsewhere.json")
    with pytest.raises(ProtocolError, match="before its first run"):
        author.freeze()
    (author.folder / "elsewhere.json").rename(author.folder / PROTOCOL)
    author.freeze("The first outcome was the wrong one.")
    result = author.run()
    assert kinds(result) == []
    page = result.page.with_suffix(".md").read_text()
    first, rest = page.split("## Design")
    assert "The first outcome was the wrong one." in first
    assert re.search(r"\| Decentralised swarms send about six .*\| holds \| refuted \|", first)
    assert "waiting_all, messages" in first
    [record] = result.protocol.replaced
    assert [row["verdict"] for row in record["claims"]] == ["refuted", "holds"]
    assert "Surprises among the claims that it replaces: 1 of 2" in first_line(result)
    assert "1 of 1 contrasts have another verdict now" in rest


def test_the_verdicts_of_what_is_replaced_cannot_be_taken_out(author: Author) -> None:
    """Cheat: take the older study out of the chain, also with a new hash, which gives other seeds."""
    author.freeze("To ask it again.")
    author.run()
    whole = (author.folder / PROTOCOL).read_text()
    for rehash, kind in ((False, protocol.EDITED), (True, protocol.SEEDS)):
        (author.folder / PROTOCOL).write_text(whole)
        author.edit(lambda entries: entries[0].update(replaces=[]), rehash=rehash)
        assert kinds(author.render())[0] == kind


def test_a_protocol_that_was_edited_is_named(author: Author) -> None:
    """Cheat: write what was found into protocol.json, and perhaps a hash that fits; or an earlier date."""
    edits: list[Edit] = [
        lambda entries: entries[0]["protocol"]["claim"]["near"].update(expect="refuted"),
        lambda entries: entries[0].update(date="2020-01-01T00:00:00+00:00"),
        lambda entries: entries[0]["code"].update(digest="0123456789abcdef"),
    ]
    whole = (author.folder / PROTOCOL).read_text()
    for edit in edits:
        for rehash, kind in ((False, protocol.EDITED), (True, protocol.SEEDS)):
            (author.folder / PROTOCOL).write_text(whole)
            author.edit(edit, rehash=rehash)
            assert kinds(author.render())[0] == kind


def test_a_protocol_of_the_older_format_is_told_from_others(tmp_path: Path) -> None:
    """Cheat: run with the seeds of the file, then write a protocol as older versions did, with an early date."""
    author = Author(tmp_path / "study")
    author.run()
    told = {"date": "2020-01-01T00:00:00+00:00", "commit": {}, "uncommitted": [], "reason": ""}
    entry = {**told, "protocol": content(author.study, 1)}
    entry["hash"] = hashes_of([{**entry, "hash": ""}], "own")[0]
    (author.folder / PROTOCOL).write_text(json.dumps({"study": "own", "entries": [entry]}))
    result = author.render()
    assert kinds(result) == []
    assert protocol.OWN_SEEDS in first_line(result)


def test_an_amendment_with_a_forged_date_is_named(author: Author) -> None:
    """Cheat: amend after the runs, then say that it was before them, with hashes that fit."""
    author.write(STUDY.replace("[5.9, 6.0]", "[0.0, 5.9]"))
    amend(author.study, author.folder, author.file, "It was a typo.")
    author.edit(lambda entries: entries[1].update(date=entries[0]["date"], runs=0), rehash=True)
    assert kinds(author.render()) == [protocol.SEEDS]


@pytest.mark.usefixtures("checked_by_python")
def test_an_edited_number_is_found(author: Author) -> None:
    """Cheat: edit runs.csv; without a seal the first line says so, and with a new one the run does not repeat."""
    numbers = pd.read_csv(author.folder / "runs.csv")["messages"]
    data = (author.folder / "runs.csv").read_text()
    (author.folder / "runs.csv").write_text(data.replace(str(numbers[0]), "5.77", 1))
    with pytest.raises(seal.SealError):
        author.render()
    author.edit_runs(lambda runs: runs, reseal=False)
    assert kinds(author.render()) == [protocol.UNSEALED]
    (author.folder / seal.RECORD).touch()
    author.edit_runs(lambda runs: runs, reseal=True)
    assert kinds(author.render()) == []
    found = check(author.study, author.folder, 14, 1, ThisProcess(nothing_more))
    assert (found["repeated"], found["equal"]) == (14, 13)
    assert [(row["run"], row["metric"]) for row in found["differing"]] == [("decentralised, replicate 0", "messages")]


def test_rows_that_are_left_out_are_missed(author: Author) -> None:
    """Cheat: leave out a replicate that does not fit, and plan fewer."""
    author.edit_runs(lambda runs: runs[runs["replicate"] < 6], reseal=True)
    result = author.render()
    assert result.code() == FAILED
    assert result.evidence.incomplete
    author.write(STUDY.replace("repeats = 7", "repeats = 6"))
    assert kinds(author.render()) == [protocol.FILE_CHANGED]


def test_results_of_another_study_are_not_taken(author: Author, tmp_path: Path) -> None:
    """Cheat: put the tables of a like study into the folder, with their seal or without."""
    other = Author(tmp_path / "other", STUDY.replace('"own"', '"other"'))
    other.freeze()
    other.run()
    for table in (*other.folder.glob("*.csv"), *other.folder.glob("*.parquet"), other.folder / seal.RECORD):
        shutil.copy(table, author.folder)
    with pytest.raises(seal.SealError, match="'own'"):
        author.render()
    (author.folder / seal.RECORD).unlink()
    assert kinds(author.render()) == [protocol.SEEDS, protocol.UNSEALED]


def test_code_that_is_not_committed_freezes_and_publishes_nothing(
    author: Author, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cheat: do it with code that nobody else has."""
    monkeypatch.setattr(provenance, "uncommitted", lambda: ["core.py"])
    with pytest.raises(ProtocolError, match=r"core\.py"):
        Author(tmp_path / "new").freeze()
    assert kinds(author.render()) == []
    monkeypatch.setattr(provenance, "is_tracked", lambda folder: folder == author.folder)
    with pytest.raises(ProtocolError, match=r"core\.py"):
        author.render()
