"""Numbers as a reader wants them: few digits, the same number of decimals in a column, intervals in brackets."""

import math
from collections.abc import Iterable

MISSING = "-"
SIGNIFICANT = 3
MAX_DECIMALS = 6
GROUPED_FROM = 10_000


def decimals_for(values: Iterable[float | None]) -> int:
    """How many decimals show a typical one of these values with three significant digits."""
    sizes = sorted(abs(value) for value in values if value is not None and math.isfinite(value) and value)
    if not sizes:
        return 0
    typical = sizes[len(sizes) // 2]
    return min(max(SIGNIFICANT - 1 - math.floor(math.log10(typical)), 0), MAX_DECIMALS)


def number(value: float | None, decimals: int | None = None) -> str:
    """A number with so many decimals, by default as many as three significant digits need; None and NaN as `-`."""
    if value is None or math.isnan(value):
        return MISSING
    if decimals is None:
        decimals = 0 if isinstance(value, int) else decimals_for([value])
    text = f"{value:,.{decimals}f}" if abs(value) >= GROUPED_FROM else f"{value:.{decimals}f}"
    return text.removeprefix("-") if not any(digit in text for digit in "123456789") else text


def interval(low: float | None, high: float | None, decimals: int | None = None) -> str:
    """An interval in brackets; empty when there is none."""
    if low is None or high is None or math.isnan(low) or math.isnan(high):
        return ""
    decimals = decimals_for([low, high]) if decimals is None else decimals
    return f"[{number(low, decimals)}, {number(high, decimals)}]"


def with_interval(value: float | None, low: float | None, high: float | None, decimals: int | None = None) -> str:
    """A number and its interval, with as many decimals each."""
    if decimals is None:
        decimals = decimals_for([value, low, high])
    return f"{number(value, decimals)} {interval(low, high, decimals)}".rstrip()


def p_value(p: float) -> str:
    """A p-value for a table: three decimals, or that it is below 0.001."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def p_equals(p: float) -> str:
    """A p-value for a sentence: `p = 0.012` or `p < 0.001`."""
    return f"p {p_value(p)}" if p < 0.001 else f"p = {p_value(p)}"


def count(n: int, one: str, many: str | None = None) -> str:
    """`1 run`, `2 runs`."""
    return f"{n} {one if n == 1 else many or one + 's'}"
