"""Reading tables for figures: what is not there is said by name, what is missing is counted."""

import difflib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

Floats = npt.NDArray[np.float64]

VARIANT, REPLICATE, TIME_S = "variant", "replicate", "time_s"


def require(table: pd.DataFrame, *columns: str) -> None:
    """Raises ValueError, naming what was meant perhaps, unless the table has rows and these columns."""
    known = [str(column) for column in table.columns]
    for column in columns:
        if column not in known:
            close = difflib.get_close_matches(column, known, n=3)
            meant = f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
            raise ValueError(f"the table has no column {column!r}{meant}")
    if table.empty:
        raise ValueError("the table has no rows")


def variants_of(table: pd.DataFrame, wanted: Sequence[str] | None) -> list[str]:
    """The variants to draw: as wanted, or all in order of appearance.

    Raises:
        ValueError: a wanted variant that has no rows, or none wanted at all.
    """
    there = [str(variant) for variant in table[VARIANT].unique()]
    if wanted is None:
        return there
    if not wanted:
        raise ValueError("no variants are asked for")
    for variant in wanted:
        if variant not in there:
            raise ValueError(f"variant {variant!r} has no rows; there are {', '.join(map(repr, there))}")
    return list(wanted)


def of_variant(table: pd.DataFrame, variant: str, *columns: str) -> tuple[Floats, int]:
    """The rows (n, len(columns)) of a variant in which all columns have finite values, and how many rows it has.

    Raises:
        ValueError: no row has.
    """
    rows = table.loc[table[VARIANT] == variant, list(columns)].to_numpy(dtype=np.float64, na_value=np.nan)
    whole = rows[np.isfinite(rows).all(axis=1)]
    if not len(whole):
        raise ValueError(f"variant {variant!r} has no value of {' and '.join(columns)} in {len(rows)} runs")
    return whole, len(rows)


def counted(there: int, runs: int) -> str:
    """How many replicates are drawn; when some had no value, of how many."""
    return f"n = {there}" if there == runs else f"n = {there} of {runs}"
