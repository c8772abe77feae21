"""Format numbers for readers: few digits, the same number of decimals in a column, intervals in brackets."""

import math
from collections.abc import Iterable

MISSING = "-"
SIGNIFICANT = 3
MAX_DECIMALS = 6
GROUPED_FROM = 10_000


def decimals_for(values: Iterable[float | None]) -> int:
    """Return how many decimals show a typical one of these values with three significant digits."""
    sizes = sorted(abs(value) for value in values if value is not None and math.isfinite(value) and value)
    if not sizes:
        return 0
    typical = sizes[len(sizes) // 2]
    return min(max(SIGNIFICANT - 1 - math.floor(math.log10(typical)), 0), MAX_DECIMALS)


def number(value: float | None, decimals: int) -> str:
    """Format a number with this many decimals; None and NaN become `-`."""
    if value is None or math.isnan(value):
        return MISSING
    text = f"{value:,.{decimals}f}" if abs(value) >= GROUPED_FROM else f"{value:.{decimals}f}"
    return text.removeprefix("-") if not any(digit in text for digit in "123456789") else text


def with_interval(value: float | None, low: float | None, high: float | None) -> str:
    """Format a number with its interval in brackets, if it has one, all with the same number of decimals."""
    decimals = decimals_for([value, low, high])
    shown = number(value, decimals)
    return shown if low is None or high is None else f"{shown} [{number(low, decimals)}, {number(high, decimals)}]"


def p_value(p: float) -> str:
    """Format a p-value with three decimals, or as below 0.001."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"
