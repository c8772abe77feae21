"""Cells that a spreadsheet would take for formulas."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire.cells import guarded, raw


@pytest.mark.parametrize(
    ("value", "cell"),
    [
        ("=1+1", "'=1+1"),
        ("=cmd|'/C calc'!A0", "'=cmd|'/C calc'!A0"),
        (" \t@SUM(A1)", "' \t@SUM(A1)"),
        ("-2+3", "'-2+3"),
        ("＝1", "'＝1"),
        ("'=1", "''=1"),
        ("'tis", "'tis"),
        ("-2.5e-3", "-2.5e-3"),
        ("a = b", "a = b"),
        (-2.5, -2.5),
        (None, None),
    ],
)
def test_a_text_that_begins_like_a_formula_is_one_no_longer(value: object, cell: object) -> None:
    assert guarded(value) == cell
    assert raw(cell) == value


@given(st.text("'=+-@ \t\n1a", max_size=8))
def test_no_text_is_lost(text: str) -> None:
    assert raw(guarded(text)) == text
