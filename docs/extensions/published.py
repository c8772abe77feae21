"""Put what published studies found into pages that tell of it: findings that still hold, and medians with intervals.

A part begins with a comment and ends with `<!-- end -->`; what stands between them is made anew:

- `<!-- findings: STUDY -->` lists the findings of a study's page, which drops those that its results no longer support.
- `<!-- verdicts: STUDY -->` counts the verdicts of its claims; for the README, by its path.
- `<!-- medians: TABLE -->` makes the table that `docs/tables/TABLE.toml` describes: `study`, `heading`, `[rows]` (name
  and variant), `[columns]` (metric and title), and, if you like, `[says.METRIC]` (what is put beside a row's number).
- `<!-- best: TABLE -->` puts each rule beside the best of the `fixed` variants whose median `rate` is within a bound:
  `study`, `cells`, `[rules]` (name and bound), `fixed`, `rate`, `by`, `columns` (metric and title).
- `<!-- shares: STUDY -->` tables where the claims of a sensitivity study hold, and the keys that turn them.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

DOCS = Path(__file__).parents[1]
PAGES = (DOCS.parent / "README.md", DOCS / "beyond-the-paper.md", DOCS / "READINGS.md")
STUDIES = DOCS / "studies"
TABLES = DOCS / "tables"

OURS = "Our readings"
"""The source of claims that are about our readings of a paper."""

PLACE = "docs/studies"

USUAL = " (What does not differ is equivalent within 1.1 times.)"
"""The usual margin of equivalence, which the page beyond the paper names once."""

PART = re.compile(r"(<!-- (findings|medians|verdicts|best|shares): ([\w-]+) -->\n)(.*?)(<!-- end -->\n)", re.DOTALL)


def findings(study: str) -> Iterator[str]:
    """List a study's findings as its page has them: between its question and its design."""
    page = (STUDIES / study / "page.md").read_text(encoding="utf-8")
    yield ""
    lines = page.partition("\n## Design\n")[0].splitlines()
    yield from (line.removesuffix(USUAL) for line in lines if line.startswith("- "))
    yield ""


def medians(name: str) -> Iterator[str]:
    """Make a table of medians with their 95 % intervals."""
    wanted = described(name)
    table = pd.read_csv(STUDIES / wanted["study"] / "estimates.csv").set_index(["variant", "metric"])
    columns, says = wanted["columns"], wanted.get("says", {})
    yield from ("", f"| {' | '.join([wanted['heading'], *columns.values()])} |", "| --- |" + " ---: |" * len(columns))
    for name, variant in wanted["rows"].items():
        cells = [_cell(table.loc[(variant, metric)]) + says.get(metric, {}).get(name, "") for metric in columns]
        yield f"| {' | '.join([name, *cells])} |"
    yield ""


def described(table: str) -> dict[str, Any]:
    """Read what a table shows."""
    return tomllib.loads((TABLES / f"{table}.toml").read_text(encoding="utf-8"))


def _cell(row: "pd.Series[float]") -> str:
    low, high = (f"{row[end]:.3g}" if pd.notna(row[end]) else "" for end in ("low", "high"))
    return f"{row['median']:.3g} [{low}, {high}]" if low and high else f"{row['median']:.3g}"


def verdicts(study: str) -> Iterator[str]:
    """Count the verdicts of a study's claims; apart those that were calibrated, and those about our readings."""
    table = pd.read_csv(STUDIES / study / "claims.csv")
    is_ours, is_calibrated = table["source"] == OURS, table["calibrated"].notna()
    counts = (
        table[~is_ours & ~is_calibrated]["verdict"].replace({"differs": "refuted", "agrees": "holds"}).value_counts()
    )
    held, refuted, undecided = (counts.get(verdict, 0) for verdict in ("holds", "refuted", "undecided"))
    ours = f" {is_ours.sum()} are about these readings themselves." if is_ours.any() else ""
    yield ""
    yield f"Of {counts.sum()} claims of the paper {held} hold, {refuted} are refuted and {undecided} undecided"
    yield f"([each claim]({PLACE}/{study}/page.md)). {(is_calibrated & ~is_ours).sum()} more are about numbers by which"
    yield f"our settings were chosen, so agreement there is no evidence.{ours}"
    yield ""


def best(name: str) -> Iterator[str]:
    """Make a table of rules beside the fixed variant that would have been best within the same bound: medians."""
    wanted = described(name)
    table = pd.read_csv(STUDIES / wanted["study"] / "estimates.csv").pivot(index="variant", columns="metric")["median"]
    columns, titles = list(wanted["columns"]), " | ".join(wanted["columns"].values())
    numbers = " ---: |" * len(columns)
    yield from ("", f"| rule | {titles} | best fixed | {titles} |", f"| --- |{numbers} --- |{numbers}")
    for cell in wanted["cells"]:
        fixed = table.loc[[f"{cell}, {name}" for name in wanted["fixed"]]]
        for rule, bound in wanted["rules"].items():
            kept = fixed[fixed[wanted["rate"]] <= bound].sort_values(wanted["by"])
            found = [f"{cell}, {rule}", *kept.index[:1]]
            cells = [text for name in found for text in (name, *(f"{table.loc[name, one]:.3g}" for one in columns))]
            cells += [] if len(kept) else ["none", *("" for _ in columns)]
            yield f"| {' | '.join(cells)} |"
    yield ""


def shares(study: str) -> Iterator[str]:
    """Make a table of the claims of a sensitivity study: the share of its points, and what turns them."""
    folder = STUDIES / study
    keys = pd.read_csv(folder / "keys.csv").sort_values("rho_holds", key=abs, ascending=False).to_dict("records")
    yield from (
        "",
        "| claim | points where it holds [%] | keys that turn it (share in the lowest and the highest third) |",
    )
    yield "| --- | ---: | --- |"
    for row in pd.read_csv(folder / "shares.csv").to_dict("records"):
        turning = [
            f"{key['title']} ({100 * key['share_low']:.0f}, {100 * key['share_high']:.0f})"
            for key in keys
            if key["claim"] == row["claim"] and key["verdict"] == "turns it"
        ]
        share, low, high = (f"{100 * row[name]:.0f}" for name in ("share", "low", "high"))
        yield f"| {row['text']} | {share} [{low}, {high}] | {'; '.join(turning) or 'no significant key'} |"
    yield ""


MAKERS = {"findings": findings, "medians": medians, "verdicts": verdicts, "best": best, "shares": shares}


def with_published(text: str) -> str:
    """Return a page with its parts as the published tables have them now."""

    def made(part: re.Match[str]) -> str:
        begin, kind, given, _, end = part.groups()
        return begin + "\n".join(MAKERS[kind](given)) + "\n" + end

    return PART.sub(made, text)


if __name__ == "__main__":
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if (made := with_published(text)) != text:  # a test of this command runs beside tests that read the pages
            page.write_text(made, encoding="utf-8")
