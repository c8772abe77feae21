"""Freeze a study's protocol before its first run, amend it with a reason, or replace it by another."""

import io
import json
import shutil
import subprocess
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from deltaswarm_orchestrator.base import frozen, provenance, seal
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.frozen import HASH, Table
from deltaswarm_orchestrator.sweeps.table import read_table
from deltaswarm_studies.crate import METADATA
from deltaswarm_studies.fixed import FORMAT
from deltaswarm_studies.origin import PROVENANCE, facts_of, sealed_tables
from deltaswarm_studies.protocol import (
    EDITED,
    Protocol,
    ProtocolError,
    code_of,
    format_of,
    protocol_of,
    read,
    some,
)
from deltaswarm_studies.settings import EXPLORATORY, PROTOCOL
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import TABLES

FOUND = ("estimate", "low", "high", "verdict")
KEPT = {
    "claims": ("claim", "text", "metric", "about", "criterion", *FOUND),
    "contrasts": ("contrast", "metric", "level", "reference", "within", *FOUND),
}
"""Tables, with their columns, that are kept of a protocol that is replaced."""

WRITTEN = ("page.html", "page.md", "figures", "sweep", PROTOCOL, seal.RECORD, METADATA)
"""What a study's command writes into its folder besides tables."""

ASIDE = "replaced"
"""The folder, in the study's, that gets page, tables and runs of a protocol that is replaced."""


def freeze(
    study: Study, folder: Path, file: Path | None, replaces: str = "", earlier: Iterable[tuple[str, str]] = ()
) -> Path:
    """Write `protocol.json` before the study's first run.

    Args:
        study: the study.
        folder: that of its page.
        file: the study's; None if it is built in.
        replaces: why the protocol in the folder is replaced; it is kept with the verdicts on its page.
        earlier: commits at which the folder had other protocols, which are replaced too, each with a reason.

    Raises:
        ProtocolError: it is exploratory, its code is not committed, it is frozen already and `replaces` gives no
            reason, or some of its runs are there.
    """
    known = protocol_of(study, folder)
    if known.kind == EXPLORATORY:
        raise ProtocolError(f"{study.name}: study.kind must be 'confirmatory' to be frozen (got {EXPLORATORY!r})")
    if known.entries and not replaces.strip():
        amend, replace = (
            command_line("study", file or study.name, "--out", folder, *option)
            for option in (("--amend", "REASON"), ("--freeze", "--replaces", "REASON"))
        )
        frozen_on = known.entries[0]["date"]
        raise ProtocolError(
            f"{folder / PROTOCOL} must not be there yet: it was frozen on {frozen_on}; to change it: {amend}; to ask "
            f"anew, with other seeds: {replace}"
        )
    if replaces and not known.entries:
        raise ProtocolError(f"--replaces must be given with a protocol that is replaced (got no {folder / PROTOCOL})")
    runs = _runs(folder)
    if runs and not known.entries:
        raise ProtocolError(f"{study.name} must be frozen before its first run ({len(runs)} are there, as {runs[0]})")
    refuse_uncommitted(study, file)
    records = [_at_commit(study.name, folder, *one) for one in earlier]
    records += [_record(name, folder.parent / name, why) for name, why in study.file.study.replaces.items()]
    if known.entries:
        records.append(_record(study.name, folder, replaces))
        _set_aside(folder, str(known.entries[0][HASH])[:8])
    return _add(Protocol(study), folder, file, "", records)


def amend(study: Study, folder: Path, file: Path | None, reason: str) -> Path:
    """Add an entry with what changed and its reason to `protocol.json`; all earlier entries stay.

    Raises:
        ProtocolError: it is not frozen, was edited by hand, nothing changed, its code is not committed, or no reason is
            given.
    """
    known = protocol_of(study, folder)
    if not reason.strip():
        raise ProtocolError("--amend must be a reason (got an empty one)")
    if not known.entries:
        raise ProtocolError(f"{folder / PROTOCOL} must be there before it is amended; to freeze it: --freeze")
    for breach in known.breaches:
        if breach.kind == EDITED:
            raise ProtocolError(f"{folder}: {breach.line} Restore it first.")
    if not known.unamended and not known.changed_files():
        raise ProtocolError(f"{study.name}: nothing differs from the protocol of {known.entries[-1]['date']}")
    refuse_uncommitted(study, file)
    return _add(known, folder, file, reason)


def refuse_uncommitted(study: Study, file: Path | None) -> None:
    """Refuse if git lacks a file of deltaswarm, of plug-ins or the study's as it is; what is in no repository may be.

    Raises:
        ProtocolError: it does.
    """
    changed = provenance.uncommitted() or []
    plugins = {path for variant in study.sweep.variants for path in provenance.plugin_files(variant.scenario)}
    for path in [*([file] if file else []), *sorted(plugins)]:
        commit, is_committed = provenance.commit_of(path)
        changed += [str(path)] if commit and not is_committed else []
    if changed:
        must = "code and study file must be committed, so that all can see them"
        raise ProtocolError(f"{study.name}: {must} (got uncommitted {some(changed)})")


def _runs(folder: Path) -> list[Path]:
    """List the runs in a study's folder. Those elsewhere have other seeds."""
    return [*folder.glob("sweep/runs/*.json"), *folder.glob("runs.csv")]


def _record(name: str, folder: Path, reason: str) -> Table:
    """Return what is kept of a protocol that is replaced: all its entries, and the verdicts on its page."""
    if not (folder / PROTOCOL).exists():
        raise ProtocolError(f"{folder / PROTOCOL} must be there: it is replaced ({reason})")
    record = read(folder / PROTOCOL)
    if [entry[HASH] for entry in record["entries"]] != frozen.hashes_of(record["entries"], record["study"]):
        raise ProtocolError(f"{folder / PROTOCOL} was edited by hand; restore it before it is replaced")
    sealed_tables(folder)
    origin = folder / "provenance.csv"
    return {
        "study": name,
        "reason": " ".join(reason.split()),
        "entries": record["entries"],
        "origin": facts_of(read_table(origin, needs=[*PROVENANCE])) if origin.exists() else {},
        **{table: _kept(folder / f"{table}.csv", columns) for table, columns in KEPT.items()},
    }


def _kept(file: Path, columns: Sequence[str]) -> list[Table]:
    if not file.exists():
        return []
    rows = read_table(file, columns).reindex(columns=[*columns])
    found: list[Table] = json.loads(rows.to_json(orient="records", double_precision=15))
    return found


def _at_commit(name: str, folder: Path, revision: str, reason: str) -> Table:
    """Return the same of a protocol that the folder had at a commit of its repository."""
    try:
        commit, packed = provenance.at_commit(folder, revision)
    except (OSError, subprocess.SubprocessError):
        raise ProtocolError(f"--replaces-at must be a commit that has {folder} (got {revision!r})") from None
    with TemporaryDirectory() as temporary:
        zipfile.ZipFile(io.BytesIO(packed)).extractall(temporary)
        return _record(name, Path(temporary), f"{reason} (as of commit {commit})")


def _set_aside(folder: Path, name: str) -> None:
    """Move what `deltaswarm study` wrote into a folder of its own; what else is there stays."""
    aside = folder / ASIDE / name
    if aside.exists():
        raise ProtocolError(f"{aside} must not be there yet, since it gets what is replaced; move it away")
    aside.mkdir(parents=True)
    for path in list(folder.iterdir()):
        is_table = path.stem in TABLES and path.suffix in (".csv", ".parquet")
        if is_table or path.name in WRITTEN:
            shutil.move(path, aside)


def _add(known: Protocol, folder: Path, file: Path | None, reason: str, replaces: Iterable[Table] = ()) -> Path:
    entry: Table = {
        "date": provenance.now(),
        "commit": dict(_commits(file)),
        "uncommitted": [f"{name} is in no repository" for name, commit in _commits(file) if commit is None],
        "reason": " ".join(reason.split()),
        "protocol": known.now,
    }
    if not known.entries or format_of(known.entries[0]) >= FORMAT:
        code = code_of(known.study)
        entry |= {"format": FORMAT, "code": code, "runs": len(_runs(folder)), "replaces": list(replaces)}
    before = known.entries[-1][HASH] if known.entries else ""
    entry[HASH] = frozen.hash_of(entry, known.study.name, before)
    return frozen.write(folder / PROTOCOL, {"study": known.study.name, "entries": [*known.entries, entry]})


def _commits(file: Path | None) -> Iterator[tuple[str, str | None]]:
    yield "deltaswarm", provenance.commit()
    if file is not None:
        yield file.name, provenance.commit_of(file)[0]
