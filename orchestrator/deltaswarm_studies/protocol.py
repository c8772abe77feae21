"""A study's protocol: what it runs, asks and expects, frozen before its runs, and every amendment since.

`protocol.json` in the study's folder has an entry for the frozen protocol and one for each amendment.
"""

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import pandas as pd

from deltaswarm_orchestrator.base import frozen, provenance
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.frozen import ABSENT, HASH, Difference, Entry, Table, as_read, time_of
from deltaswarm_orchestrator.scenarios.load import check_table
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.operator_settings import BUDGET
from deltaswarm_scenario.scenario import content_of
from deltaswarm_studies.claim_settings import expected_of
from deltaswarm_studies.settings import EXPLORATORY, StudyFile
from deltaswarm_studies.stats import ALPHA
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked

FILE = "protocol.json"

SHOWN_ONLY = ("figure", "finding")
"""Tables of a study file that no protocol holds: findings are written after the runs, and figures decide nothing."""

WORDS_ONLY = ("title", "why", "words")
"""Keys that no protocol holds."""

RUN_ONLY = ("schema", "record")
"""Keys of a scenario that do not change what happens in a run."""

UNUSED_UNLESS = {"operator.budget.": ("operator.autonomy.sets_delta", BUDGET)}
"""Keys of a scenario that do nothing unless another has this value: another default of theirs changes no run."""

ENTRY = {"date": str, "commit": dict, "uncommitted": list, "reason": str, "protocol": dict, HASH: str}

MAX_NAMED = 3
"""Maximum number of differences named in a line; the page has all."""


class ProtocolError(CommandError):
    """A protocol cannot be frozen, amended or read."""


def content(study: Study) -> Table:
    """Return all of a study that its protocol fixes: runs, outcomes, criteria, margins, expectations."""
    swept, drawn = study.sweep.file.sweep, study.sweep.file.sensitivity
    ignored = {*RUN_ONLY, *(one.name for one in study.ranges)}
    tables = {
        variant.label: {name: value for name, value in flattened(content_of(variant.scenario)) if name not in ignored}
        for variant in study.sweep.variants
    }
    first = next(iter(tables.values()))
    shared = {
        name: value
        for name, value in first.items()
        if all(name in table and table[name] == value for table in tables.values())
    }
    own = {
        label: {name: value for name, value in table.items() if name not in shared} for label, table in tables.items()
    }
    runs = {"seed": swept.seed, "repeats": swept.repeats, "seeds": study.sweep.seeds}
    runs |= {"series_every_s": swept.series_every_s, **({"repeats_of": swept.repeats_of} if swept.repeats_of else {})}
    runs["extensions"] = {
        f"{source.what} {source.name}": source.digest
        for variant in study.sweep.variants
        for source in provenance.sources(variant.scenario)
    }
    asked = {
        name: _rows(value) if isinstance(value, tuple) else _fixed(value)
        for name, value in vars(study.file).items()
        if name not in SHOWN_ONLY
    }
    sensitivity = {"sensitivity": _fixed(drawn) | {"range": _rows(drawn.range)}} if drawn else {}
    return as_read(
        {"scenario": shared, "condition": own, "runs": runs, **sensitivity, "tests": {"alpha": ALPHA}} | asked
    )


def _fixed(settings: Any) -> Table:
    return {name: value for name, value in checked.plain(settings).items() if name not in WORDS_ONLY}


def _rows(tables: Sequence[Any]) -> dict[str, Table]:
    """Return tables by their names, or by their places where they have none."""
    rows: dict[str, Table] = {}
    for place, settings in enumerate(tables, start=1):
        name = next((text for key in ("id", "name", "text") if (text := getattr(settings, key, ""))), "")
        rows[name if name and name not in rows else f"{name} {place}".strip()] = _fixed(settings)
    return rows


def differences(old: Table, new: Table) -> list[Difference]:
    """List what differs between two versions. A key that deltaswarm did not have yet counts as its default."""
    old, new = _completed(old), _completed(new)
    was, now = old.pop("condition"), new.pop("condition")
    found = {label: list(frozen.differences(was[label], now[label])) for label in was if label in now}
    in_all = [change for change in next(iter(found.values()), []) if all(change in each for each in found.values())]
    return [
        *(change._replace(key=f"scenario.{change.key}") for change in in_all),
        *(
            change._replace(key=f"condition.{label}.{change.key}")
            for label, changes in found.items()
            for change in changes
            if change not in in_all
        ),
        *(Difference(f"condition.{label}", "there", ABSENT) for label in was if label not in now),
        *(Difference(f"condition.{label}", ABSENT, "there") for label in now if label not in was),
        *frozen.differences(old, new),
    ]


def _completed(protocol: Table) -> Table:
    """Return a protocol with all keys of each condition, and today's defaults of the keys that it lacks."""
    shared = protocol["scenario"]
    completed = {name: table for name, table in protocol.items() if name != "scenario"}
    completed["condition"] = {
        label: _used({**_defaults({**shared, **own}["control.mode"]), **shared, **own})
        for label, own in protocol["condition"].items()
    }
    for name, kind in get_type_hints(StudyFile).items():
        told = protocol.get(name, {})
        if get_origin(kind) is tuple:
            defaults = as_read(_fixed(get_args(kind)[0]()))
            completed[name] = {row: {**defaults, **table} for row, table in told.items()}
        else:
            completed[name] = {**as_read(_fixed(kind())), **told}
    return completed


def _used(table: Table) -> Table:
    unused = tuple(prefix for prefix, (key, value) in UNUSED_UNLESS.items() if table.get(key) != value)
    return {name: value for name, value in table.items() if not name.startswith(unused)}


@cache
def _defaults(mode: str) -> Table:
    """Return the keys of a scenario in which only the control mode is set; none if there is no such mode now."""
    scenario, _ = check_table({"schema": 1, "control": {"mode": mode}})
    table = dict(flattened(checked.plain(scenario))) if scenario else {}
    return {name: value for name, value in table.items() if name not in RUN_ONLY}


@dataclass(frozen=True)
class Protocol:
    """What a study fixed before its runs, what changed since, and what it asks now."""

    study: str
    kind: str
    now: Table
    entries: Sequence[Entry] = ()
    """The frozen protocol, and each amendment: `ENTRY`."""
    begun: str = ""
    """When the runs began; empty if there are none, or it is not known."""

    @property
    def is_before_the_runs(self) -> bool:
        return bool(self.entries) and not self._is_late(self.entries[0])

    @property
    def status(self) -> str:
        if self.kind == EXPLORATORY:
            return "Exploratory: nothing was frozen before its runs, so its results suggest and do not confirm."
        late = "what it asks and expects could still be changed after the first results were seen."
        if not self.entries:
            return f"Not frozen before its runs: {late}"
        entry = self.entries[0]
        if entry[HASH] != self._hashes[0]:
            return f"Not known what was frozen, or when: {FILE} was edited by hand, so {late}"
        if not self.is_before_the_runs:
            return f"Not frozen before its runs, which began on {self.begun}, but on {entry['date']}: {late}"
        runs = f"before its runs, which began on {self.begun}" if self.begun else "when its runs began is not known"
        return f"Frozen on {entry['date']}, {runs}; hash {entry[HASH]}."

    @cached_property
    def unamended(self) -> list[Difference]:
        """What differs between the newest entry and the study file."""
        return differences(self.entries[-1]["protocol"], self.now) if self.entries else []

    @property
    def problems(self) -> list[str]:
        """What contradicts the protocol, a line each."""
        lines = [
            f"{FILE} was edited by hand: {'amendment' if place else 'the protocol'} of {entry['date']} has the hash "
            f"{entry[HASH]}, its content has {right}."
            for place, (entry, right) in enumerate(zip(self.entries, self._hashes, strict=True))
            if entry[HASH] != right
        ]
        if self.entries and not self.is_before_the_runs:
            lines.append(f"The protocol was frozen on {self.entries[0]['date']}, after the runs began ({self.begun}).")
        if found := self.unamended:
            more = f"; and {len(found) - MAX_NAMED} more" if len(found) > MAX_NAMED else ""
            lines.append(
                f"The study file differs from its protocol of {self.entries[-1]['date']}, without an amendment: "
                f"{'; '.join(map(str, found[:MAX_NAMED]))}{more}."
            )
        return lines

    @property
    def _hashes(self) -> list[str]:
        return frozen.hashes_of(self.entries, self.study)

    def _is_late(self, entry: Entry) -> bool:
        return bool(self.begun) and time_of(entry["date"]) > time_of(self.begun)

    def surprises(self, claims: pd.DataFrame) -> pd.DataFrame:
        """Make a row per claim that has an expectation: claim, text, verdict, `expected`, `is_surprise`.

        The expectation is that of the newest entry from before the runs; without one, that of the study file.
        """
        if claims.empty:
            return pd.DataFrame(columns=["claim", "text", "expected", "verdict", "is_surprise"])
        timely = [entry["protocol"] for entry in self.entries if not self._is_late(entry)]
        asked = (timely[-1] if timely else self.now).get("claim", {})
        expected: list[Any] = [
            expected_of(claim.get("kind"), claim.get("expect"))
            for claim in (asked.get(name, {}) for name in claims["claim"])
        ]
        rows = claims[["claim", "text", "verdict"]].assign(expected=expected)
        rows = rows[rows["expected"].notna()]
        return rows.assign(is_surprise=(rows["verdict"] != rows["expected"]) & (rows["verdict"] != "no data"))

    @property
    def amendments(self) -> list[tuple[str, list[Difference]]]:
        """Every amendment: its date, commit and reason in a line, and the keys that changed."""
        amendments = []
        for before, entry in itertools.pairwise(self.entries):
            when = "after the runs began" if self._is_late(entry) else "before the runs"
            line = f"{entry['date']} ({_commit(entry)}), {when if self.begun else 'runs not known'}: {entry['reason']}"
            amendments.append((line, differences(before["protocol"], entry["protocol"])))
        return amendments

    def lead(self, claims: pd.DataFrame) -> str:
        """The first line of the study's page: its status, and the surprises."""
        judged = self.surprises(claims)
        return f"{self.status} Surprises: {_share(judged)}." if len(judged) else self.status

    def facts(self, claims: pd.DataFrame) -> pd.DataFrame:
        """Make a table of what is known of the protocol: date, hash, commits, surprises."""
        judged = self.surprises(claims)
        rows: dict[str, Any] = {"kind": self.kind}
        if self.entries:
            entry = self.entries[0]
            rows |= {"frozen": entry["date"], "hash": entry[HASH], "commit": _commit(entry)}
            rows |= {"not in the commit": "; ".join(map(str, entry["uncommitted"]))} if entry["uncommitted"] else {}
            rows |= {"amendments": len(self.entries) - 1}
        else:
            rows["frozen"] = "no"
        if len(judged):
            rows["surprises"] = _share(judged)
        if new := len(claims) - len(judged):
            rows["claims without a frozen expectation"] = new
        return pd.DataFrame({"what": rows.keys(), "value": map(str, rows.values())})


def _share(judged: pd.DataFrame) -> str:
    return f"{judged['is_surprise'].sum()} of {len(judged)}"


def _commit(entry: Entry) -> str:
    return ", ".join(f"{value} ({name})" for name, value in entry["commit"].items() if value) or "not known"


def protocol_of(study: Study, folder: Path, begun: str = "") -> Protocol:
    """Return what is known of a study's protocol, from the folder of its page."""
    file = folder / FILE
    record = _read(file) if file.exists() else {}
    if record and record.get("study") != study.name:
        raise ProtocolError(f"{file} must be the protocol of the study {study.name!r} (got {record.get('study')!r})")
    return Protocol(study.name, study.file.study.kind, content(study), record.get("entries", []), begun)


def _read(file: Path) -> Mapping[str, Any]:
    try:
        record: Table = json.loads(file.read_text(encoding="utf-8"))
        for entry in record["entries"]:
            frozen.check_entry(entry, ENTRY)
            differences(entry["protocol"], entry["protocol"])  # raises where a part is missing or of another form
        if not record["entries"]:
            raise ValueError("no entries")
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ProtocolError(
            f"{file} must be as `deltaswarm study --freeze` writes it ({error!r}); restore it"
        ) from None
    return record
