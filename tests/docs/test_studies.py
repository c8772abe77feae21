"""The page on studies: its example works, it names every key, and what is published follows from its tables."""

import dataclasses
import io
import re
from pathlib import Path

import pandas as pd
import pytest
from docs.extensions.scenario_keys import study_reference

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.provenance import code_digest
from deltaswarm_orchestrator.sweeps.engine import LocalEngine
from deltaswarm_studies.checking import check
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.load import COLLECTIONS, load_study
from deltaswarm_studies.metrics import BUILT_IN
from deltaswarm_studies.origin import sealed_tables
from deltaswarm_studies.protocol import EDITED, LATE, SEEDS, protocol_of
from deltaswarm_studies.settings import EXPLORATORY, StudyFile
from deltaswarm_wire.checked import SettingsError
from tests.support.pages import ROOT, commands, files, shell
from tests.support.tiers import nightly

PAGE = (ROOT / "docs" / "STUDIES.md").read_text()
PUBLISHED = sorted(file.parent for file in (ROOT / "docs" / "studies").glob("*/runs.csv"))
NAMES = ["paper", *nightly(*(folder.name for folder in PUBLISHED if folder.name != "paper"))]
SHORTER = "--set run.duration_s=100 --set metrics.horizon_s=50 --repeats 7 --prove 0"


@pytest.mark.slow
def test_the_example_works(tmp_path: Path) -> None:
    """Its commands in their order, with shorter runs: a page with the finding's claim judged."""
    (tmp_path / "my-study.toml").write_text(files(PAGE)["my-study.toml"])
    for command in commands(PAGE):
        done = shell(f"{command} {SHORTER}", tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr
    assert pd.read_csv(tmp_path / "studies/my-study/claims.csv")["verdict"].notna().all()
    assert (tmp_path / "studies/my-study/figures/messages.pdf").exists()


@pytest.mark.slow
def test_the_example_of_single_events_works(tmp_path: Path) -> None:
    (tmp_path / "heard.toml").write_text(files(PAGE)["heard.toml"])
    done = shell("deltaswarm study heard.toml --set run.duration_s=300 --repeats 3 --prove 0", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("events", "survival", "rings"):
        assert len(pd.read_csv(tmp_path / f"studies/heard/{name}.csv"))
    for name in ("told", "told-by-distance"):
        assert (tmp_path / f"studies/heard/figures/{name}.pdf").exists()


def test_an_example_looks_good_and_is_refused(tmp_path: Path) -> None:
    """Before any run, for the reason that the page gives."""
    for name, text in files(PAGE).items():
        (tmp_path / name).write_text(text)
    assert load_study(str(tmp_path / "heard.toml"))
    with pytest.raises(SettingsError, match="no event is complete within 30 s, whatever the swarm does"):
        load_study(str(tmp_path / "too-short.toml"))


def test_the_page_of_keys_is_up_to_date() -> None:
    """docs/STUDY_KEYS.md is what `study_reference` writes: every key of sweep and study files."""
    assert (ROOT / "docs" / "STUDY_KEYS.md").read_text() == study_reference()


def test_every_metric_and_kind_of_table_is_named() -> None:
    """A table that nobody can read about is not there."""
    tables = {f"`[[{spec.name}]]`" for spec in dataclasses.fields(StudyFile)} - {"`[[study]]`"} | {"`[study]`"}
    assert not {text for text in {*tables, *(f"`{name}`" for name in BUILT_IN)} if text not in PAGE}


def test_the_index_links_every_study() -> None:
    """Built-in studies are published; `deltaswarm study all --render --out docs/studies` writes the index."""
    index = (ROOT / "docs" / "studies" / "index.md").read_text()
    linked = sorted(re.findall(r"\]\((.*?)/page\.md\)", index))
    assert linked == sorted(folder.name for folder in PUBLISHED)
    assert set(linked) == {name for names in COLLECTIONS.values() for name in names}


def test_the_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert target.startswith("http") or (ROOT / "docs" / target).exists(), target


@pytest.mark.parametrize("name", NAMES)
def test_what_is_published_follows_from_its_tables(name: str) -> None:
    """Every estimate, contrast and verdict, from the published runs, and every sentence of its findings."""
    folder, study = ROOT / "docs" / "studies" / name, load_study(name)
    assert {file.name for file in folder.glob("*.csv")} <= {*seal.files_of(sealed_tables(folder, study))}
    found = Evidence.of_folder(study, folder)
    for name in ("estimates", "contrasts", "claims"):
        frame = getattr(found, name)
        if len(frame):
            published = pd.read_csv(folder / f"{name}.csv")
            ours = pd.read_csv(io.StringIO(frame.to_csv(index=False)))
            pd.testing.assert_frame_equal(ours, published)
    page = (folder / "page.md").read_text()
    assert all(line.partition(": ")[2] in page.partition("**Surprises**")[2] for line in found.surprises)
    assert all(sentence in page for finding in found.findings for sentence in finding.sentences)
    protocol = protocol_of(study, folder, pd.read_csv(folder / "provenance.csv"), found.runs)
    assert not {EDITED, LATE, SEEDS} & {breach.kind for breach in protocol.breaches}
    unfrozen = "Exploratory" if protocol.kind == EXPLORATORY else "Not frozen before its runs"
    assert page.splitlines()[2].startswith("Frozen on " if protocol.is_before_the_runs else unfrozen)
    assert protocol.is_before_the_runs == (folder / "protocol.json").exists()


@pytest.mark.parametrize("folder", PUBLISHED, ids=lambda folder: folder.name)
def test_all_runs_of_a_page_are_by_one_digest_of_the_code(folder: Path) -> None:
    """Else their difference could be that of the code."""
    told = pd.read_csv(folder / "provenance.csv", dtype=str).set_index("what")["value"]
    assert re.fullmatch("[0-9a-f]{16}", told["digest of the code"])


@pytest.mark.parametrize("name", nightly(*(folder.name for folder in PUBLISHED)))
def test_todays_code_repeats_a_published_run(name: str) -> None:
    """Every number of it, by the other engine where it can: a page is never older than the code."""
    checked = check(load_study(name), ROOT / "docs" / "studies" / name, 1, int(code_digest(), 16), LocalEngine(2))
    assert checked["differing"] == []
