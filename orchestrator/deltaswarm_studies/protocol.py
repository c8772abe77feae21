"""A study's protocol: what it runs, asks and expects, frozen before its runs, and every amendment since.

`protocol.json` in the study's folder has an entry for the frozen protocol and one for each amendment. The seeds of the
runs are derived from the hash of the newest entry from before them, so nobody can have done them earlier.
"""

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from deltaswarm_orchestrator.base import frozen, provenance
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.frozen import HASH, Difference, Entry, Table, changed_keys, time_of
from deltaswarm_orchestrator.sweeps.load import make_sweep
from deltaswarm_orchestrator.sweeps.plan import replicate_seed
from deltaswarm_studies.fixed import FORMAT, content, differences
from deltaswarm_studies.origin import BEGUN, CHANGED, CODE, PLUGINS, facts_of, plugin_digests, plugins_of
from deltaswarm_studies.settings import EXPLORATORY, PROTOCOL
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked

ENTRY = {"date": str, "commit": dict, "uncommitted": list, "reason": str, "protocol": dict, HASH: str}
SINCE_2 = {"format": int, "code": dict, "runs": int, "replaces": list}
"""Entries of format 2: the code's digests, the number of runs that were there, and the protocols that are replaced."""
OF_CODE = {"digest": str, "files": dict, "plug-ins": dict}
REPLACED = {"study": str, "reason": str, "entries": list, "origin": dict, "claims": list, "contrasts": list}
"""A protocol that is replaced: whole, with where its runs came from and the verdicts on its page."""

MAX_NAMED = 3
"""Maximum number of differences or files named in a line; the page has all differences."""

UNKNOWN = "which files is not known"

SEEDED_BY = "deltaswarm: the seed of a study's runs, from the hash of its protocol "

OWN_SEEDS = "Its seeds are those of its file, so its runs could have been done before."
"""What the first line says of a protocol of format 1."""

EDITED, LATE, SEEDS, CODE_CHANGED, PLUGINS_CHANGED, FILE_CHANGED, UNSEALED = (
    *("edited", "late", "seeds", "code", "plug-ins", "file", "unsealed"),
)
"""Kinds of breaches. After the first three it is not known what was frozen before the runs."""


class ProtocolError(CommandError):
    """A protocol cannot be frozen, amended or read."""


class Breach(NamedTuple):
    """Something that contradicts a protocol."""

    kind: str
    brief: str
    """For the first line of the page."""
    line: str


@dataclass(frozen=True)
class Protocol:
    """What a study fixed before its runs, what changed since, what it asks now, and what is known of its runs."""

    study: Study
    entries: Sequence[Entry] = ()
    """The frozen protocol, and each amendment: `ENTRY`."""
    origin: Mapping[str, str] = field(default_factory=dict)
    """Where the runs come from; empty if there are none, or it is not known."""
    runs: pd.DataFrame | None = None
    """A row per run; None if there are none."""
    is_sealed: bool = True
    """Whether the tables of the runs are sealed, if there are any."""

    @property
    def begun(self) -> str:
        """When the runs began; empty if there are none, or it is not known."""
        return self.origin.get(BEGUN, "")

    @property
    def kind(self) -> str:
        return self.study.file.study.kind

    @cached_property
    def now(self) -> Table:
        return content(self.study, format_of(self.entries[0]) if self.entries else FORMAT)

    @cached_property
    def timely(self) -> list[Entry]:
        """The entries from before the runs."""
        return timely(self.entries, self.begun)

    @property
    def is_before_the_runs(self) -> bool:
        return bool(self.entries) and not _is_late(self.entries[0], self.begun)

    @property
    def status(self) -> str:
        if self.kind == EXPLORATORY:
            return "Exploratory: nothing was frozen before its runs, so its results suggest and do not confirm."
        late = "what it asks and expects could still be changed after the first results were seen."
        if not self.entries:
            return f"Not frozen before its runs, which are a pilot with the seeds of its file: {late}"
        if self.breaches and self.breaches[0].kind in (EDITED, LATE, SEEDS):
            return f"{self.breaches[0].brief}: {late}"
        first, changed = self.entries[0], " and ".join(breach.brief for breach in self.breaches)
        runs = f"before its runs, which began on {self.begun}" if self.begun else "when its runs began is not known"
        told = f"Frozen on {first['date']}, {f'then {changed}' if changed else runs}; hash {first[HASH]}."
        return told if format_of(first) >= FORMAT else f"{told} {OWN_SEEDS}"

    @cached_property
    def unamended(self) -> list[Difference]:
        """What differs between the newest entry and the study file."""
        return differences(self.entries[-1]["protocol"], self.now) if self.entries else []

    @property
    def problems(self) -> list[str]:
        """What contradicts the protocol, a line each."""
        return [breach.line for breach in self.breaches]

    @cached_property
    def breaches(self) -> list[Breach]:
        """What contradicts the protocol, the gravest first."""
        return [*self._forged(), *self._changed()] if self.entries else []

    def _forged(self) -> Iterator[Breach]:
        """Yield what leaves unknown whether anything was frozen before the runs."""
        for place, (entry, right) in enumerate(
            zip(self.entries, frozen.hashes_of(self.entries, self.study.name), strict=True)
        ):
            if entry[HASH] != right:
                what = "amendment" if place else "the protocol"
                line = f"{what} of {entry['date']} has the hash {entry[HASH]}, its content has {right}."
                brief = f"Not known what was frozen, or when, since {PROTOCOL} was edited by hand"
                yield Breach(EDITED, brief, f"{PROTOCOL} was edited by hand: {line}")
        frozen_on = self.entries[0]["date"]
        if not self.is_before_the_runs:
            yield Breach(
                LATE,
                f"Not frozen before its runs, which began on {self.begun}, but on {frozen_on}",
                f"The protocol was frozen on {frozen_on}, after the runs began ({self.begun}).",
            )
        if self.runs is not None and (other := self._with_other_seeds(self.runs)):
            some = f"{other} of {len(self.runs)} runs have seeds other than the protocol's"
            yield Breach(
                SEEDS, f"Not the runs of this protocol, since {some}", f"{some}, so they may be older than it."
            )

    def _with_other_seeds(self, runs: pd.DataFrame) -> int:
        """Count the runs whose seeds are not those of the protocol."""
        seed = seed_of(self.entries)
        if seed is None and (seed := (self.timely or self.entries)[-1]["protocol"]["runs"].get("seed")) is None:
            return len(runs)
        right = {number: replicate_seed(seed, number) for number in runs["replicate"].unique().tolist()}
        return int((runs["seed"] != runs["replicate"].map(right)).sum())

    def _changed(self) -> Iterator[Breach]:
        """Yield what has changed between the protocol and the runs, or since."""
        if (code := (self.timely or self.entries)[-1].get("code")) and self.origin:
            yield from self._by_other_code(code)
        if found := self.unamended:
            last = f"its protocol of {self.entries[-1]['date']}, without an amendment"
            line = f"The study file differs from {last}: {some([*map(str, found)], '; ')}."
            keys = some([change.key for change in found])
            yield Breach(FILE_CHANGED, f"its file changed without an amendment ({keys})", line)
        if self.runs is not None and not self.is_sealed:
            line = "The tables are not sealed, so nobody can tell whether they were changed after the runs."
            yield Breach(UNSEALED, "its tables lost their seal", line)

    def _by_other_code(self, code: Table) -> Iterator[Breach]:
        files = [file for file in self.origin.get(CHANGED, "").split(", ") if file]
        which = f"{len(files)} {'file' if len(files) == 1 else 'files'}: {some(files)}" if files else UNKNOWN
        for kind, what, was, now in (
            (CODE_CHANGED, f"the code changed ({which})", code["digest"], self.origin.get(CODE, "")),
            (PLUGINS_CHANGED, "plug-ins changed", plugins_of(code["plug-ins"]), self.origin.get(PLUGINS, "")),
        ):
            if was != now:
                line = f"the runs are by {now or 'none'} instead of {was or 'none'}, without an amendment"
                yield Breach(kind, what, f"Frozen, then {what}: {line}.")

    def changed_files(self) -> list[str]:
        """List the source files of deltaswarm, and the plug-ins, that have changed since the protocol."""
        code = (self.timely or self.entries or [{}])[-1].get("code")
        names = ("files", "plug-ins")
        return [key for name in names for key in changed_keys(code[name], code_of(self.study)[name])] if code else []

    @property
    def amendments(self) -> list[tuple[str, list[Difference]]]:
        """Every amendment: its date, commit and reason in a line, and the keys that changed."""
        amendments = []
        for before, entry in itertools.pairwise(self.entries):
            when = "after the runs began" if _is_late(entry, self.begun) else "before the runs"
            line = f"{entry['date']} ({_commit(entry)}), {when if self.begun else 'runs not known'}: {entry['reason']}"
            was, now = ({"code": {**one["code"], "digest": None}} if "code" in one else {} for one in (before, entry))
            changes = [*differences(before["protocol"], entry["protocol"]), *frozen.differences(was, now)]
            amendments.append((line, changes))
        return amendments

    @cached_property
    def replaced(self) -> list[Table]:
        """The frozen protocols that this one replaces, the oldest first: `REPLACED`."""
        return list(_replaced(self.entries))

    @property
    def facts(self) -> Table:
        """What is known of the protocol: date, hash, commits."""
        if not self.entries:
            return {"kind": self.kind, "frozen": "no"}
        entry = self.entries[0]
        rows = {"kind": self.kind, "frozen": entry["date"], "hash": entry[HASH], "commit": _commit(entry)}
        rows |= {"not in the commit": "; ".join(map(str, entry["uncommitted"]))} if entry["uncommitted"] else {}
        rows |= {"digest of the code": entry["code"]["digest"]} if "code" in entry else {}
        return rows | {"amendments": len(self.entries) - 1}


def timely(entries: Sequence[Entry], begun: str) -> list[Entry]:
    """Return the entries from before the runs, which began at that time."""
    return [entry for entry in entries if not _is_late(entry, begun)]


def _is_late(entry: Entry, begun: str) -> bool:
    return bool(entry.get("runs")) or (bool(begun) and time_of(entry["date"]) > time_of(begun))


def code_of(study: Study) -> Table:
    """Return the digests of all code that decides a study's runs and results: deltaswarm's, by file, and plug-ins'."""
    digests = {"digest": provenance.code_digest(), "files": provenance.code_files()}
    return {**digests, "plug-ins": plugin_digests(study)}


def some(words: Sequence[str], separator: str = ", ") -> str:
    """List the first of some words, and the number of the others."""
    more = [f"and {len(words) - MAX_NAMED} more"] if len(words) > MAX_NAMED else []
    return separator.join([*words[:MAX_NAMED], *more])


def _commit(entry: Entry) -> str:
    return ", ".join(f"{value} ({name})" for name, value in entry["commit"].items() if value) or "not known"


def _replaced(entries: Sequence[Entry]) -> Iterator[Table]:
    for entry in entries:
        for record in entry.get("replaces", []):
            yield from _replaced(record["entries"])
            yield record


def format_of(entry: Entry) -> int:
    return int(entry.get("format", 1))


def seed_of(entries: Sequence[Entry]) -> int | None:
    """Return the seed that the newest entry from before the first run gives; None: that of the study's file.

    An amendment that was made when runs were there keeps their seed, so that they can be continued.
    """
    hashes = [entry[HASH] for entry in entries if format_of(entry) >= FORMAT and not entry["runs"]]
    return int(hashlib.sha256(f"{SEEDED_BY}{hashes[-1]}".encode()).hexdigest()[:16], 16) >> 1 if hashes else None


def seeded(study: Study, folder: Path) -> Study:
    """Return a study with the seeds that the protocol in its page's folder gives, if there is one.

    Those of a sensitivity study's points, too: other runs at the same points would tell nearly as much.
    """
    seed = seed_of(_entries(study, folder))
    if seed is None:
        return study
    file = replace(study.sweep.file, sweep=replace(study.sweep.file.sweep, seed=seed))
    if not file.sensitivity:
        return replace(study, sweep=replace(study.sweep, file=file))
    file = replace(file, sensitivity=replace(file.sensitivity, seed=seed))
    return replace(study, sweep=make_sweep(checked.plain(file)))


def protocol_of(
    study: Study,
    folder: Path,
    recorded: pd.DataFrame | None = None,
    runs: pd.DataFrame | None = None,
    *,
    is_sealed: bool = True,
) -> Protocol:
    """Return what is known of a study's protocol, from the folder of its page, and of its runs.

    `recorded` says where the runs come from.
    """
    origin = {} if recorded is None else facts_of(recorded)
    return Protocol(study, _entries(study, folder), origin, runs, is_sealed)


def _entries(study: Study, folder: Path) -> Sequence[Entry]:
    file = folder / PROTOCOL
    record = read(file) if file.exists() else {}
    if record and record.get("study") != study.name:
        raise ProtocolError(f"{file} must be the protocol of the study {study.name!r} (got {record.get('study')!r})")
    return list(record.get("entries", []))


def read(file: Path) -> Mapping[str, Any]:
    """Read a protocol: its study and its entries. Raises ProtocolError."""
    try:
        record: Table = json.loads(file.read_text(encoding="utf-8"))
        _check(record["entries"])
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ProtocolError(
            f"{file} must be as `deltaswarm study --freeze` writes it ({error!r}); restore it"
        ) from None
    return record


def _check(entries: Sequence[Entry]) -> None:
    """Raise LookupError, TypeError, AttributeError or ValueError if entries are not of the form that is written."""
    if not entries:
        raise ValueError("no entries")
    for entry in entries:
        frozen.check_entry(entry, ENTRY)
        if format_of(entry) >= FORMAT:
            frozen.check_kinds(entry, SINCE_2)
            frozen.check_kinds(entry["code"], OF_CODE)
        differences(entry["protocol"], entry["protocol"])  # raises where a part is missing or of another form
        for record in entry.get("replaces", []):
            frozen.check_kinds(record, REPLACED)
            for claim in record["claims"]:
                frozen.check_kinds(claim, {"claim": str, "verdict": str})
            _check(record["entries"])
