"""Read a density of events from a file: a grid of weights, as a table of text or a NumPy array."""

import io
import warnings
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from deltaswarm_wire.reading import read_text

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

ARRAY = ".npy"


def read_grid(file: str) -> Floats:
    """Return the weights of a grid, rows from y = 0 upwards, columns from x = 0."""
    is_array = file.endswith(ARRAY)  # read as such only: np.load would take zips for arrays too
    try:
        raw = np.lib.format.open_memmap(file, mode="r") if is_array else _parsed(read_text(Path(file)))
        grid = np.atleast_2d(np.array(raw, dtype=np.float64))
    except TypeError as error:  # an array of objects
        raise ValueError(f"must hold numbers: {error}") from None
    if grid.ndim != 2 or not grid.size:
        raise ValueError(f"must be a table of at least one cell (got the shape {grid.shape})")
    if len(wrong := np.argwhere(~(np.isfinite(grid) & (grid >= 0)))):
        row, column = wrong[0]
        raise ValueError(f"row {row + 1}, column {column + 1}: must be finite and >= 0 (got {grid[row, column]:g})")
    if not 0 < grid.sum() < np.inf:
        raise ValueError(f"must have a positive, finite sum (got {grid.sum():g})")
    return grid


def _parsed(text: str) -> Floats:
    try:
        with warnings.catch_warnings(action="ignore"):  # a file without a number is refused by its shape
            return np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2)
    except ValueError as error:
        raise ValueError(_wrong_place(text) or str(error)) from None


def _wrong_place(text: str) -> str:
    """Name the first cell that is not a number, or the first row of another length; "" if every row is well."""
    width = 0
    for number, line in enumerate(text.splitlines(), 1):
        if not (content := line.partition("#")[0].strip()):
            continue
        cells = content.split(",")
        for column, cell in enumerate(cells, 1):
            try:
                float(cell)
            except ValueError:
                return f"line {number}, column {column}: must be a number (got {cell.strip()[:40]!r})"
        width = width or len(cells)
        if len(cells) != width:
            return f"line {number}: must have {width} cells, as the first row (got {len(cells)})"
    return ""
