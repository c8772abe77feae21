"""A study's folder says to machines what its files are."""

import json
from pathlib import Path

import pandas as pd

from deltaswarm_studies.crate import METADATA, write_crate
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.page import write
from tests.support.studying import FIGURES, OWN, made, series, table

ORIGIN = {
    "begun": "2026-11-27T14:32:04+00:00",
    "versions": "python 3.11.7, deltaswarm 0.1.0, numpy 2.4.6",
    "commit": "f72718de76ff",
}


def test_the_crate_has_every_file_with_its_size(tmp_path: Path) -> None:
    """And the day, the version and the commit of the runs; what it names is in it. It is made with the page."""
    study = made(OWN + FIGURES)
    told = pd.DataFrame({"what": ORIGIN.keys(), "value": ORIGIN.values()})
    evidence = Evidence.of_sweep(study, table(), series(lambda level, mode, replicate, time_s: 20.0 + replicate))
    assert tmp_path / METADATA in write(study, evidence, told, tmp_path)
    entities = {one["@id"]: one for one in json.loads((tmp_path / METADATA).read_text())["@graph"]}
    files = {name: int(one["contentSize"]) for name, one in entities.items() if one["@type"] == "File"}
    kinds = (".csv", ".md", ".json", ".png")
    there = {path.relative_to(tmp_path).as_posix(): path for path in tmp_path.rglob("*") if path.suffix in kinds}
    assert files == {name: path.stat().st_size for name, path in there.items() if name != METADATA}
    assert {"runs.csv", "page.md", "seal.json", "figures/time.png"} <= set(files)
    root, software = entities["./"], entities["#deltaswarm"]
    assert (root["datePublished"], root["name"]) == ("2026-11-27", study.title)
    assert (software["softwareVersion"], software["identifier"]) == ("0.1.0", "f72718de76ff")
    named = [part["@id"] for part in root["hasPart"]] + [one["@id"] for one in entities["#runs"]["result"]]
    assert set(named) <= set(entities)


def test_only_the_studies_of_deltaswarm_have_its_licence(tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    crate = json.loads(write_crate(made(OWN), tmp_path, {}).read_text())["@graph"]
    assert [one for one in crate if {"license", "author"} & set(one)] == []
