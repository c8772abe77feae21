"""The report of a user's own sweep: what was swept, the figures by variant, comparisons with one of them."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib.figure
import pandas as pd

from deltaswarm_orchestrator.analysis import words
from deltaswarm_orchestrator.analysis.figure_names import FIGURES, FigureName, named
from deltaswarm_orchestrator.analysis.interaction import interactions
from deltaswarm_orchestrator.analysis.ranks import smallest_p
from deltaswarm_orchestrator.analysis.report import Block, Cell, Column, Command, Notes, Picture, Report, Section, Table
from deltaswarm_orchestrator.analysis.statistics import compare_all, summarise
from deltaswarm_orchestrator.figures.boxes import boxes
from deltaswarm_orchestrator.figures.lines import lines
from deltaswarm_orchestrator.figures.over_time import IN_TREES, IN_TREES_LABEL, over_time
from deltaswarm_orchestrator.figures.style import OTHERS, TEXT_IN, looks

ALPHA = 0.05
LINE_FROM = 3
"""A number that is swept over so many values is drawn as a line, over fewer as boxes."""

METHOD = (
    "Medians with their 95 % bootstrap intervals (BCa; percentile below 5 runs). Comparisons are paired where the "
    "replicates have the same seeds, by Wilcoxon's signed-rank test (pairs that do not differ left out), else by "
    "Mann-Whitney's U test; differences are Hodges-Lehmann estimates. Effect sizes go from -1 to 1: matched-pairs "
    "rank-biserial correlation where paired, else Cliff's delta. p-values are corrected by Holm's method over the "
    "variants of each figure, not over the figures. Where two things vary, each value with each, a table tells whether "
    "a change of the one, each replicate's ratio to itself without it, is larger with a value of the other than with "
    "its first (signed-rank test, Holm over the table)."
)


def sweep_report(
    name: str,
    manifest: Mapping[str, Any],
    table: pd.DataFrame,
    series: pd.DataFrame | None = None,
    *,
    reference: str | None = None,
    figures: Sequence[str] = (),
) -> Report:
    """The report of a sweep.

    Args:
        name: The sweep's folder, as a user would type it.
        manifest: The sweep's.
        table: One row per run.
        series: One row per run and window of time, if there is one.
        reference: The variant that the others are compared with, by default the first.
        figures: Columns of the table to report besides the main ones (`figure_names.FIGURES`).

    Raises:
        ValueError: When the table has no rows, lacks the reference or a figure that is asked for, such a figure
            holds no numbers, or a variant has a replicate twice.
    """
    if table.empty:
        raise ValueError(f"the sweep {name} has no finished run")
    labels = [str(label) for label in table["variant"].unique()]
    reference = labels[0] if reference is None else reference
    if reference not in labels:
        raise ValueError(f"no variant is called {reference!r}; there are {', '.join(labels)}")
    command = f"deltaswarm report {shlex.quote(name)}"
    chosen = _chosen(table, figures)
    title = str(manifest.get("name", name))
    count = words.count(len(labels), "variant")
    report = Report(f"Sweep {title}", f"{words.count(len(table), 'run')} of {count}.")
    report.sections.append(Section("What was swept", _provenance(manifest, table, command)))
    report.sections.append(Section("At a glance", [_glance(table, chosen), METHOD]))
    for figure in chosen:
        blocks = _figure_blocks(table, figure, reference, manifest, command)
        report.sections.append(Section(named(figure).title, blocks))
    if series is not None and not series.empty and IN_TREES in series:
        report.sections.append(Section("Over time", _over_time(series, command)))
    return report


def _chosen(table: pd.DataFrame, more: Sequence[str]) -> list[str]:
    """The main figures that the table has, and those asked for."""
    for figure in more:
        if figure not in table:
            raise ValueError(f"the table has no figure {figure!r}")
        try:
            pd.to_numeric(table[figure])
        except (ValueError, TypeError):
            raise ValueError(f"{figure} holds no numbers") from None
    return list(dict.fromkeys([*(figure for figure in FIGURES if figure in table), *more]))


def _provenance(manifest: Mapping[str, Any], table: pd.DataFrame, command: str) -> list[Block]:
    """Where the numbers come from, and what is wrong with them."""
    facts: list[tuple[str, str]] = [("base scenario", str(manifest.get("base", "unknown")))]
    facts += [(f"`{key}`", ", ".join(str(value) for value in table[key].unique())) for key in _swept(manifest, table)]
    proofs = manifest.get("proofs") or {}
    checked, equal = int(proofs.get("checked", 0)), int(proofs.get("equal", 0))
    proven = f"{words.count(checked, 'run')}, of which {equal} with an equal digest"
    failed = [str(failure) for failure in manifest.get("failed") or ()]
    sessions = int(manifest.get("sessions", 1))
    wall_time = "wall time" if sessions == 1 else f"wall time of {sessions} sessions"
    facts += [
        ("variants", "; ".join(str(label) for label in table["variant"].unique())),
        ("replicates of each", str(manifest.get("repeats", "unknown"))),
        ("seed", str(manifest.get("seed", "unknown"))),
        ("runs", f"{len(table)} finished of {manifest.get('runs', 'unknown')}, {len(failed)} failed"),
        ("done by", str(manifest.get("means", manifest.get("engine", "unknown")))),
        ("proven by real processes", proven if checked else "none: no run was done by both means"),
        ("digest", f"`{manifest['digest']}`" if manifest.get("digest") else "none: not all runs are there"),
        ("started", str(manifest.get("started", "unknown"))),
        (wall_time, f"{words.number(manifest.get('wall_s'))} s"),
        ("versions", ", ".join(f"{part} {known}" for part, known in (manifest.get("versions") or {}).items())),
    ]
    blocks: list[Block] = [Table([Column("What"), Column("Value")], facts)]
    warnings = _warnings(manifest, table, failed, checked - equal)
    if warnings:
        blocks.append(Notes(warnings, is_warning=True))
    return [*blocks, Command(command)]


def _swept(manifest: Mapping[str, Any], table: pd.DataFrame) -> list[str]:
    """The swept keys that are columns of the table."""
    keys: list[str] = list(manifest.get("swept") or ())
    if not keys:
        paired = [key for row in manifest.get("paired") or () for key in row]
        keys = [*(manifest.get("axes") or {}), *paired]
    return [key for key in dict.fromkeys(keys) if key in table]


def _warnings(manifest: Mapping[str, Any], table: pd.DataFrame, failed: list[str], differing: int) -> list[str]:
    warnings = [f"failed: {failure}" for failure in failed]
    runs = manifest.get("runs")
    if isinstance(runs, int) and len(table) < runs:
        warnings.append(f"{runs - len(table)} of {words.count(runs, 'run')} are missing from every figure below")
    if differing:
        warnings.append(f"{words.count(differing, 'run')} had another digest by real processes")
    if "valid" in table:
        invalid = table[~table["valid"].astype(bool)]
        warnings += [f"not valid: {row['variant']}, replicate {row['replicate']}" for _, row in invalid.iterrows()]
    if len(manifest.get("code") or ()) > 1:
        warnings.append("the code changed while the sweep was under way")
    return warnings


def _glance(table: pd.DataFrame, figures: Sequence[str]) -> Table:
    """The medians of all figures, one row per variant."""
    medians = {figure: summarise(table, [figure])["median"].tolist() for figure in figures}
    labels = [str(label) for label in table["variant"].unique()]
    runs = table["variant"].value_counts()
    columns = [Column("Variant"), Column("runs"), *(named(figure).column() for figure in figures)]
    rows = [
        (label, int(runs[label]), *(medians[figure][index] for figure in figures)) for index, label in enumerate(labels)
    ]
    return Table(columns, rows, "Medians over the replicates")


def _figure_blocks(
    table: pd.DataFrame, figure: str, reference: str, manifest: Mapping[str, Any], command: str
) -> list[Block]:
    """One figure of the runs: table, comparisons, drawing."""
    name = named(figure)
    if not pd.to_numeric(table[figure]).notna().any():
        return ["No run has a value."]
    summary = summarise(table, [figure])
    decimals = words.decimals_for([float(value) for value in summary["median"]])
    columns = {"variant": Column("Variant"), "n": Column("n")}
    if summary["missing"].any():
        columns["missing"] = Column("without a value")
    columns |= {
        column: Column(title, name.unit, decimals)
        for column, title in (
            ("median", "median"),
            ("low", "95 % from"),
            ("high", "to"),
            ("q1", "quartile 1"),
            ("q3", "quartile 3"),
        )
    }
    blocks: list[Block] = [Table.of(summary, columns, f"{name.title} by variant (`{figure}`)")]
    compared = compare_all(table, figure, reference)
    if len(compared):
        blocks += [_comparisons(compared, name, reference, decimals)]
        rows = compared.to_dict("records")
        blocks.append(Notes([in_words(row, name, len(rows)) for row in rows]))
        blocks += _too_few(rows)
    blocks += _interaction(table, figure, manifest)
    return blocks + _drawings(table, figure, summary, manifest, command)


def _interaction(table: pd.DataFrame, figure: str, manifest: Mapping[str, Any]) -> list[Block]:
    """Of two things that vary, each value with each: whether the one changes what the other does."""
    factors = [labels for labels in manifest.get("factors") or () if len(labels) > 1]
    if len(factors) != 2:
        return []
    found = interactions(table, figure, factors)
    if found.empty:
        return []
    rows = found.to_dict("records")
    columns = [Column("Change"), Column("in"), Column("against that in"), Column("n")]
    columns += [Column(title, is_numeric=True) for title in ("times as large", "p (Holm)", "effect")]
    cells: list[list[Cell]] = [
        [
            *(str(row[name]) for name in ("change", "beside", "reference")),
            int(row["n_a"]),
            words.with_interval(row["ratio"], row["ratio_low"], row["ratio_high"], 2),
            words.p_value(row["p_holm"]),
            words.number(row["effect"], 2),
        ]
        for row in rows
    ]
    return [
        Table(columns, cells, f"{named(figure).title}: is a change larger in one than in another?"),
        *_too_few(rows),
    ]


def _comparisons(compared: pd.DataFrame, name: FigureName, reference: str, decimals: int) -> Table:
    columns = {
        "variant": Column("Variant"),
        "difference": Column("difference", name.unit, decimals),
        "low": Column("95 % from", name.unit, decimals),
        "high": Column("to", name.unit, decimals),
        "ratio": Column("ratio of medians", decimals=2),
        "n_a": Column("n"),
        "p_shown": Column("p (Holm)", is_numeric=True),
        "effect": Column("effect", decimals=2),
    }
    # What is the same in every row, as it is most often, need not stand in each.
    how = ""
    for column, title in (("test", "test"), ("effect_name", "effect size")):
        same = compared[column].unique()
        if len(same) == 1:
            how += f"; {title}: {same[0]}"
        else:
            columns[column] = Column(title)
    shown = compared.assign(p_shown=[words.p_value(p) for p in compared["p_holm"]])
    return Table.of(shown, columns, f"Compared with {reference}{how}")


def _too_few(rows: Sequence[Mapping[Any, Any]]) -> list[Block]:
    """A warning where no difference, however large, could show."""
    least = min(smallest_p(row["n_a"], row["n_b"], paired=row["paired"]) for row in rows) * len(rows)
    if least < ALPHA:
        return []
    warning = (
        f"Too few replicates for any difference to show: corrected for {words.count(len(rows), 'comparison')}, the "
        f"smallest p that they can give is {words.number(min(least, 1.0))}."
    )
    return [Notes([warning], is_warning=True)]


def in_words(row: Mapping[Any, Any], name: FigureName, family: int) -> str:
    """A row of `compare_all` as a sentence."""
    subject = f"{row['variant']} against {row['reference']}"
    difference = row["difference"]
    if difference is None or pd.isna(difference):
        return f"{subject}: nothing to compare."
    low, high, p = row["low"], row["high"], float(row["p_holm"])
    has_interval = low is not None and not pd.isna(low)
    ends = [float(low), float(high)] if has_interval else []
    decimals = words.decimals_for([float(difference), *ends])
    unit = f" {name.unit}" if name.unit else ""
    between = ""
    if has_interval:
        between = f" (95 % interval {words.number(ends[0], decimals)} to {words.number(ends[1], decimals)})"
    tested = f"{words.p_equals(p)}, Holm over {family}, effect {words.number(row['effect'], 2)}"
    if p < ALPHA:
        word = name.more if difference > 0 else name.less
        size = words.number(abs(float(difference)), decimals)
        if has_interval and difference < 0:
            between = f" (95 % interval {words.number(-ends[1], decimals)} to {words.number(-ends[0], decimals)})"
        return f"{subject}: {word} by {size}{unit}{between}; {tested}."
    return f"{subject}: no difference shown, {words.number(float(difference), decimals)}{unit}{between}; {tested}."


def _drawings(
    table: pd.DataFrame, figure: str, summary: pd.DataFrame, manifest: Mapping[str, Any], command: str
) -> list[Block]:
    """Lines over the one number that was swept, else a box per variant."""
    name = named(figure)
    points = _over_a_number(table, summary, _swept(manifest, table))
    if points is not None:
        key, frame = points
        caption = f"{name.title} over `{key}`: medians with their 95 % intervals."
        groups = [str(group) for group in frame["group"].unique()]
        return _pictures(
            figure,
            caption,
            command,
            groups,
            lambda some: lines(frame, key, key, name.label, group="group", groups=some, width_in=TEXT_IN),
        )
    caption = f"{name.title}: quartiles, medians, and every replicate as a point."
    known = [str(row["variant"]) for row in summary.to_dict("records") if row["n"]]
    return _pictures(figure, caption, command, known, lambda some: boxes(table, figure, name.label, variants=some))


def _over_time(series: pd.DataFrame, command: str) -> list[Block]:
    """How many agents are in trees."""
    caption = "Agents in trees: the mean over the replicates with its 95 % interval."
    labels = [str(label) for label in series["variant"].unique()]
    return _pictures(
        IN_TREES, caption, command, labels, lambda some: over_time(series, IN_TREES, IN_TREES_LABEL, variants=some)
    )


def _over_a_number(table: pd.DataFrame, summary: pd.DataFrame, swept: Sequence[str]) -> tuple[str, pd.DataFrame] | None:
    """The swept number and the table for `lines`; None unless one number makes lines of all variants."""
    numbers = [key for key in swept if _is_number(table[key]) and table[key].nunique() >= LINE_FROM]
    if len(numbers) != 1:
        return None
    key, others = numbers[0], [other for other in swept if other not in numbers]
    known = summary.dropna(subset=["median"]).set_index("variant")
    heads = table.drop_duplicates("variant").set_index("variant").loc[known.index]
    group = [" ".join(str(heads.loc[label, other]) for other in others) or "all" for label in heads.index]
    frame = pd.DataFrame(
        {
            key: pd.to_numeric(heads[key]),
            "group": group,
            "value": known["median"],
            "low": known["low"],
            "high": known["high"],
        }
    )
    # One number alone makes no line, two variants at one number make no single point.
    makes_lines = not frame.duplicated(["group", key]).any() and (frame.groupby("group").size() > 1).all()
    return (key, frame.reset_index(drop=True)) if makes_lines else None


def _is_number(column: pd.Series) -> bool:
    return pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)


def _pictures(
    name: str, caption: str, command: str, labels: list[str], draw: Callable[[list[str]], matplotlib.figure.Figure]
) -> list[Block]:
    """One picture, or several where one has not looks enough for all labels; or why there is none."""
    try:
        looks(labels)
        parts = [labels]
    except ValueError:
        parts = [labels[start : start + len(OTHERS)] for start in range(0, len(labels), len(OTHERS))]
    blocks: list[Block] = []
    for number, part in enumerate(parts, start=1):
        of = f" Part {number} of {len(parts)}." if len(parts) > 1 else ""
        file = f"{name}.{number}" if len(parts) > 1 else name
        try:
            blocks.append(Picture(draw(part), file, caption + of, command))
        except ValueError as error:  # a report without a drawing is better than no report
            blocks.append(Notes([f"No drawing of {name}: {error}."], is_warning=True))
    return blocks
