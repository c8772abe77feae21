"""A study's protocol: what it runs, asks and expects, frozen before its runs, and every amendment since.

`protocol.json` in the study's folder has an entry for the frozen protocol and one for each amendment. The hash of an
entry covers its content, date, commits and reason, and the hash of the entry before it, so an entry that was edited or
taken out by hand shows. Built-in studies that were run before they could be frozen have `NAME.protocol.json` beside
their file instead: the changes of what they ask, from the history of the repository.
"""

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import pandas as pd

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.scenarios.load import check_table
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.operator_settings import BUDGET
from deltaswarm_scenario.scenario import content_of
from deltaswarm_studies import FOLDERS
from deltaswarm_studies.settings import EXPLORATORY, StudyFile, expected_of
from deltaswarm_studies.stats import ALPHA
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked

FILE = "protocol.json"

SHOWN_ONLY = ("figure", "finding")
"""Tables of a study file that no protocol holds: findings are written after the runs, and figures decide nothing."""

WORDS_ONLY = ("title", "why")
"""Keys that no protocol holds."""

RUN_ONLY = ("schema", "record")
"""Keys of a scenario that do not change what happens in a run."""

UNUSED_UNLESS = {"operator.budget.": ("operator.autonomy.sets_delta", BUDGET)}
"""Keys of a scenario that do nothing unless another has this value: another default of theirs changes no run."""

ENTRY = {"date": str, "commit": dict, "uncommitted": list, "reason": str, "protocol": dict, "hash": str}
"""The keys of an entry."""

MAX_NAMED = 3
"""Maximum number of differences named in a line; the page has all."""

ABSENT = "not there"
MAX_SHOWN = 200

Content = dict[str, Any]


class ProtocolError(CommandError):
    """A protocol cannot be frozen, amended or read."""


class Difference(NamedTuple):
    """A key that differs between two versions of a protocol, with both values as text."""

    key: str
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.key} was {self.old}, is {self.new}"


def content(study: Study) -> Content:
    """Return all of a study that its protocol fixes: runs, outcomes, criteria, margins, expectations."""
    tables = {variant.label: dict(flattened(content_of(variant.scenario))) for variant in study.sweep.variants}
    first = next(iter(tables.values()))
    drawn = study.sweep.file.sensitivity
    ignored = (*RUN_ONLY, *(one.name for one in study.ranges))
    shared = {
        name: value
        for name, value in first.items()
        if name not in ignored and all(name in table and table[name] == value for table in tables.values())
    }
    swept = study.sweep.file.sweep
    extensions = {
        f"{source.what} {source.name}": source.digest
        for variant in study.sweep.variants
        for source in provenance.sources(variant.scenario)
    }
    runs = {"seed": swept.seed, "repeats": swept.repeats, "seeds": study.sweep.seeds}
    runs |= {"series_every_s": swept.series_every_s, **({"repeats_of": swept.repeats_of} if swept.repeats_of else {})}
    asked = {
        name: _rows(value) if isinstance(value, tuple) else _fixed(value)
        for name in checked.plain(study.file)
        if name not in SHOWN_ONLY
        for value in [getattr(study.file, name)]
    }
    fixed = {
        "scenario": shared,
        "condition": {
            label: {name: value for name, value in table.items() if name not in (*shared, *ignored)}
            for label, table in tables.items()
        },
        "runs": runs | {"extensions": extensions},
        **({"sensitivity": _fixed(drawn) | {"range": _rows(drawn.range)}} if drawn else {}),
        "tests": {"alpha": ALPHA},
        **asked,
    }
    return _plain(fixed)


def _fixed(settings: Any) -> Content:
    return {name: value for name, value in checked.plain(settings).items() if name not in WORDS_ONLY}


def _rows(tables: Sequence[Any]) -> dict[str, Content]:
    """Return tables by their names, or by their places where they have none."""
    rows: dict[str, Content] = {}
    for place, settings in enumerate(tables, start=1):
        name = next((text for key in ("id", "name", "text") if (text := getattr(settings, key, ""))), "")
        rows[name if name and name not in rows else f"{name} {place}".strip()] = _fixed(settings)
    return rows


def differences(old: Content, new: Content) -> list[Difference]:
    """List what differs between two versions. A key that deltaswarm did not have yet counts as its default."""
    old, new = _completed(old), _completed(new)
    was, now = old.pop("condition"), new.pop("condition")
    found = {label: list(_differences(was[label], now[label], "")) for label in was if label in now}
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
        *_differences(old, new, ""),
    ]


def _differences(old: Content, new: Content, path: str) -> Iterator[Difference]:
    for name in {**old, **new}:
        was, now = old.get(name, ABSENT), new.get(name, ABSENT)
        if isinstance(was, dict) and isinstance(now, dict):
            yield from _differences(was, now, f"{path}{name}.")
        elif was != now:
            yield Difference(f"{path}{name}", _shown(was), _shown(now))


def _shown(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


def _completed(frozen: Content) -> Content:
    """Return a protocol with all keys of each condition, and today's defaults of the keys that it lacks."""
    shared = frozen["scenario"]
    completed: Content = {
        name: table for name, table in frozen.items() if name not in ("scenario", *get_type_hints(StudyFile))
    }
    completed["condition"] = {
        label: _used({**_defaults({**shared, **own}["control.mode"]), **shared, **own})
        for label, own in frozen["condition"].items()
    }
    for name, kind in get_type_hints(StudyFile).items():
        table = frozen.get(name, {})
        if get_origin(kind) is tuple:
            defaults = _plain(_fixed(get_args(kind)[0]()))
            completed[name] = {row: {**defaults, **told} for row, told in table.items()}
        else:
            completed[name] = {**_plain(_fixed(kind())), **table}
    return completed


def _used(table: Content) -> Content:
    unused = tuple(prefix for prefix, (key, value) in UNUSED_UNLESS.items() if table.get(key) != value)
    return {name: value for name, value in table.items() if not name.startswith(unused)}


@cache
def _defaults(mode: str) -> Content:
    """Return the keys of a scenario in which only the control mode is set; none if there is no such mode now."""
    scenario, _ = check_table({"schema": 1, "control": {"mode": mode}})
    table = dict(flattened(checked.plain(scenario))) if scenario else {}
    return {name: value for name, value in table.items() if name not in RUN_ONLY}


def _plain(table: Any) -> Content:
    """Return a table as JSON gives it back."""
    return dict(json.loads(json.dumps(table)))


@dataclass(frozen=True)
class Protocol:
    """What a study fixed before its runs, what changed since, and what it asks now."""

    study: str
    kind: str
    now: Content
    entries: Sequence[Mapping[str, Any]] = ()
    """The frozen protocol, and each amendment: `ENTRY`."""
    history: Sequence[Mapping[str, Any]] = ()
    """Changes of a study that was run before it could be frozen: date, commit, reason, and changes of keys."""
    begun: str = ""
    """When the runs began; empty if there are none, or it is not known."""

    @property
    def is_before_the_runs(self) -> bool:
        """Whether the protocol was frozen before the runs began."""
        return bool(self.entries) and not self._is_late(self.entries[0])

    @property
    def status(self) -> str:
        """Whether and when the study was frozen."""
        if self.kind == EXPLORATORY:
            return "Exploratory: nothing was frozen before its runs, so its results suggest and do not confirm."
        late = "what it asks and expects could still be changed after the first results were seen."
        if not self.entries:
            return f"Not frozen before its runs: {late}"
        entry = self.entries[0]
        if entry["hash"] != self._hashes[0]:
            return f"Not known what was frozen, or when: {FILE} was edited by hand, so {late}"
        if not self.is_before_the_runs:
            return f"Not frozen before its runs, which began on {self.begun}, but on {entry['date']}: {late}"
        runs = f"before its runs, which began on {self.begun}" if self.begun else "when its runs began is not known"
        return f"Frozen on {entry['date']}, {runs}; hash {entry['hash']}."

    @property
    def unamended(self) -> list[Difference]:
        """What differs between the newest entry and the study file."""
        return differences(self.entries[-1]["protocol"], self.now) if self.entries else []

    @property
    def problems(self) -> list[str]:
        """What contradicts the protocol, a line each."""
        lines = [
            f"{FILE} was edited by hand: {'amendment' if place else 'the protocol'} of {entry['date']} has the hash "
            f"{entry['hash']}, its content has {right}."
            for place, (entry, right) in enumerate(zip(self.entries, self._hashes, strict=True))
            if entry["hash"] != right
        ]
        if self.entries and self._is_late(self.entries[0]):
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
        """The hash that each entry must have."""
        hashes: list[str] = []
        for entry in self.entries:
            hashes.append(hash_of(entry, self.study, hashes[-1] if hashes else ""))
        return hashes

    def _is_late(self, entry: Mapping[str, Any]) -> bool:
        return bool(self.begun) and _time(entry["date"]) > _time(self.begun)

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
        changed = [(entry, [Difference(*change) for change in entry["changes"]]) for entry in self.history]
        changed += [
            (entry, differences(before["protocol"], entry["protocol"]))
            for before, entry in itertools.pairwise(self.entries)
        ]
        when = {True: "after the runs began", False: "before the runs"} if self.begun else {False: "runs not known"}
        return [
            (f"{entry['date']} ({_commit(entry)}), {when[self._is_late(entry)]}: {entry['reason']}", changes)
            for entry, changes in changed
        ]

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
            rows |= {"frozen": entry["date"], "hash": entry["hash"], "commit": _commit(entry)}
            rows |= {"not in the commit": "; ".join(map(str, entry["uncommitted"]))} if entry["uncommitted"] else {}
            rows |= {"amendments": len(self.entries) - 1}
        else:
            rows |= {"frozen": "no", **({"amendments": len(self.history)} if self.history else {})}
        if len(judged):
            rows["surprises"] = _share(judged)
        if new := len(claims) - len(judged):
            rows["claims without a frozen expectation"] = new
        return pd.DataFrame({"what": rows.keys(), "value": map(str, rows.values())})


def _share(judged: pd.DataFrame) -> str:
    return f"{judged['is_surprise'].sum()} of {len(judged)}"


def hash_of(entry: Mapping[str, Any], study: str, before: str) -> str:
    """Return the hash of an entry, which covers the hash of the entry before it."""
    told = {name: value for name, value in entry.items() if name != "hash"}
    return hashlib.sha256(json.dumps([study, before, told], sort_keys=True).encode()).hexdigest()


def _time(date: str) -> datetime:
    time = datetime.fromisoformat(date)
    if time.tzinfo is None:
        raise ValueError(f"{date!r} has no time zone")
    return time


def _commit(entry: Mapping[str, Any]) -> str:
    commit = entry["commit"]
    told = commit.items() if isinstance(commit, dict) else [("", commit)]
    return ", ".join(f"{value} ({name})" if name else str(value) for name, value in told if value) or "not known"


def protocol_of(study: Study, folder: Path, begun: str = "") -> Protocol:
    """Return what is known of a study's protocol, from the folder of its page, or from the package.

    Raises:
        ProtocolError: `protocol.json` cannot be read, or is that of another study.
    """
    file = folder / FILE
    record = _read(file) if file.exists() else {}
    if record and record.get("study") != study.name:
        raise ProtocolError(f"{file} must be the protocol of the study {study.name!r} (got {record.get('study')!r})")
    entries = record.get("entries", [])
    history = [] if record else _history(study)
    return Protocol(study.name, study.file.study.kind, content(study), entries, history, begun)


def _read(file: Path) -> Content:
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        for entry in record["entries"]:
            wrong = [name for name, kind in ENTRY.items() if not isinstance(entry[name], kind)]
            if wrong:
                raise ValueError(f"wrong {', '.join(wrong)}")
            _time(entry["date"])
            differences(entry["protocol"], entry["protocol"])
        if not record["entries"]:
            raise ValueError("no entries")
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ProtocolError(
            f"{file} must be as `deltaswarm study --freeze` writes it ({error!r}); restore it"
        ) from None
    return dict(record)


def _history(study: Study) -> list[Mapping[str, Any]]:
    """Return the changes of a built-in study from before it could be frozen."""
    if not study.is_built_in:
        return []
    for folder in FOLDERS:
        file = resources.files("deltaswarm_studies").joinpath(folder, f"{study.name}.{FILE}")
        if file.is_file():
            return list(json.loads(file.read_text(encoding="utf-8"))["amendments"])
    return []
