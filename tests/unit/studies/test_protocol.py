"""A frozen protocol: what it holds, what contradicts it, and what cannot be frozen or amended."""

import json
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.frozen import hash_of
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.fixed import content, differences
from deltaswarm_studies.freezing import amend, freeze
from deltaswarm_studies.page import pages, write
from deltaswarm_studies.protocol import EDITED, ProtocolError, protocol_of, seeded
from deltaswarm_studies.protocol_page import Record
from deltaswarm_studies.settings import PROTOCOL
from deltaswarm_studies.study import Study
from tests.support.drawn_studies import CLAIMED, DRAWN
from tests.support.studying import LEVELS, LIMIT, OWN, SWEEP, made, series, table
from tests.support.tiers import in_one_test

CLAIM = (
    '[[claim]]\nid = "c"\ntext = "Hybrid waits less"\nless = "loss=0.0, hybrid 3"\n'
    'more = "loss=0.0, decentralised"\nat_least = 1.5\nexpect = "undecided"\nwhy = "Unknown."\n'
)
SHOWN = (
    '[[figure]]\nname = "f"\nx = "mode"\nhue = "loss"\ncaption = "F."\n'
    '[[finding]]\nheading = "Waiting"\nresults = [{ claim = "c" }]\n'
)
ASKED = OWN + LIMIT + CLAIM
EARLY, BEGUN, LATE = (f"2026-01-0{day}T12:00:00+00:00" for day in (1, 2, 3))


@pytest.fixture
def at(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Set the date."""
    return lambda date: monkeypatch.setattr(provenance, "now", lambda: date)


@pytest.fixture
def folder(tmp_path: Path, at: Callable[[str], None]) -> Path:
    """A folder with the protocol of `ASKED`, frozen before the runs."""
    at(EARLY)
    freeze(made(ASKED), tmp_path / "made-up", None)
    return tmp_path / "made-up"


def changed(folder: Path, own: str = ASKED, sweep: str = SWEEP) -> list[str]:
    """Return the keys in which another version differs."""
    return [found.key for found in protocol_of(made(own, sweep), folder).unamended]


def origin(begun: str) -> pd.DataFrame:
    """Say when the runs began, by the code of now."""
    return pd.DataFrame({"what": ["begun", "digest of the code"], "value": [begun, provenance.code_digest()]})


def edited(folder: Path, edit: Callable[[dict[str, Any]], object]) -> None:
    """Edit the record by hand."""
    record = json.loads((folder / PROTOCOL).read_text())
    edit(record)
    (folder / PROTOCOL).write_text(json.dumps(record))


def test_a_protocol_holds_what_is_run_asked_and_expected(folder: Path) -> None:
    """Conditions, replicates, outcomes, criteria, margins, expectations, date, code, commit and hash; no seed."""
    [entry] = json.loads((folder / PROTOCOL).read_text())["entries"]
    assert entry["date"] == EARLY
    assert entry["commit"]["deltaswarm"] == provenance.commit()
    assert len(entry["hash"]) == 64
    told = entry["protocol"]
    assert told["condition"]["loss=0.5, hybrid 3"] == {"radio.loss": 0.5, "control.mode": "hybrid"}
    assert told["scenario"]["run.duration_s"] == 1000.0
    assert (told["runs"]["repeats"], {"seed", "seeds"} & {*told["runs"]}) == (10, set())
    digests = {"digest": provenance.code_digest(), "files": provenance.code_files(), "plug-ins": {}}
    assert entry["code"] == digests
    assert told["study"]["metrics"] == ["waiting_all", "messages"]
    assert told["contrast"]["limit"]["margin"] == 1.1
    assert (told["claim"]["c"]["at_least"], told["claim"]["c"]["expect"]) == (1.5, "undecided")


@in_one_test(
    ("old", "new", "keys"),
    [
        ("margin = 1.1", "margin = 1.2", ["contrast.limit.margin"]),
        ('expect = "undecided"', 'expect = "holds"', ["claim.c.expect"]),
        ("Hybrid waits less", "Hybrid waits more", ["claim.c.text"]),
        ('["waiting_all", "messages"]', '["waiting_all"]', ["study.metrics"]),
        ("[study]", '[study]\nkind = "exploratory"', ["study.kind"]),
        (CLAIM, "", ["claim.c"]),
        (LIMIT, LIMIT + LIMIT.replace('"limit"', '"more"'), ["contrast.more"]),
        ("repeats = 10", "repeats = 9", ["runs.repeats"]),
        ("repeats = 10", "repeats = 10\nseed = 2", []),
        ("series_every_s = 100.0", "series_every_s = 50.0", ["runs.series_every_s"]),
        ("duration_s = 1000.0", "duration_s = 2000.0", ["scenario.run.duration_s"]),
        ("[scenario]\n", "[scenario]\nrun.step_s = 0.5\n", ["scenario.run.step_s"]),
        ('"hybrid"]', '"hierarchical"]', [f"condition.{loss}, hybrid 3.control.mode" for loss in LEVELS]),
        ("[study]", '[study]\ntitle = "T"', []),
        ("Unknown.", "Known.", []),
        (CLAIM, CLAIM + SHOWN, []),
    ],
)
def test_a_change_is_named_by_its_key(folder: Path, old: str, new: str, keys: list[str]) -> None:
    """Of what is run or asked; words, figures and findings are written after the runs, or decide nothing."""
    assert (old in ASKED) != (old in SWEEP)
    assert changed(folder, ASKED.replace(old, new, 1), SWEEP.replace(old, new, 1)) == keys


def test_a_change_of_what_the_study_file_only_names_is_named(folder: Path) -> None:
    """Of another base; and conditions that are gone or new."""
    found = changed(folder, sweep=SWEEP.replace('base = "smoke"', 'base = "paper-25"'))
    assert {"scenario.agents.count", "scenario.events.rate_hz"} <= {*found}
    found = changed(folder, sweep=SWEEP.replace("0.5, 0.9", "0.5, 0.8"))
    assert {"condition.loss=0.8, hybrid 3", "condition.loss=0.9, hybrid 3"} <= {*found}


def test_what_git_does_not_have_is_not_frozen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Code of deltaswarm, and a study file in a repository; outside of one, the commit is said not to be known."""
    own = tmp_path / "own.toml"
    own.write_text("new")
    freeze(made(ASKED), tmp_path / "made-up", own)
    assert protocol_of(made(ASKED), tmp_path / "made-up").facts["not in the commit"] == "own.toml is in no repository"
    monkeypatch.setattr(provenance, "commit", lambda: None)
    freeze(made(ASKED), tmp_path / "a" / "made-up", None)
    found = protocol_of(made(ASKED), tmp_path / "a" / "made-up").facts
    assert (found["commit"], found["not in the commit"]) == ("not known", "deltaswarm is in no repository")
    for what, told in (("uncommitted", "core.py"), ("commit_of", "own.toml")):
        with monkeypatch.context() as dirty:
            dirty.setattr(provenance, what, lambda *_: ("abc", False) if _ else ["core.py"])
            with pytest.raises(ProtocolError, match=told):
                freeze(made(ASKED), tmp_path / "b" / "made-up", own)
    assert not (tmp_path / "b" / "made-up").exists()


def test_two_tables_of_one_name_are_two() -> None:
    """Else a change of the first would go unseen."""
    targets = 'targets = [{ level = "hybrid 3", metric = "messages", says = 26.0, iqr = 4.0 }]\n'
    fit = f'[[fit]]\ntext = "Fit"\nfactor = "mode"\n{targets}'
    two, other = content(made(OWN + fit + fit)), content(made(OWN + fit.replace("26.0", "27.0") + fit))
    assert [found.key for found in differences(two, other)] == ["fit.Fit.targets"]


def test_a_key_that_is_new_in_deltaswarm_counts_as_its_default(folder: Path) -> None:
    """A protocol of an earlier version is not contradicted by a key that nobody could set then."""
    old = content(made(ASKED))
    del old["claim"]["c"]["n"], old["study"]["window_s"], old["scenario"]["control.rho"], old["recovery"]
    found = differences(old, content(made(ASKED)))
    assert [(row.key, row.old, row.new) for row in found] == [("study.window_s", "300.0", "100.0")]


def test_a_key_by_its_older_name_is_no_change() -> None:
    """Published protocols keep the names of the day on which they were frozen."""
    old, new = content(made(ASKED)), content(made(ASKED))
    assert old["scenario"].pop("control.delta_rule") == "fixed"
    old["scenario"]["control.adapts_delta"] = False
    assert not differences(old, new)
    old["scenario"]["control.adapts_delta"] = True
    assert [(row.key, row.old, row.new) for row in differences(old, new)] == [
        ("scenario.control.delta_rule", "busy", "fixed")
    ]


def test_a_density_that_is_drawn_is_fixed_by_its_choices_alone() -> None:
    """The seeds come from the protocol, so what its first point was to have is not what the first run has."""
    density = '[[sensitivity.range]]\nname = "events.density"\ntitle = "Events"\n'
    density += 'choices = {{ even = {{ kind = "uniform" }}, uneven = {{ mean_m = [{}, 20.0] }} }}\n'
    old, new = (content(made(CLAIMED, DRAWN + density.format(x))) for x in (20.0, 20.0))
    assert not [key for key in old["scenario"] if key.startswith("events.density")]
    old["scenario"] |= {"events.density.kind": "gaussian", "events.density.covariance_m2": [[200.0, 0.0], [0.0, 200.0]]}
    assert not differences(old, new)
    new = content(made(CLAIMED, DRAWN + density.format(10.0)))
    assert [found.key for found in differences(old, new)] == ["sensitivity.range.events.density.choices.uneven.mean_m"]


def test_a_key_of_a_part_that_is_switched_off_is_no_change() -> None:
    """A rule for budgets does nothing without a budget, so another default of it changes no run."""
    old, new = content(made(ASKED)), content(made(ASKED))
    old["scenario"]["operator.budget.aim"] = 0.5
    assert not differences(old, new)
    for one in (old, new):
        one["scenario"]["operator.autonomy.sets_delta"] = "budget"
    assert [found.key for found in differences(old, new)] == ["scenario.operator.budget.aim"]


def test_a_changed_margin_stands_on_the_page_with_both_values(folder: Path) -> None:
    """In the first line, a warning and a table; the untouched study has none of them."""
    for own, count in ((ASKED, 0), (ASKED.replace("margin = 1.1", "margin = 1.3"), 3)):
        study = made(own)
        evidence = Evidence.of_sweep(study, table(), series(lambda *_: 20.0))
        page = pages(study, evidence, pd.DataFrame({"what": [], "value": []}), protocol=protocol_of(study, folder))[1]
        assert page.count("contrast.limit.margin") == count
        assert ("contrast.limit.margin was 1.1, is 1.3" in page) == bool(count)


def test_an_entry_that_was_edited_is_named(folder: Path, at: Callable[[str], None]) -> None:
    """Its protocol, its date or its reason; and one whose predecessor was taken out."""
    at(LATE)
    amend(made(ASKED.replace("1.1", "1.2")), folder, None, "typo")
    whole = (folder / PROTOCOL).read_text()
    (folder / PROTOCOL).write_text(json.dumps(json.loads(whole), sort_keys=True, indent=1))  # as a formatter does
    assert protocol_of(made(ASKED.replace("1.1", "1.2")), folder).problems == []
    edits: list[Callable[[dict[str, Any]], object]] = [
        lambda record: record["entries"][0]["protocol"]["contrast"]["limit"].update(margin=1.2),
        lambda record: record["entries"][0].update(date="2025-01-01T12:00:00+00:00"),
        lambda record: record["entries"][1].update(reason="an oversight"),
        lambda record: record["entries"].pop(0),
    ]
    for edit in edits:
        (folder / PROTOCOL).write_text(whole)
        edited(folder, edit)
        found = protocol_of(made(ASKED.replace("1.1", "1.2")), folder)
        problems = found.problems
        assert (found.breaches[0].kind, found.status[:9]) == (EDITED, "Not known")
        assert [line for line in problems if "edited by hand" in line]
        with pytest.raises(ProtocolError, match="edited by hand"):
            amend(made(ASKED.replace("1.1", "1.4")), folder, None, "typo")


def test_a_new_hash_over_an_old_date_still_shows_that_runs_were_first(folder: Path) -> None:
    """A protocol of after the runs is named whatever its hash is, and its study was not frozen before its runs."""

    def edit(record: dict[str, Any]) -> None:
        entry = record["entries"][0]
        entry["date"] = LATE
        entry["hash"] = hash_of(entry, "made-up", "")

    edited(folder, edit)
    found = protocol_of(made(ASKED), folder, origin(BEGUN))
    assert ["after the runs began" in line for line in found.problems] == [True]
    assert found.status.startswith("Not frozen before its runs")


def test_an_amendment_keeps_the_entry_before_it(folder: Path, at: Callable[[str], None]) -> None:
    """With reason, key, old and new value, and whether it was made before or after the runs."""
    first = json.loads((folder / PROTOCOL).read_text())["entries"]
    at(LATE)
    study = made(ASKED.replace("margin = 1.1", "margin = 1.2"))
    amend(study, folder, None, "  the margin\nwas a typo ")
    assert json.loads((folder / PROTOCOL).read_text())["entries"][:1] == first
    found = protocol_of(study, folder, origin(BEGUN))
    assert found.problems == []
    [(title, changes)] = found.amendments
    assert title.startswith(LATE)
    assert title.endswith("after the runs began: the margin was a typo")
    assert [tuple(change) for change in changes] == [("contrast.limit.margin", "1.1", "1.2")]


def test_surprises_are_counted_against_what_was_expected_before_the_runs(
    folder: Path, at: Callable[[str], None]
) -> None:
    """An expectation that is amended afterwards changes none of them; a claim that came later has none."""
    later = ASKED.replace('"undecided"', '"refuted"') + CLAIM.replace('"c"', '"new"')
    at(LATE)
    amend(made(later), folder, None, "seen")
    evidence = Evidence.of_sweep(made(later), table(), series(lambda *_: 20.0))
    assert evidence.claims["verdict"].tolist() == ["refuted", "refuted"]
    found = {
        date: Record(protocol_of(made(later), folder, origin(date)), evidence).surprises
        for date in (BEGUN, "2026-01-04T12:00:00+00:00")
    }
    assert [rows[["claim", "expected", "is_surprise"]].to_numpy().tolist() for rows in found.values()] == [
        [["c", "undecided", True]],
        [["c", "refuted", False], ["new", "undecided", True]],
    ]
    nothing = Evidence.of_sweep(made(later), table(lambda *_: float("nan")), series(lambda *_: 20.0))
    assert Record(protocol_of(made(later), folder, origin(BEGUN)), nothing).surprises["is_surprise"].tolist() == [False]


def test_an_amendment_needs_a_protocol_a_change_and_a_reason(folder: Path, tmp_path: Path) -> None:
    """Nothing is written otherwise."""
    before = (folder / PROTOCOL).read_bytes()
    other = made(ASKED.replace("1.1", "1.2"))
    for study, where, reason, told in (
        (made(ASKED), folder, "r", "nothing differs"),
        (other, folder, " ", "a reason"),
        (other, tmp_path / "elsewhere", "r", "must be there"),
        (replace(other, name="other"), folder, "r", "'other'"),
    ):
        with pytest.raises(ProtocolError, match=told):
            amend(study, where, None, reason)
    assert (folder / PROTOCOL).read_bytes() == before


def test_what_was_run_or_frozen_cannot_be_frozen(folder: Path, tmp_path: Path) -> None:
    """Runs in its own folder, tables alone; exploratory; frozen already."""
    study = made(ASKED)

    def refused(study: Study, where: Path, told: str) -> None:
        before = sorted(tmp_path.rglob(PROTOCOL))
        with pytest.raises(ProtocolError, match=told):
            freeze(study, where, None)
        assert sorted(tmp_path.rglob(PROTOCOL)) == before

    refused(study, folder, "--amend REASON")
    for name in ("a/sweep/runs/x.in-process.json", "b/runs.csv"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
        refused(study, tmp_path / name.partition("/")[0], "before its first run")
    refused(made(ASKED.replace("[study]", '[study]\nkind = "exploratory"')), tmp_path / "c", "'confirmatory'")


def test_a_study_of_another_name_is_replaced_by_a_key(folder: Path) -> None:
    """It is kept whole, and the file cannot drop it afterwards."""
    asked = ASKED.replace("[study]", '[study]\nreplaces = { made-up = "It had too few replicates." }')
    study = replace(made(asked), name="anew")
    with pytest.raises(ProtocolError, match="must be there"):
        freeze(study, folder / "nowhere" / "anew", None)
    where = folder.parent / "anew"
    freeze(study, where, None)
    [record] = protocol_of(study, where).replaced
    assert record["entries"] == json.loads((folder / PROTOCOL).read_text())["entries"]
    assert (record["study"], record["reason"]) == ("made-up", "It had too few replicates.")
    dropped = protocol_of(replace(made(ASKED), name="anew"), where)
    assert [change.key for change in dropped.unamended] == ["study.replaces.made-up"]
    edited(folder, lambda record: record["entries"][0].update(reason="another"))
    with pytest.raises(ProtocolError, match="edited by hand"):
        freeze(study, folder.parent / "again", None)


def test_a_protocol_in_the_history_of_the_folder_is_replaced_too(folder: Path, at: Callable[[str], None]) -> None:
    """The one that was overwritten, as of a commit, before the one in the folder, which is set aside."""

    def git(*arguments: str) -> None:
        identity = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
        subprocess.run(["git", "-C", folder.parent, *identity, *arguments], check=True, capture_output=True)

    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "x")
    (folder / PROTOCOL).unlink()
    at(LATE)
    freeze(made(ASKED), folder, None)
    for name in ("page.md", "runs.csv", "runs.parquet", "mine.csv", "study.toml"):
        (folder / name).touch()
    with pytest.raises(ProtocolError, match="nothing"):
        freeze(made(ASKED), folder, None, "Again.", [("nothing", "Forgotten.")])
    freeze(made(ASKED), folder, None, "Again.", [("HEAD", "Forgotten.")])
    found = protocol_of(made(ASKED), folder)
    assert [record["entries"][0]["date"] for record in found.replaced] == [EARLY, LATE]
    assert [record["reason"].partition(" (as of")[0] for record in found.replaced] == ["Forgotten.", "Again."]
    assert {path.name for path in folder.glob("replaced/*/*")} == {PROTOCOL, "page.md", "runs.csv", "runs.parquet"}
    assert {path.name for path in folder.iterdir()} == {PROTOCOL, "replaced", "mine.csv", "study.toml"}
    assert found.problems == []


@in_one_test("text", ["", "[]", "{}", '{"study": "made-up", "entries": []}', '{"study": "made-up", "entries": [{}]}'])
def test_a_file_that_is_no_protocol_is_named(text: str, folder: Path) -> None:
    (folder / PROTOCOL).write_text(text)
    with pytest.raises(ProtocolError, match=PROTOCOL):
        protocol_of(made(ASKED), folder)


EDITS: list[Callable[[dict[str, Any]], object]] = [
    lambda entry: entry.pop("reason"),
    lambda entry: entry.update(date="yesterday"),
    lambda entry: entry.update(date="2026-01-01T12:00:00"),
    lambda entry: entry.pop("code"),
    lambda entry: entry["code"].pop("digest"),
    lambda entry: entry.update(replaces=[{"study": "own"}]),
    lambda entry: entry["protocol"].update(claim=[]),
    lambda entry: entry["protocol"].pop("scenario"),
    lambda entry: entry["protocol"]["condition"].update({"loss=0.0, hybrid 3": 3}),
]


@in_one_test("edit", EDITS)
def test_a_protocol_of_the_wrong_form_is_named(edit: Callable[[dict[str, Any]], object], folder: Path) -> None:
    """Whatever part of it was taken out or replaced."""
    whole = (folder / PROTOCOL).read_text()
    edited(folder, lambda record: edit(record["entries"][0]))
    with pytest.raises(ProtocolError, match="restore it"):
        protocol_of(made(ASKED), folder)
    (folder / PROTOCOL).write_text(whole)


def test_the_first_line_of_a_page_says_what_was_frozen(folder: Path, tmp_path: Path) -> None:
    """An exploratory study, one that was not frozen, one that was: the line after the title, in both forms."""
    for own, where, first in (
        (ASKED.replace("[study]", '[study]\nkind = "exploratory"'), tmp_path / "a", "Exploratory: "),
        (ASKED, tmp_path / "b", "Not frozen before its runs, which are a pilot"),
        (ASKED, folder, f"Frozen on {EARLY}, before its runs, which began on {BEGUN}; hash "),
    ):
        study = seeded(made(own), where)
        rows = table()
        rows["seed"] = [study.sweep.seeds[replicate] for replicate in rows["replicate"]]
        write(study, Evidence.of_sweep(study, rows, series(lambda *_: 20.0)), origin(BEGUN), where)
        assert (where / "page.md").read_text().splitlines()[2].startswith(first)
        assert f'</h1>\n<p class="lead">{first}' in (where / "page.html").read_text()
