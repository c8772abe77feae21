"""The two tiers of tests: the gate runs what shows a fact, the nightly tier repeats it at length."""

from collections.abc import Iterable

import pytest


def nightly(*cases: object) -> list[object]:
    """Return cases of `parametrize` that only the nightly tier runs."""
    return [pytest.param(case, marks=pytest.mark.slow) for case in cases]


def first_of(cases: Iterable[object]) -> list[object]:
    """Return the first case for the gate, and the others for the nightly tier."""
    first, *others = cases
    return [first, *nightly(*others)]
