"""Format results as text: numbers with few digits, columns aligned."""

from collections.abc import Iterable, Mapping
from typing import Any


def aligned(rows: Iterable[Iterable[str]]) -> str:
    """Format rows of cells as lines with aligned columns."""
    cells = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells
    )


def named(values: Mapping[str, Any]) -> str:
    """Format named values, one line each; lists of rows and mappings follow as tables."""
    plain, tables = [], []
    for name, value in values.items():
        rows = value if isinstance(value, list) else []
        if isinstance(value, Mapping):
            rows = [{name: key, **(row if isinstance(row, Mapping) else {"": row})} for key, row in value.items()]
        if rows:
            tables.append(
                aligned([[head.replace("_", " ") for head in rows[0]], *(map(shown, row.values()) for row in rows)])
            )
        else:
            plain.append((name.replace("_", " "), shown(value)))
    return "\n\n".join([aligned(plain), *tables])


def shown(value: Any) -> str:
    """Format a value; a float has two decimals below 100 and none from 100 on."""
    if isinstance(value, float):
        return f"{value:.0f}" if abs(value) >= 100 else f"{value:.2f}"
    return {"None": "-", "True": "yes", "False": "NO"}.get(str(value), str(value))
