"""What `deltaswarm top` draws: letters for trees, shapes for the others, and nothing outside the arena."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.live.views import hello
from deltaswarm_orchestrator.top.drawing import (
    MORE_TREES,
    Letters,
    agents_table,
    draw_map,
    events_table,
    glyph,
    summary,
)
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from tests.support.looking import STATUS, Seen, shown

HELLO = {
    "arena_m": [100.0, 100.0],
    "obstacles": [[[40.0, 0.0], [60.0, 0.0], [60.0, 20.0], [40.0, 20.0]]],
    "base_m": [50.0, 40.0],
    "duration_s": 300.0,
    "agents": 5,
}
TRUTH = shown(Seen())["truth"]


def test_the_map_shows_who_is_where() -> None:
    """North is up: a root as a capital, its tree in the same letter, who attends, an event, the dead, base and wall."""
    lines = draw_map(HELLO, TRUTH, {0: "A"}, 102, 52).plain.splitlines()
    assert {len(line) for line in lines} == {102}
    assert len(lines) == 52
    cells = [(char, (x, y)) for y, line in enumerate(lines) for x, char in enumerate(line)]
    at = {char: [place for found, place in cells if found == char] for char in "Aa◆●×▲⌂▒"}
    assert at["A"] == [(11, 41)]
    assert at["a"] == [(12, 41)]
    assert at["◆"] == [(91, 11)]
    assert at["●"] == [(51, 26)]
    assert at["×"] == [(51, 3)]
    assert at["▲"] == [(93, 16)]
    assert at["⌂"] == [(51, 31)]
    assert (min(at["▒"]), max(at["▒"])) == ((41, 41), (60, 50))


@given(st.integers(-3, 300), st.integers(-3, 100), st.floats(1, 1e5), st.floats(1, 1e5))
def test_the_map_fits(columns: int, rows: int, width_m: float, height_m: float) -> None:
    """Into any terminal, with any arena; whoever is outside is at its edge."""
    truth = {"agents": [[0, -5.0, 2 * height_m, "free", -1, -1]], "events": [[1, 2 * width_m, -1.0, 0.0]]}
    told = {"arena_m": [width_m, height_m], "obstacles": [], "base_m": None}
    lines = draw_map(told, truth, {}, columns, rows).plain.splitlines()
    assert len(lines) <= max(3, rows)
    assert {len(line) for line in lines} <= {*range(3, max(3, columns) + 1)}
    assert "●" in lines[1] or "▲" in lines[1]


def test_a_root_is_drawn_over_its_tree() -> None:
    """Where several agents share a cell, the one that matters is seen."""
    agents = [[1, 5.0, 5.0, "root", -1, 1], [2, 5.0, 5.0, "member", 1, 1], [3, 5.0, 5.0, "free", -1, -1]]
    text = draw_map({**HELLO, "obstacles": []}, {"agents": agents, "events": []}, {1: "C"}, 20, 12).plain
    assert "C" in text
    assert not set(text) & {"c", "●"}


def test_a_tree_keeps_its_letter() -> None:
    """Whatever comes and goes around it; a letter that is free again goes to a new tree."""
    letters = Letters()
    assert dict(letters.of([4, 9, -1, 4])) == {4: "A", 9: "B"}
    assert dict(letters.of([9, 2])) == {9: "B", 2: "A"}
    many = letters.of(range(100))
    assert len(set(many.values())) == 27
    assert many[99] == MORE_TREES


@pytest.mark.parametrize(("role", "root", "char"), [("scout", -1, "●"), ("root", -1, "R"), ("dead", 7, "×")])
def test_other_roles_have_a_shape(role: str, root: int, char: str) -> None:
    """Those of other controllers, too."""
    assert glyph(role, root, {7: "A"})[0] == char


def test_the_tables_have_a_line_for_each() -> None:
    """Agents with tree and parent; events that are not complete, with their age."""
    lines = agents_table(TRUTH, {0: "A"}).plain.splitlines()
    assert lines[1].split() == ["0", "root", "A", "-", "10.0", "20.0"]
    assert lines[2].split() == ["1", "member", "A", "0", "11.0", "20.0"]
    assert len(lines) == 1 + 5
    assert [line.split() for line in events_table(TRUTH, 7.0).plain.splitlines()[1:]] == [
        ["5", "4", "s", "92.0", "70.0"]
    ]


def test_the_summary_says_what_is_known() -> None:
    """Of a run that is recorded, and of one that is not."""
    text = summary(HELLO, shown(Seen()))
    for words in ("7 of 300 s", "4 of 5, 3 busy, 1 roots", "1 open", "1 events", "24.5 s", "3.0 per s", "41 in all"):
        assert words in text
    bare = summary(HELLO, shown(Seen(STATUS, None, None, None)))
    assert "25 of 5, 11 in trees" in bare
    assert "in all" not in bare


def test_a_real_hello_can_be_drawn() -> None:
    """The map takes what a run says of itself."""
    import orjson

    told = orjson.loads(hello("here", load(Scenario, {})))
    assert draw_map(told, TRUTH, {}, 40, 20).plain
