"""What a page says of its protocol: the first line, surprises among all claims ever frozen, and what it replaces."""

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cached_property
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.base.frozen import HASH, Table, as_read
from deltaswarm_studies.ceilings import undecided
from deltaswarm_studies.claim_settings import ClaimSettings, expected_of
from deltaswarm_studies.claims import claims_of
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.fixed import completed, fixed_keys
from deltaswarm_studies.origin import BEGUN, PROVENANCE
from deltaswarm_studies.protocol import Protocol, timely
from deltaswarm_studies.rendering import Table as Shown
from deltaswarm_studies.rendering import table, with_interval
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked
from deltaswarm_wire.checked import SettingsError

Row = dict[Any, Any]

NOT_JUDGED = "cannot be judged"
"""The verdict of a claim that was frozen and is not asked any more, of runs that do not have its metric or variants."""

HEADINGS = {
    "text": "Claim",
    "metric": "Metric",
    "expected": "Expected",
    "then": "Verdict then",
    "found then": "Found then",
    "now": "By the same criterion now",
    "found now": "Found now",
    "asked": "Verdict of this study",
}

PLACE = ["contrast", "metric", "level", "reference", "within"]
"""Columns that tell rows of contrasts apart."""

WHEN = ("from_s", "until_s")
"""Keys of `[study]` without which a metric of one protocol is not that of another."""


class Record:
    """A study's protocol with its evidence: every claim ever frozen, judged by the criterion that was frozen."""

    def __init__(self, protocol: Protocol, evidence: Evidence) -> None:
        self._protocol, self._evidence = protocol, evidence

    @cached_property
    def surprises(self) -> pd.DataFrame:
        """A row per claim ever frozen before the runs: claim, text, `expected`, verdict, `is_surprise`.

        Expectation and criterion are those of the newest entry from before the runs that has the claim; of a study that
        is not frozen, those of its file.
        """
        protocol, rows = self._protocol, dict[str, Row]()
        for asked in [entry["protocol"] for entry in reversed(protocol.timely)] or [protocol.now]:
            is_asked_now = _meant(completed(asked)) == _meant(completed(protocol.now))
            judged = self._evidence.claims if is_asked_now else by_criteria(protocol.study, asked, self._evidence)
            rows = _rows(asked, _by_claim(judged)) | rows
        return _judged(rows.values())

    @cached_property
    def of_replaced(self) -> pd.DataFrame:
        """The same rows of all claims of the protocols that are replaced."""
        return _judged(row for rows in self._compared for row in rows.values())

    @cached_property
    def _compared(self) -> list[dict[str, Row]]:
        """Of each protocol that is replaced, the claims with the old verdict, and that by the old criterion now.

        The verdict that counts is the new one, or where the runs do not allow one the old one.
        """
        found = []
        for record in self._protocol.replaced:
            asked = asked_by(record)
            now = _by_claim(by_criteria(self._protocol.study, asked, self._evidence))
            then = {row["claim"]: row for row in record["claims"]}
            rows = _rows(asked, {**then, **now})
            for claim, row in rows.items():
                for when, judged in (("then", then.get(claim, {})), ("now", now.get(claim, {}))):
                    row[when], row[f"found {when}"] = judged.get("verdict", NOT_JUDGED), _found(judged)
            found.append(rows)
        return found

    @property
    def lead(self) -> str:
        """The first line of a study's page: its status, what it replaces, and the surprises."""
        lines = [self._protocol.status]
        if records := self._protocol.replaced:
            dates = " and ".join(record["entries"][0]["date"] for record in records)
            lines.append(f"It replaces what was frozen on {dates}: see below what that asked and found.")
        counted = {"Surprises": self.surprises, "Surprises among the claims that it replaces": self.of_replaced}
        return " ".join([*lines, *(f"{what}: {_share(rows)}." for what, rows in counted.items() if len(rows))])

    @property
    def replaced(self) -> Iterator[Shown]:
        """A table of outcomes and one of verdicts for each protocol that is replaced: then, and now."""
        study = self._protocol.study
        asked = {row["claim"]: row["verdict"] for row in self._evidence.claims.to_dict("records")}
        for record, rows in zip(self._protocol.replaced, self._compared, strict=True):
            entry = record["entries"][0]
            told = {"frozen": entry["date"], "hash": entry[HASH], "replaced because": record["reason"]}
            told |= {"outcomes then": ", ".join(asked_by(record)["study"]["metrics"])}
            told |= {"outcomes now": ", ".join(study.file.study.metrics)}
            yield _facts(told, f"{record['study']}, frozen on {entry['date']}")
            if rows:
                shown = pd.DataFrame(rows.values()).assign(asked=[asked.get(claim, "not asked") for claim in rows])
                shown["metric"] = [
                    study.metrics[name].label if name in study.metrics else name for name in shown["metric"]
                ]
                yield table(shown, HEADINGS, "Verdicts then and now")

    @property
    def replaced_contrasts(self) -> list[Shown]:
        """For each protocol that is replaced, the contrasts whose verdict is another now, or that are not asked."""
        return [
            _contrasts(f"{record['study']}, frozen on {record['entries'][0]['date']}", was, self._evidence.contrasts)
            for record in self._protocol.replaced
            if len(was := pd.DataFrame(record["contrasts"]))
        ]

    @property
    def tables(self) -> Iterator[Shown]:
        """Tables of what is known of the protocol: facts, surprises, and changes without an amendment."""
        judged, protocol = self.surprises, self._protocol
        told = protocol.facts | ({"surprises": _share(judged)} if len(judged) else {})
        if new := len(set(self._evidence.claims.get("claim", ())) - set(judged["claim"])):
            told["claims without a frozen expectation"] = new
        yield _facts(told)
        if judged["is_surprise"].any():
            headings = {"text": "Claim", "expected": "Expected", "verdict": "Verdict"}
            yield table(judged[judged["is_surprise"].astype(bool)], headings, "Surprises")
        if protocol.unamended:
            headings = {"key": "Key", "old": "Protocol", "new": "Study file"}
            yield table(pd.DataFrame(protocol.unamended), headings, "Differences without an amendment")

    @property
    def amendments(self) -> list[Shown]:
        headings = {"key": "Key", "old": "Old", "new": "New"}
        return [table(pd.DataFrame(changes), headings, title) for title, changes in self._protocol.amendments]


def _share(judged: pd.DataFrame) -> str:
    """Say how many claims are surprises, and which of them cannot be judged."""
    unjudged = judged["text"][judged["verdict"] == NOT_JUDGED].tolist()
    named = f", among them {len(unjudged)} that cannot be judged ({'; '.join(unjudged)})" if unjudged else ""
    return f"{judged['is_surprise'].sum()} of {len(judged)}{named}"


def asked_by(record: Table) -> Table:
    """Return what a replaced protocol asked: the newest of its entries from before its runs, or the first."""
    found: Table = (timely(record["entries"], record["origin"].get(BEGUN, "")) or record["entries"][:1])[-1]["protocol"]
    return found


def by_criteria(study: Study, asked: Table, evidence: Evidence) -> pd.DataFrame:
    """Judge a frozen protocol's claims on a study's runs by their own criteria.

    Claims about variants or metrics that the runs do not have, or that mean something else now, are left out.
    """
    was, runs = completed(asked), evidence.means[~evidence.means["variant"].isin(evidence.unjudged)]
    claims = tuple(claim for one in was["claim"].values() if (claim := _claim(one)) and _has(study, claim, was, runs))
    own = replace(study, file=replace(study.file, claim=claims, contrast=()))
    found = claims_of(own, runs, is_whole=not evidence.unjudged)
    return undecided(own, runs, pd.DataFrame(), found)[1]


def _claim(told: Table) -> ClaimSettings | None:
    known = {spec.name for spec in fields(ClaimSettings)}
    try:
        return checked.load(
            ClaimSettings, {key: value for key, value in told.items() if key in known and value is not None}
        )
    except SettingsError:
        return None


def _has(study: Study, claim: ClaimSettings, was: Table, runs: pd.DataFrame) -> bool:
    """Return whether runs have what a claim is about, with the meaning that it had."""
    now = study.file.study
    if any(was["study"].get(key) != getattr(now, key) for key in WHEN) or not set(claim.variants) <= set(study.levels):
        return False
    own = {metric.name: as_read(fixed_keys(metric)) for metric in study.file.metric}
    names = [claim.metric, *claim.predictors]
    return all(name in runs and was["metric"].get(name) == own.get(name) for name in names)


def _meant(asked: Table) -> tuple[Any, ...]:
    """Return the claims of a protocol, and what decides what their metrics mean."""
    return asked["claim"], asked["metric"], *(asked["study"].get(key) for key in WHEN)


def _by_claim(judged: pd.DataFrame) -> dict[str, Row]:
    return {row["claim"]: row for row in judged.to_dict("records")}


def _rows(asked: Table, judged: dict[str, Row]) -> dict[str, Row]:
    rows = {}
    for claim, told in asked.get("claim", {}).items():
        expected, verdict = (
            expected_of(told.get("kind"), told.get("expect")),
            judged.get(claim, {}).get("verdict", NOT_JUDGED),
        )
        own = {"text": told.get("text", claim), "metric": told.get("metric", "")}
        rows[claim] = {"claim": claim, **own, "expected": expected, "verdict": verdict}
    return rows


def _judged(rows: Any) -> pd.DataFrame:
    found = pd.DataFrame(rows, columns=["claim", "text", "expected", "verdict"])
    found = found[found["expected"].notna()]
    return found.assign(is_surprise=(found["verdict"] != found["expected"]) & (found["verdict"] != "no data"))


def _found(row: Row) -> str:
    numbers = [None if pd.isna(row.get(name)) else float(row[name]) for name in ("estimate", "low", "high")]
    return "" if numbers[0] is None else with_interval(*numbers)


def _contrasts(of: str, was: pd.DataFrame, now: pd.DataFrame) -> Shown:
    now = now.reindex(columns=was.columns).astype(dict.fromkeys([*PLACE, "verdict"], object))
    both = was.merge(now, how="left", on=PLACE, suffixes=(" then", " now"))
    headings = {name: name.capitalize() for name in PLACE}
    for when in ("then", "now"):
        columns = {f"{name} {when}": name for name in ("estimate", "low", "high")}
        both[f"found {when}"] = [_found(row) for row in both.rename(columns=columns).to_dict("records")]
        headings |= {f"{what} {when}": f"{what.capitalize()} {when}" for what in ("verdict", "found")}
    both["verdict now"] = both["verdict now"].fillna("not asked")
    changed = both[both["verdict then"] != both["verdict now"]]
    return table(changed, headings, f"{of}: {len(changed)} of {len(both)} contrasts have another verdict now")


def _facts(told: dict[str, Any], title: str = "") -> Shown:
    return table(pd.DataFrame({"what": told.keys(), "value": map(str, told.values())}), PROVENANCE, title)
