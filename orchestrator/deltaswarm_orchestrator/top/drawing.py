"""Draw a picture of a run for `deltaswarm top`: the map in characters, and tables. Pure; needs no terminal.

The map uses letters and filled shapes, because single Braille dots are hardly visible on most terminals.
"""

import string
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.text import Text

from deltaswarm_orchestrator.recording.scene import role_colour
from deltaswarm_scenario.truth import DEAD
from deltaswarm_wire.messages import FREE, NOBODY

ROOT = "root"
ATTENDING = "attending"
EVENT_STYLE = "bold #d2956b"
LEGEND = "A root  a its tree  ◆ attending  ● others  × dead  ▲ event  ⌂ base  ▒ obstacle"
MORE_TREES = "*"
"""Letter of the trees for which no letter is left."""

WALL, BASE, EVENT = ("▒", "#888888"), ("⌂", "bold"), ("▲", EVENT_STYLE)

Glyph = tuple[str, str]
"""A character and its style."""

Place = Sequence[float]


class Letters:
    """Assigns a letter to each tree, which keeps it for as long as it has an agent."""

    def __init__(self) -> None:
        self._of: dict[int, str] = {}

    def of(self, roots: Iterable[int]) -> Mapping[int, str]:
        """Return the letters of the current trees, by root."""
        there = {root for root in roots if root != NOBODY}
        self._of = {root: letter for root, letter in self._of.items() if root in there}
        free = [letter for letter in string.ascii_uppercase if letter not in self._of.values()]
        for root in sorted(there - self._of.keys()):
            self._of[root] = free.pop(0) if free else MORE_TREES
        return self._of


def draw_map(
    hello: Mapping[str, Any], truth: Mapping[str, Any], letters: Mapping[int, str], columns: int, rows: int
) -> Text:
    """Draw the arena from above, as large as fits; a terminal cell is assumed to be twice as high as wide."""
    width_m, height_m = hello["arena_m"]
    cell_m = max(width_m / max(1, columns - 2), height_m / (2 * max(1, rows - 2)), 1e-6)
    across, down = max(1, round(width_m / cell_m)), max(1, round(height_m / (2 * cell_m)))

    def cell(x_m: float, y_m: float) -> tuple[int, int]:
        column, row = int(x_m / width_m * across), int((1 - y_m / height_m) * down)
        return min(across - 1, max(0, column)), min(down - 1, max(0, row))

    grid: dict[tuple[int, int], Glyph] = _walls(hello["obstacles"], across, down, (width_m, height_m))
    if hello["base_m"]:
        grid[cell(*hello["base_m"])] = BASE
    for _, x_m, y_m, _ in truth["events"]:
        grid[cell(x_m, y_m)] = EVENT
    for _, x_m, y_m, role, _, root, *_ in sorted(truth["agents"], key=_rank):
        grid[cell(x_m, y_m)] = glyph(role, root, letters)
    text = Text("┌" + "─" * across + "┐\n", no_wrap=True)
    for row in range(down):
        text.append("│")
        for column in range(across):
            text.append(*grid.get((column, row), (" ", "")))
        text.append("│\n")
    return text.append("└" + "─" * across + "┘")


def glyph(role: str, root: int, letters: Mapping[int, str]) -> Glyph:
    colour = role_colour(role)
    letter = letters.get(root)
    if role == DEAD:
        return "×", colour
    if role == ROOT:
        return letter or "R", f"bold reverse {colour}"
    if letter is not None:
        return letter.lower(), colour
    return ("◆" if role == ATTENDING else "●"), colour


def agents_table(truth: Mapping[str, Any], letters: Mapping[int, str]) -> Text:
    text = Text("agent role       tree parent      x      y", style="bold", no_wrap=True)
    for agent, x_m, y_m, role, parent, root, *_ in truth["agents"]:
        tree = letters.get(root, "-") if role != DEAD else "-"
        above = "-" if parent == NOBODY else str(parent)
        text.append(f"\n{agent:5} ", "not bold")
        text.append(f"{role[:10]:10}", f"not bold {role_colour(role)}")
        text.append(f" {tree:>4} {above:>6} {x_m:6.1f} {y_m:6.1f}", "not bold")
    return text


def events_table(truth: Mapping[str, Any], time_s: float) -> Text:
    """Make a table with a line for each event that is not complete, oldest first."""
    text = Text("     event    age      x      y", style="bold", no_wrap=True)
    for event, x_m, y_m, arrived_s in sorted(truth["events"], key=lambda row: (row[3], row[0])):
        text.append(f"\n{event:10} {time_s - arrived_s:4.0f} s {x_m:6.1f} {y_m:6.1f}", "not bold")
    return text


def summary(hello: Mapping[str, Any], picture: Mapping[str, Any]) -> str:
    workload, truth, status = picture["workload"], picture["truth"], picture.get("status")
    lines = [f"time       {picture['time_s']:.0f} of {hello['duration_s']:.0f} s, step {picture['step']}"]
    if truth:
        roles = [row[3] for row in truth["agents"]]
        there = len(roles) - roles.count(DEAD)
        counts = f"{there} of {hello['agents']}, {there - roles.count(FREE)} busy, {roles.count(ROOT)} roots"
        lines += [f"agents     {counts}", f"events     {len(truth['events'])} open"]
    elif status:
        lines.append(f"agents     {status['agents_alive']} of {hello['agents']}, {status['agents_in_trees']} in trees")
    if status:
        lines.append(f"waiting    {status['mean_waiting_s']:.1f} s on average")
        lines.append(f"complete   {status['events_completed']} events")
    lines.append(f"messages   {workload['rate_1s_hz']:.1f} per s, {workload['rate_60s_hz']:.1f} per s over 60 s")
    if workload["messages"] is not None:
        lines.append(f"           {workload['messages']} in all")
    return "\n".join(lines)


def _rank(row: Sequence[Any]) -> int:
    """Return an agent's rank in drawing order: roots cover other busy agents, which cover free ones, then dead ones."""
    return {DEAD: 0, FREE: 1, ROOT: 3}.get(row[3], 2)


def _walls(
    obstacles: Sequence[Sequence[Place]], across: int, down: int, size_m: tuple[float, float]
) -> dict[tuple[int, int], Glyph]:
    """Return the cells whose centre is inside an obstacle."""
    cells = [(column, row) for column in range(across) for row in range(down)] if obstacles else []
    width_m, height_m = size_m
    return {
        (column, row): WALL
        for column, row in cells
        if any(
            _is_inside((column + 0.5) / across * width_m, (1 - (row + 0.5) / down) * height_m, corners)
            for corners in obstacles
        )
    }


def _is_inside(x: float, y: float, corners: Sequence[Place]) -> bool:
    """Return whether a point is inside a polygon: a ray to the right crosses its edges an odd number of times."""
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    beside = [(a, b) for a, b in edges if (a[1] > y) != (b[1] > y)]
    return sum(x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]) for a, b in beside) % 2 == 1
