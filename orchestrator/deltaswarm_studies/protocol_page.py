"""What a page says of its protocol: the first line, surprises among all claims ever frozen, and what it replaces."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.base.frozen import HASH, Table
from deltaswarm_studies.ceilings import undecided
from deltaswarm_studies.claims import claims_of
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.fixed import completed
from deltaswarm_studies.origin import BEGUN, PROVENANCE
from deltaswarm_studies.protocol import Protocol, timely
from deltaswarm_studies.rendering import Table as Shown
from deltaswarm_studies.rendering import table, with_interval
from deltaswarm_studies.settings import ClaimSettings, expected_of
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked
from deltaswarm_wire.checked import SettingsError

Row = dict[Any, Any]

NOT_JUDGED = "cannot be judged"
"""The verdict of a claim that was frozen and is not asked any more, of runs that do not have its metric or variants."""

WHEN = ("from_s", "until_s")
"""Keys of `[study]` without which a metric of one protocol is not that of another."""


def lead(protocol: Protocol, evidence: Evidence) -> str:
    """Return the first line of a study's page: its status, what it replaces, and the surprises."""
    lines = [protocol.status]
    if records := protocol.replaced:
        dates = ", ".join(record["entries"][0]["date"] for record in records)
        lines.append(f"It replaces what was frozen on {dates}: see below what that asked and found.")
    for what, rows in (
        ("Surprises", surprises(protocol, evidence)),
        ("Of the claims that it replaces", old(protocol, evidence)),
    ):
        if len(rows):
            lines.append(f"{what}: {share(rows)}.")
    return " ".join(lines)


def share(judged: pd.DataFrame) -> str:
    """Say how many claims are surprises, and which of them cannot be judged."""
    unjudged = judged["text"][judged["verdict"] == NOT_JUDGED].tolist()
    named = f", among them {len(unjudged)} that cannot be judged: {'; '.join(unjudged)}" if unjudged else ""
    return f"{judged['is_surprise'].sum()} of {len(judged)}{named}"


def surprises(protocol: Protocol, evidence: Evidence) -> pd.DataFrame:
    """Make a row per claim ever frozen before the runs: claim, text, `expected`, verdict, `is_surprise`.

    Expectation and criterion are those of the newest entry from before the runs that has the claim; of a study that is
    not frozen, those of its file.
    """
    rows: dict[str, Row] = {}
    for asked in [entry["protocol"] for entry in reversed(protocol.timely)] or [protocol.now]:
        is_asked_now = completed(asked)["claim"] == completed(protocol.now)["claim"]
        judged = evidence.claims if is_asked_now else by_criteria(protocol.study, asked, evidence)
        rows = _rows(asked, _by_claim(judged)) | rows
    return _judged(rows.values())


def old(protocol: Protocol, evidence: Evidence) -> pd.DataFrame:
    """Make the same rows of all claims of protocols that are replaced, judged on the new runs where they can be."""
    return _judged(row for record in protocol.replaced for row in compared(protocol.study, record, evidence).values())


def compared(study: Study, record: Table, evidence: Evidence) -> dict[str, Row]:
    """Return the claims of a replaced protocol by their ids: the old verdict, and that by the old criterion now.

    The verdict that counts is the new one, or where the runs do not allow one the old one.
    """
    asked = asked_by(record)
    then, now = {row["claim"]: row for row in record["claims"]}, _by_claim(by_criteria(study, asked, evidence))
    rows = _rows(asked, {**then, **now})
    for claim, row in rows.items():
        for when, found in (("then", then.get(claim, {})), ("now", now.get(claim, {}))):
            row[when], row[f"found {when}"] = found.get("verdict", NOT_JUDGED), _found(found)
    return rows


def asked_by(record: Table) -> Table:
    """Return what a replaced protocol asked: the newest of its entries from before its runs, or the first."""
    found: Table = (timely(record["entries"], record["origin"].get(BEGUN, "")) or record["entries"][:1])[-1]["protocol"]
    return found


def by_criteria(study: Study, asked: Table, evidence: Evidence) -> pd.DataFrame:
    """Judge a frozen protocol's claims on a study's runs by their own criteria.

    Claims about variants or metrics that the runs do not have, or that mean something else now, are left out.
    """
    was, runs = completed(asked), evidence.runs[~evidence.runs["variant"].isin(evidence.unjudged)]
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
    own = {metric.name: checked.plain(metric) for metric in study.file.metric}
    names = [claim.metric, *claim.predictors]
    return all(name in runs and was["metric"].get(name) == own.get(name) for name in names)


def _by_claim(judged: pd.DataFrame) -> dict[str, Row]:
    return {row["claim"]: row for row in judged.to_dict("records")}


def _rows(asked: Table, judged: dict[str, Row]) -> dict[str, Row]:
    rows = {}
    for claim, told in asked.get("claim", {}).items():
        expected, verdict = (
            expected_of(told.get("kind"), told.get("expect")),
            judged.get(claim, {}).get("verdict", NOT_JUDGED),
        )
        rows[claim] = {"claim": claim, "text": told.get("text", claim), "expected": expected, "verdict": verdict}
    return rows


def _judged(rows: Any) -> pd.DataFrame:
    found = pd.DataFrame(rows, columns=["claim", "text", "expected", "verdict"])
    found = found[found["expected"].notna()]
    return found.assign(is_surprise=(found["verdict"] != found["expected"]) & (found["verdict"] != "no data"))


def _found(row: Row) -> str:
    numbers = [None if pd.isna(row.get(name)) else float(row[name]) for name in ("estimate", "low", "high")]
    return "" if numbers[0] is None else with_interval(*numbers)


def replaced_tables(protocol: Protocol, evidence: Evidence) -> Iterator[Shown]:
    """Make a table of outcomes and one of verdicts for each protocol that is replaced: then, and now."""
    now = {row["claim"]: row["verdict"] for row in evidence.claims.to_dict("records")}
    for record in protocol.replaced:
        entry, asked = record["entries"][0], asked_by(record)
        told = {
            "study": record["study"],
            "frozen": entry["date"],
            "hash": entry[HASH],
            "replaced because": record["reason"],
        }
        told |= {"outcomes then": ", ".join(asked["study"]["metrics"])}
        told |= {"outcomes now": ", ".join(protocol.study.file.study.metrics)}
        yield _facts(told, f"{record['study']}, frozen on {entry['date']}")
        if rows := compared(protocol.study, record, evidence):
            shown = pd.DataFrame(rows.values())
            headings = {"text": "Claim", "expected": "Expected", "then": "Verdict then", "found then": "Found then"}
            headings |= {"now": "By the same criterion now", "found now": "Found now", "asked": "Verdict of this study"}
            shown["asked"] = [now.get(claim, "not asked") for claim in rows]
            yield table(shown, headings, "Verdicts then and now")


def tables(protocol: Protocol, evidence: Evidence) -> Iterator[Shown]:
    """Make the tables of what is known of a protocol: facts, surprises, and changes without an amendment."""
    judged, replaced = surprises(protocol, evidence), old(protocol, evidence)
    told = protocol.facts | ({"surprises": share(judged)} if len(judged) else {})
    told |= {"surprises of what it replaces": share(replaced)} if len(replaced) else {}
    if new := len(set(evidence.claims.get("claim", ())) - set(judged["claim"])):
        told["claims without a frozen expectation"] = new
    yield _facts(told)
    for rows, title in ((judged, "Surprises"), (replaced, "Surprises of what it replaces")):
        if rows["is_surprise"].any():
            headings = {"text": "Claim", "expected": "Expected", "verdict": "Verdict"}
            yield table(rows[rows["is_surprise"].astype(bool)], headings, title)
    if protocol.unamended:
        headings = {"key": "Key", "old": "Protocol", "new": "Study file"}
        yield table(pd.DataFrame(protocol.unamended), headings, "Differences without an amendment")


def amendment_tables(protocol: Protocol) -> Sequence[Shown]:
    headings = {"key": "Key", "old": "Old", "new": "New"}
    return [table(pd.DataFrame(changes), headings, title) for title, changes in protocol.amendments]


def _facts(told: dict[str, Any], title: str = "") -> Shown:
    return table(pd.DataFrame({"what": told.keys(), "value": map(str, told.values())}), PROVENANCE, title)
