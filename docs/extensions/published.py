"""Put what published studies found into pages that tell of it: findings, and medians with intervals.

A part begins with a comment and ends with `<!-- end -->`; what stands between them is made anew:

- `<!-- findings: STUDY -->` lists the findings of a study's page, which are made from its results.
- `<!-- verdicts: STUDY -->` counts the verdicts of its claims in four lines, by `docs/tables/verdicts.toml`.
- `<!-- tests: all -->` counts the tests of all studies.
- `<!-- medians: TABLE -->` makes the table that `docs/tables/TABLE.toml` describes: `study`, `heading`, `[rows]` (name
  and variant), `[columns]` (metric and title), and, if you like, `[says.METRIC]` (what is put beside a row's number).
- `<!-- best: TABLE -->` puts each rule beside the best of the `fixed` variants whose median `rate` is within a bound:
  `study`, `cells`, `[rules]` (name and bound), `fixed`, `rate`, `by`, `columns` (metric and title).
- `<!-- changed: all -->` tables the claims whose verdict is another one since their study was done anew.
- `<!-- shares: STUDY -->` tables where the claims of a sensitivity study hold, and the keys that turn them.
"""

import re
import tomllib
from collections.abc import Iterator
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm_studies.verdicts import tests_of_pages

DOCS = Path(__file__).parents[1]
PAGES = (DOCS.parent / "README.md", DOCS / "beyond-the-paper.md", DOCS / "READINGS.md", DOCS / "CHANGED.md")
STUDIES = DOCS / "studies"
TABLES = DOCS / "tables"

OURS = "Our readings"
"""The source of claims that are about our readings of a paper."""

UNJUDGED = "cannot be judged"
"""The verdict on a claim about what is no longer run."""

PLACE = "docs/studies"

PART = re.compile(
    r"(<!-- (findings|medians|verdicts|tests|best|shares|changed): ([\w-]+) -->\n)(.*?)(<!-- end -->\n)", re.DOTALL
)


def findings(study: str) -> Iterator[str]:
    """List a study's findings as its page has them: between its question and its design."""
    page = (STUDIES / study / "page.md").read_text(encoding="utf-8")
    yield ""
    lines = page.partition("\n## Design\n")[0].splitlines()
    yield from (line for line in lines if line.lstrip().startswith("- "))
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
    """Say in four lines what a study's claims came to, what contradicts their source first."""
    table = pd.read_csv(STUDIES / study / "claims.csv").fillna({"calibrated": ""}).set_index("claim")
    told = tomllib.loads((TABLES / "verdicts.toml").read_text(encoding="utf-8"))
    is_ours, is_calibrated = table["source"] == OURS, table["calibrated"] != ""
    headline = [
        text.format(**_of(table.loc[claim])) for claim, text in told["headline"].items() if claim in table.index
    ]
    main = _counted(table[~is_ours & ~is_calibrated])
    words = {"headline": "; ".join(headline), "page": f"{PLACE}/{study}/page.md", "claims": main.sum()}
    groups = {"main": main, "calibrated": _counted(table[~is_ours & is_calibrated]), "ours": _counted(table[is_ours])}
    for name, counts in groups.items():
        words |= {f"{name}_{verdict}": counts.get(verdict, 0) for verdict in told["verdicts"]} | {name: counts.sum()}
    yield from ("", *(f"- {line.format(**words)}" for line in told["lines"]), "")


def _counted(claims: pd.DataFrame) -> "pd.Series[int]":
    same = {"differs": "refuted", "agrees": "holds", "depends on the metric": "depends", "holds anyway": "anyway"}
    return claims["verdict"].replace(same).value_counts()


def _of(row: "pd.Series[Any]") -> dict[str, str]:
    """Return what a headline may say of a claim: its numbers, and of a ratio by how many percent less it is."""
    less, least, most = (f"{100 * (1 - 1 / row[name]):.1f}" for name in ("estimate", "low", "high"))
    shown = {"less": f"{less} % [{least}, {most}]", "says": row["says"]}
    return shown | {"ours": f"{row['ours']:.2f}", "p": f"{row['p']:.1g}"}


def tests(studies: str) -> Iterator[str]:
    """Say how many tests the pages of all studies hold, on which a page draws."""
    yield from ("", tests_of_pages(sorted(file.parent for file in STUDIES.glob("*/runs.csv"))), "")


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


def changed(studies: str) -> Iterator[str]:
    """Table the claims that came to another verdict by the criterion that they had before."""
    for page in sorted(STUDIES.glob("*/page.md")):
        told = page.read_text(encoding="utf-8").partition("\n## What this study replaces\n")[2].partition("\n## ")[0]
        for before, part in pairwise(told.split("\n**Verdicts then and now**\n")):
            frozen = re.findall(r"^\*\*.*(frozen on \S+)\*\*$", before, re.MULTILINE)[-1]
            lines = takewhile(lambda line: line.startswith("|"), part.strip().splitlines())
            head, _, *claims = [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]
            then, now = head.index("Verdict then"), head.index("By the same criterion now")
            if others := [row for row in claims if row[now] not in (row[then].removesuffix(" anyway"), UNJUDGED)]:
                yield from ("", f"**[{page.parent.name}](studies/{page.parent.name}/page.md), {frozen}**", "")
                yield from (
                    "| claim | verdict then | found then | now | found now |",
                    "| --- | --- | --- | --- | --- |",
                )
                places = (0, then, then + 1, now, now + 1)
                yield from (f"| {' | '.join(row[place] for place in places)} |" for row in others)
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


MAKERS = {
    "findings": findings,
    "medians": medians,
    "verdicts": verdicts,
    "tests": tests,
    "best": best,
    "shares": shares,
    "changed": changed,
}


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
