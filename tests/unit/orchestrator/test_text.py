"""Results as text: columns aligned, numbers short."""

import pytest

from deltaswarm_orchestrator.base.exits import aligned, named, shown


def test_columns_begin_at_the_same_place() -> None:
    """Whatever the width of their cells; no line ends with a space."""
    assert aligned([("a", "b"), ("long", "")]) == "a     b\nlong"


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (True, "yes"), (False, "NO"), (0.126, "0.13"), (1234.5, "1234"), (7, "7"), ("a", "a")],
)
def test_a_value_is_short(value: object, text: str) -> None:
    """Fractions have two decimals, or none where they are large."""
    assert shown(value) == text


def test_rows_become_a_table() -> None:
    """A list of them, or a table of them by name; plain values come first."""
    lines = named(
        {"sizes": [{"agents": 5, "speed_hz": 2.5}], "radio": {"all_on": {"x": 1}}, "steps": 9, "us": {"a": 1}}
    )
    assert [line.split() for line in lines.splitlines() if line] == [
        *(["steps", "9"], ["agents", "speed", "hz"], ["5", "2.50"]),
        *(["radio", "x"], ["all_on", "1"], ["us"], ["a", "1"]),
    ]
