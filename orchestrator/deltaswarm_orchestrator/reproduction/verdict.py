"""The reproduction's report: verdicts, figures, tables, and where all of it comes from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.analysis.claims import Judgement, ValueClaim, claims_table, counted, judge
from deltaswarm_orchestrator.analysis.report import Block, Cell, Column, Notes, Report, Section, Table
from deltaswarm_orchestrator.analysis.statistics import summarise
from deltaswarm_orchestrator.analysis.words import with_interval
from deltaswarm_orchestrator.reproduction.conditions import FIGURES, Extent
from deltaswarm_orchestrator.reproduction.paper_claims import (
    COVERED,
    FRAMES,
    IN_TREES,
    MESSAGES,
    REMARKS,
    WAITING,
    claims,
)
from deltaswarm_orchestrator.reproduction.pictures import picture

SHOWN = {
    WAITING: Column("Waiting time", "s"),
    MESSAGES: Column("Operator messages", "1/s"),
    FRAMES: Column("Frames sent", "1/s"),
    "frames_received_per_s.mean": Column("Frames received", "1/s"),
    IN_TREES: Column("Agents in trees"),
    "trees.mean": Column("Trees"),
    COVERED: Column("Area covered", "m²"),
}


@dataclass(frozen=True)
class Verdict:
    """A reproduction's end: its report, and what became of each claim."""

    report: Report
    judgements: Sequence[Judgement]
    extent: Extent

    @property
    def unexpected(self) -> list[str]:
        """Claims that do not hold here and are not known not to; of short runs orders only, not values."""
        wrong = [one for one in self.judgements if one.verdict == "does not hold" and one.claim.name not in REMARKS]
        values_count = self.extent.judges_convergence
        return [one.claim.name for one in wrong if values_count or not isinstance(one.claim, ValueClaim)]


def verdict(
    manifest: dict[str, Any], extent: Extent, figure: int | None, table: pd.DataFrame, series: pd.DataFrame
) -> Verdict:
    """The report of all figures, or of one."""
    judged = judge(claims(table, series, convergence=extent.judges_convergence)) if len(table) else []
    numbers = [figure] if figure is not None else list(FIGURES)
    sections = [
        Section("Verdict", _verdict_blocks(judged, extent)),
        Section("Figures", [picture(number, extent, table, series) for number in numbers]),
    ]
    if len(table):
        sections.append(Section("All conditions", [_conditions(table)]))
    sections.append(Section("Where this comes from", [_provenance(manifest, extent)]))
    lead = (
        "Kelly et al., Trade-offs of Dynamic Control Structure in Human-swarm Systems, done again with agents that "
        "know only what they sense and hear."
    )
    return Verdict(Report("The paper's results, reproduced", lead, sections), judged, extent)


def _verdict_blocks(judged: Sequence[Judgement], extent: Extent) -> list[Block]:
    if not judged:
        return ["No runs were needed: no claim is judged."]
    count = counted(judged)
    blocks: list[Block] = [
        f"Of {len(judged)} claims {count['holds']} hold, {count['does not hold']} do not, and {count['undecided']} are "
        "undecided; those that do not hold come first. All p-values are corrected together (Holm)."
    ]
    if not extent.judges_convergence:
        blocks.append(
            Notes(
                ["Runs are short and few: enough to see the effects, not to judge convergence or values to the digit."]
            )
        )
    blocks.append(claims_table(judged, "The paper's numbers and claims beside ours"))
    known = [(j.claim.name, REMARKS[j.claim.name]) for j in judged if j.verdict != "holds" and j.claim.name in REMARKS]
    if known:
        blocks.append(Table([Column("Claim"), Column("What we know about why")], known))
    return blocks


def _conditions(table: pd.DataFrame) -> Table:
    """Median with interval of the main figures, a row per condition."""
    found = {figure: summarise(table, [figure]).to_dict("records") for figure in SHOWN}
    rows: list[list[Cell]] = [
        [str(own["variant"]), int(own["n"]), *(_estimate(found[figure][index]) for figure in SHOWN)]
        for index, own in enumerate(found[WAITING])
    ]
    columns = [Column("Condition"), Column("n"), *(Column(c.title, c.unit, is_numeric=True) for c in SHOWN.values())]
    return Table(columns, rows, "Medians over replicates with 95 % bootstrap intervals")


def _estimate(row: Mapping[Any, Any]) -> str:
    value, low, high = (None if pd.isna(row[name]) else float(row[name]) for name in ("median", "low", "high"))
    return with_interval(value, low, high)


def _provenance(manifest: dict[str, Any], extent: Extent) -> Table:
    """Date, versions, digest, how long it took, what was proven."""
    proofs = manifest["proofs"]
    rows = [
        ("extent", f"{extent.name}: {extent.repeats} replicates x {extent.duration_s:g} s"),
        ("runs", f"{manifest['finished']} of {manifest['runs']}, by {manifest['means']}"),
        ("begun", str(manifest["started"])),
        ("wall time of all sessions", f"{manifest['wall_s'] / 60:.1f} min"),
        ("machine", f"{manifest['host']['cores']} cores, {manifest['host']['system']}"),
        ("versions", ", ".join(f"{name} {number}" for name, number in manifest["versions"].items() if number)),
        ("code", ", ".join(manifest["code"])),
        ("digest of the sweep", manifest["digest"] or "- (not all runs are there)"),
        ("also run by real processes", f"{proofs['checked']} runs, {proofs['equal']} with the same digest"),
    ]
    return Table([Column("What"), Column("Value")], rows)
