"""Whether one thing that was swept changes what another does: of two, each value with each, replicate by replicate."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.analysis.statistics import compare, holm


def interactions(table: pd.DataFrame, figure: str, factors: Sequence[Sequence[str]], *, seed: int = 0) -> pd.DataFrame:
    """How many times as much a value of the first factor changes a figure beside a value of the second.

    The change is the ratio of a replicate's figure to its figure with the first value of the first factor; it is
    compared with the change beside the first value of the second factor, in the same replicate. A figure that is not
    above 0 has no ratio, and its replicate is left out.

    Args:
        table: A sweep's, a row per run.
        figure: One of its columns.
        factors: Two lists of labels; a variant's is one of each, with a comma between.
        seed: Of the resampling.

    Returns:
        A row per further value of each: `change`, `beside`, `reference`, every field of `Comparison` (where `a` is
        the change beside the value, `b` that beside the reference, and `ratio` how many times as large it is) and
        `p_holm`, corrected over these rows. No row unless the variants ran with the same seeds.
    """
    (base, *levels), (reference, *others) = factors
    values = table.pivot(index="replicate", columns="variant", values=figure).apply(pd.to_numeric)
    values = values.where(values > 0)
    cells = {f"{level}, {other}" for level in factors[0] for other in factors[1]}
    if not cells <= set(values) or (table.groupby("replicate")["seed"].nunique() > 1).any():
        return pd.DataFrame()
    rows: list[dict[str, Any]] = []
    for level in levels:
        changes = {other: values[f"{level}, {other}"] / values[f"{base}, {other}"] for other in factors[1]}
        for other in others:
            found = compare(changes[other].tolist(), changes[reference].tolist(), paired=True, seed=seed)
            rows.append({"change": f"{base} to {level}", "beside": other, "reference": reference, **asdict(found)})
    rows = [row for row in rows if row["n_a"]]
    adjusted = holm([row["p"] for row in rows])
    return pd.DataFrame([{**row, "p_holm": p} for row, p in zip(rows, adjusted, strict=True)])
