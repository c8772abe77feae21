"""Where a study's runs come from, and whether its file or the code have changed since then."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_studies.study import Study

PROVENANCE = {"what": "What", "value": "Value"}
"""Columns of the table of where runs come from, with their headings."""

BEGUN = "begun"
VERSIONS, COMMIT = "versions", "commit"
DONE, WALL = "runs", "wall time of all sessions"
CODE, RUNS, QUESTIONS = "digest of the code", "digest of what the study runs", "digest of what the study asks"

CHANGED, PLUGINS, ENGINES = "code changed since the protocol", "plug-ins", "engines"

WITH_THE_RUNS = "with the runs"
"""When tables were sealed that `deltaswarm study` or `deltaswarm report` wrote after the runs."""


def facts_of(table: pd.DataFrame) -> dict[str, str]:
    """Return a table of where runs come from as a mapping."""
    return dict(zip(table["what"], table["value"].astype(str), strict=True))


def sealed_tables(folder: Path, study: Study | None = None) -> dict[str, Any]:
    """Check the tables of a study, and return their sealed record; {} if they are not sealed."""
    record = seal.checked(folder / seal.RECORD)
    if record and study and record.get("study") != study.name:
        raise seal.SealError(f"{folder} must hold the study {study.name!r} (got {record.get('study')!r})")
    return record


def seal_tables(study: Study, provenance: pd.DataFrame, folder: Path, files: Sequence[Path], sealed: str) -> None:
    """Seal the tables of a study's runs; `sealed` says since when they are."""
    record = {"study": study.name, "sealed": sealed, "origin": facts_of(provenance)}
    seal.write_sealed(folder / seal.RECORD, record, seal.digests(folder, [file.name for file in files]))


def since_the_runs(study: Study, recorded: pd.DataFrame, sealed: str) -> pd.DataFrame:
    """Make rows that say which code makes the page, and what may have changed since the runs: study file and tables."""
    then, code = facts_of(recorded), provenance.code_digest()
    changed = [
        words
        for what, words, now in zip((RUNS, QUESTIONS), ("what it runs", "what it asks"), study.digests, strict=True)
        if what in then and then[what] != now
    ]
    state = f"changed since the runs: {' and '.join(changed)}" if changed else "unchanged since the runs"
    rows = {
        "page by code": f"{code}, {'that of the runs' if then.get(CODE) == code else 'not that of the runs'}",
        "study file": state if RUNS in then else "not known whether it has changed since the runs",
        "tables": f"sealed {sealed}" if sealed else "not sealed: not known whether they have changed since the runs",
    }
    return pd.DataFrame(list(rows.items()), columns=[*PROVENANCE])


def plugin_digests(study: Study) -> dict[str, str]:
    """Return the digests of the plug-ins that a study's scenarios name, by kind and name."""
    scenarios = [variant.scenario for variant in study.sweep.variants]
    found = [source for scenario in scenarios for source in provenance.sources(scenario)]
    return {f"{source.what} {source.name}": source.digest for source in found}


def plugins_of(digests: Mapping[str, str]) -> str:
    """Return plug-ins with the digests of their code in a line."""
    return ", ".join(f"{name} {digest}" for name, digest in sorted(digests.items()))


def provenance_of(study: Study, manifest: dict[str, Any], changed: Sequence[str] = ()) -> pd.DataFrame:
    """Make a table of where a study's runs come from, from its sweep's manifest.

    `changed` are the source files that differ from those of the protocol.

    Raises:
        ValueError: the manifest is not as `deltaswarm sweep` writes it.
    """
    try:
        proofs, engines = manifest["proofs"], manifest.get("engines")
        rows = {
            DONE: f"{manifest['finished']} of {manifest['runs']}, by {manifest['means']}",
            BEGUN: manifest["started"],
            WALL: f"{manifest['wall_s'] / 60:.1f} min",
            "machine": f"{manifest['host']['cores']} cores, {manifest['host']['system']}",
            VERSIONS: ", ".join(f"{name} {number}" for name, number in manifest["versions"].items() if number),
            COMMIT: manifest.get("commit") or "not known",
            CODE: ", ".join(manifest["code"]),
            **({CHANGED: ", ".join(changed)} if changed else {}),
            **({PLUGINS: plugins_of(plugins)} if (plugins := plugin_digests(study)) else {}),
            **({ENGINES: ", ".join(f"{count} by {name}" for name, count in engines.items())} if engines else {}),
            **dict(zip((RUNS, QUESTIONS), study.digests, strict=True)),
            "digest of the sweep": manifest["digest"] or "not all runs are there",
            "repeated with real processes": f"{proofs['checked']} runs, {proofs['equal']} with the same digest",
        }
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"manifest.json is not as `deltaswarm sweep` writes it: {error!r}") from None
    return pd.DataFrame(list(rows.items()), columns=[*PROVENANCE])


def run_s(provenance: pd.DataFrame) -> float | None:
    """Return the wall time of a study's runs, divided by their number [s]; None if it is not known."""
    told = facts_of(provenance)
    try:
        return 60 * float(told[WALL].partition(" ")[0]) / int(told[DONE].partition(" ")[0])
    except (KeyError, ValueError, ZeroDivisionError):
        return None
