"""A study's folder as a research object (RO-Crate 1.1): what each file is, and which code made it, for machines."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import seal
from deltaswarm_studies.origin import BEGUN, COMMIT, VERSIONS
from deltaswarm_studies.settings import PROTOCOL
from deltaswarm_studies.study import Study
from deltaswarm_wire.files import write_whole

METADATA = "ro-crate-metadata.json"
PROFILE = "https://w3id.org/ro/crate/1.1"
LICENSE = "https://spdx.org/licenses/Apache-2.0"
AUTHOR = "#maintainers"
"""Licence and author of the studies that deltaswarm ships. The author of another study adds both."""

FORMATS = {".csv": "text/csv", ".json": "application/json", ".md": "text/markdown", ".png": "image/png"}
"""Files that are described, by their endings. The others are copies of these in other formats."""

CONTENTS = {
    "claims.csv": "a row per claim: criterion, estimate, interval and verdict",
    "contrasts.csv": "a row per comparison of two conditions by a metric",
    "courses.csv": "medians of metrics over time",
    "estimates.csv": "medians of every metric in every condition, with intervals",
    "events.csv": "a row per event of every run: its place and its times",
    "fits.csv": "distances from published numbers",
    "grids.csv": "the level of a factor that is best in each cell",
    "invalid.csv": "runs that do not count, with the reason",
    "keys.csv": "how each key of a sensitivity study changes each claim's effect, and where the claim holds",
    "page.md": "the study's page",
    "points.csv": "a row per point of a sensitivity study: its keys, and each claim's effect",
    "protocol.json": "what was frozen before the runs, and every amendment since",
    "provenance.csv": "code, versions and machine of the runs",
    "recovery.csv": "times to recover after a fault",
    "rings.csv": "times of events by their distance from the densest place",
    "runs.csv": "a row per run: condition, replicate, seed and every metric",
    "seal.json": "length and SHA-256 of every table",
    "shares.csv": "the share of a sensitivity study's points at which each claim holds",
    "survival.csv": "times of events by Kaplan and Meier",
}


def write_crate(study: Study, folder: Path, origin: Mapping[str, str]) -> Path:
    """Describe the files of a study's folder; `origin` says where its runs come from."""
    files = {
        file.relative_to(folder).as_posix(): file.stat().st_size
        for file in sorted([*folder.iterdir(), *(folder / "figures").iterdir()])
        if file.suffix in FORMATS and file.name != METADATA
    }
    graph = {"@context": f"{PROFILE}/context", "@graph": [*entities(study, origin, files)]}
    write_whole(folder / METADATA, json.dumps(graph, indent=2).encode() + b"\n")
    return folder / METADATA


def entities(study: Study, origin: Mapping[str, str], files: Mapping[str, int]) -> Iterator[dict[str, Any]]:
    """Yield the entities of the crate: itself, its files with their sizes [bytes], the runs, and the software."""
    about = {"name": study.title, "description": " ".join(study.file.study.question.split()) or study.title}
    yield {"@id": METADATA, "@type": "CreativeWork", "conformsTo": {"@id": PROFILE}, "about": {"@id": "./"}}
    ours = {"license": {"@id": LICENSE}, "author": {"@id": AUTHOR}, "publisher": {"@id": AUTHOR}}
    ours = ours if study.is_built_in else {}
    parts = {"hasPart": [{"@id": name} for name in files], "mentions": {"@id": "#runs"}}
    yield {"@id": "./", "@type": "Dataset", **about, "datePublished": origin.get(BEGUN, "")[:10], **ours, **parts}
    if ours:
        yield {"@id": LICENSE, "@type": "CreativeWork", "name": "Apache License 2.0", "description": "the licence"}
        yield {"@id": AUTHOR, "@type": "Organization", "name": "The deltaswarm maintainers"}
    for name, size in files.items():
        told = {"name": CONTENTS.get(name, f"the figure {Path(name).stem}")}
        yield {
            "@id": name,
            "@type": "File",
            **told,
            "encodingFormat": FORMATS[Path(name).suffix],
            "contentSize": str(size),
        }
    inputs = {"object": {"@id": PROTOCOL}} if PROTOCOL in files else {}
    yield {
        "@id": "#runs",
        "@type": "CreateAction",
        "name": "the runs of the study",
        "description": "; ".join(f"{what}: {value}" for what, value in origin.items()),
        "startTime": origin.get(BEGUN, ""),
        "instrument": {"@id": "#deltaswarm"},
        **inputs,
        "result": [{"@id": name} for name in (seal.RECORD, "runs.csv") if name in files],
    }
    versions = dict(one.rsplit(" ", 1) for one in origin.get(VERSIONS, "").split(", ") if " " in one)
    yield {
        "@id": "#deltaswarm",
        "@type": "SoftwareApplication",
        "name": "deltaswarm",
        "softwareVersion": versions.get("deltaswarm", ""),
        "identifier": origin.get(COMMIT, ""),
    }
