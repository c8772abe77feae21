"""Where a study's runs come from, and whether its file or the code have changed since."""

from typing import Any

import pandas as pd

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.studies.study import Study

PROVENANCE = {"what": "What", "value": "Value"}
"""Columns of the table of where runs come from, with their headings."""

CODE, RUNS, QUESTIONS = "digest of the code", "digest of what the study runs", "digest of what the study asks"


def since_the_runs(study: Study, recorded: pd.DataFrame) -> pd.DataFrame:
    """Make rows that say which code makes the page, and whether the study file has changed since the runs."""
    then = dict(zip(recorded["what"], recorded["value"].astype(str), strict=True))
    code = provenance.code_digest()
    is_same = then.get(CODE) == code
    changed = [
        words
        for what, words, now in zip((RUNS, QUESTIONS), ("what it runs", "what it asks"), study.digests, strict=True)
        if what in then and then[what] != now
    ]
    state = f"changed since the runs: {' and '.join(changed)}" if changed else "unchanged since the runs"
    rows = {
        "page by code": f"{code}, {'that of the runs' if is_same else 'not that of the runs'}",
        "study file": state if RUNS in then else "not known whether it has changed since the runs",
    }
    return pd.DataFrame(list(rows.items()), columns=[*PROVENANCE])


def provenance_of(study: Study, manifest: dict[str, Any]) -> pd.DataFrame:
    """Make a table of where a study's runs come from, from its sweep's manifest.

    Raises:
        ValueError: the manifest is not as `deltaswarm sweep` writes it.
    """
    try:
        proofs = manifest["proofs"]
        rows = {
            "runs": f"{manifest['finished']} of {manifest['runs']}, by {manifest['means']}",
            "begun": manifest["started"],
            "wall time of all sessions": f"{manifest['wall_s'] / 60:.1f} min",
            "machine": f"{manifest['host']['cores']} cores, {manifest['host']['system']}",
            "versions": ", ".join(f"{name} {number}" for name, number in manifest["versions"].items() if number),
            "commit": manifest.get("commit") or "not known",
            CODE: ", ".join(manifest["code"]),
            **dict(zip((RUNS, QUESTIONS), study.digests, strict=True)),
            "digest of the sweep": manifest["digest"] or "not all runs are there",
            "repeated with real processes": f"{proofs['checked']} runs, {proofs['equal']} with the same digest",
        }
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"manifest.json is not as `deltaswarm sweep` writes it: {error!r}") from None
    return pd.DataFrame(list(rows.items()), columns=[*PROVENANCE])
