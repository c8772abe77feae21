"""What a number of pairs can show at all. A separate module because it needs no SciPy."""

ALPHA = 0.05


def smallest_p(pairs: int) -> float:
    """Return the smallest two-sided p-value that this many pairs can give: all differences have the same sign."""
    return min(1.0, 2.0 ** (1 - pairs))


def pairs_needed(family: int) -> int:
    """Return the minimum number of pairs for a test to become significant in a family of `family` tests (Holm)."""
    return next(pairs for pairs in range(1, 200) if smallest_p(pairs) * family <= ALPHA)
