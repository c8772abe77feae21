"""Draw a swarm at work under each kind of control: the paper's examples of early tree formations."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from scipy import stats

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.density import Component
from deltaswarm_scenario.grid import read_grid
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import AgentState, EventState
from deltaswarm_studies import style
from deltaswarm_studies.stats import Floats

HELD = 0.95
"""The dotted line is drawn around this share of the events."""

_SHADES = ListedColormap(matplotlib.colormaps["Greys"](np.linspace(0.0, 0.5, 256)))


@dataclass(frozen=True)
class DrawnSwarm:
    """A swarm at one time. Positions are in m, world frame; `phi` (rows, columns) is the event density [1/m2].

    For a density that moves, `phi` is the mean over the run.
    """

    time_s: float
    width_m: float
    height_m: float
    sensing_range_m: float
    bodies: tuple[AgentState, ...]
    events: tuple[EventState, ...]
    phi: Floats
    obstacles: tuple[tuple[tuple[float, ...], ...], ...] = ()
    """Corners of each obstacle [m]."""
    radius_m: float = 0.0
    """The radius of a body; 0: a point."""


class _Kind(NamedTuple):
    """How agents of one kind are drawn, and what the legend calls them."""

    label: str
    marker: str
    markerfacecolor: str
    markersize: float

    @property
    def look(self) -> dict[str, Any]:
        edge = {"linestyle": "none", "markeredgecolor": style.BLACK, "markeredgewidth": 0.5}
        return self._asdict() | edge


_LAST = len(style.LEVELS) - 1
_MEMBERS = tuple(
    _Kind(f"level {level}" + (" or deeper" if level == _LAST else ""), "o", style.LEVELS[level], 3.8)
    for level in range(1, _LAST + 1)
)
_ROOT = _Kind("root", "s", style.LEVELS[0], 5.2)
_FREE = _Kind("free", "^", "#ffffff", 3.6)
_ATTENDING = _Kind("attending", "D", "#8c8c8c", 3.2)
_RELOCATING = _Kind("relocating", "p", "#ffffff", 4.4)
_DEAD = _Kind("dead", "x", style.BLACK, 3.2)
_BODY: dict[str, Any] = _Kind("body (true size)", "o", "none", 5.2).look
IN_TREES = ("root", "member")
"""Roles of agents in trees, whose sensing range is shaded."""

KINDS = (_FREE, _ATTENDING, _ROOT, *_MEMBERS, _RELOCATING, _DEAD)


def snapshot(scenario: Scenario, time_s: float) -> DrawnSwarm:
    """Run a scenario with its own seed; return the swarm and its incomplete events after the step at `time_s`.

    Raises:
        ValueError: `time_s` is before the start or after the end of the run.
    """
    last = round(time_s / scenario.run.step_s)
    if not 0 <= last < scenario.run.steps:
        raise ValueError(f"a run of {scenario.run.duration_s:.15g} s has no step at {time_s:.15g} s")
    run = InProcess(scenario)
    for record, _ in run.steps(last):  # noqa: B007 (the last one is wanted)
        pass
    truth = run.world.truth(record)
    return DrawnSwarm(
        time_s=truth.time_s,
        width_m=scenario.arena.width_m,
        height_m=scenario.arena.height_m,
        sensing_range_m=scenario.agents.sensing_range_m,
        bodies=truth.bodies,
        events=tuple(event for event in truth.events if event.completed_s is None),
        phi=phi(scenario),
        obstacles=tuple(obstacle.corners_m for obstacle in scenario.arena.obstacles),
        radius_m=scenario.world.radius_m,
    )


COLUMNS = 3
"""Most panels side by side."""


def swarm(snapshots: Mapping[str, DrawnSwarm], *, width_in: float = style.TEXT_IN) -> Figure:
    """Draw one panel per snapshot, side by side (the paper's three panels: decentralised, hierarchical, hybrid).

    The shade is the event density, with a dotted line around 95 % of the events; black dots are incomplete events.
    Agents in trees are coloured by level, roots blue, with a line from each child to its parent and the sensing range
    around each; free, attending and relocating agents have markers of their own. Bodies that take up room
    are circles of their true size, each with a line to its edge in the direction of its heading.

    Args:
        snapshots: snapshots by title; their names.
        width_in: width of the whole figure [in]; the height follows.
    """
    if not snapshots:
        raise ValueError("there are no snapshots")
    columns = min(len(snapshots), COLUMNS)
    rows = -(-len(snapshots) // columns)
    tallest = max(shot.height_m / shot.width_m for shot in snapshots.values())
    with style.drawing():
        figure = style.new_figure(width_in, ((width_in - 0.4) / columns * tallest + 0.6) * rows)
        grid = [*figure.subplots(rows, columns, squeeze=False).flat]
        for axes in grid[len(snapshots) :]:
            axes.set_visible(False)
        densest = max(float(shot.phi.max()) for shot in snapshots.values())  # one shade means one density
        same = len({(shot.width_m, shot.height_m) for shot in snapshots.values()}) == 1
        for place, (axes, (title, shot)) in enumerate(zip(grid, snapshots.items(), strict=False)):
            _panel(axes, shot, densest)
            axes.set_title(f"({chr(ord('a') + place)}) {style.shown(title)}")
            if place + columns >= len(snapshots):
                axes.set_xlabel("x [m]")
            if place % columns == 0:
                axes.set_ylabel("y [m]")
            elif same:
                axes.tick_params(labelleft=False)
        drawn = {kind for shot in snapshots.values() for kind in map(kind_of, shot.bodies)}
        kinds = [kind for kind in KINDS if kind in drawn]
        spacing = {"handletextpad": 0.4, "columnspacing": 1.0, "handlelength": 1.2}
        style.add_legend(figure, _legend(kinds, list(snapshots.values())), columns=6, spacing=spacing)
    return figure


def kind_of(body: AgentState) -> _Kind:
    """Return how an agent is drawn, by its role and level."""
    if body.role in ("member", "orphan"):
        return _MEMBERS[min(max(body.level, 1), _LAST) - 1]
    special = {"root": _ROOT, "attending": _ATTENDING, "relocating": _RELOCATING, "dead": _DEAD}
    return special.get(body.role, _FREE)


def edges(bodies: Sequence[AgentState]) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Yield a line from each child to its parent [m]; an orphan has lost its parent and gets no line."""
    places = {body.agent: (body.x_m, body.y_m) for body in bodies}
    for body in bodies:
        if body.role == "member" and body.parent in places:
            yield (body.x_m, body.y_m), places[body.parent]


def headings(bodies: Sequence[AgentState], radius_m: float) -> Iterator[tuple[tuple[float, float], ...]]:
    """Yield a line from the centre to the edge of each body that has a heading [m]."""
    for body in bodies:
        if (angle := body.heading_rad) is not None:
            ahead_m = radius_m * math.cos(angle), radius_m * math.sin(angle)
            yield (body.x_m, body.y_m), (body.x_m + ahead_m[0], body.y_m + ahead_m[1])


def _panel(axes: Axes, shot: DrawnSwarm, densest: float) -> None:
    extent = (0.0, shot.width_m, 0.0, shot.height_m)
    shade: dict[str, Any] = {"cmap": _SHADES, "vmin": 0.0, "vmax": densest, "interpolation": "nearest", "zorder": 0}
    axes.imshow(shot.phi, origin="lower", extent=extent, **shade)
    for corners in shot.obstacles:
        axes.add_patch(Polygon(corners, facecolor=style.GREY, zorder=1.2))
    level = level_holding(shot.phi, HELD)
    if level is not None:
        axes.contour(shot.phi, [level], extent=extent, colors=style.GREY, linewidths=0.7, linestyles=":", zorder=1)
    for body in shot.bodies:
        if body.role in IN_TREES:
            reach: dict[str, Any] = {"facecolor": (style.LEVELS[0], 0.10), "edgecolor": "none", "zorder": 1.5}
            axes.add_patch(Circle((body.x_m, body.y_m), shot.sensing_range_m, **reach))
    axes.add_collection(
        LineCollection(list(edges(shot.bodies)), colors=style.BLACK, linewidths=0.7, zorder=2, label="edges")
    )
    for kind in KINDS:
        places = [(body.x_m, body.y_m) for body in shot.bodies if kind_of(body) == kind]
        if places:
            # A root's marker is larger and lies below, so that it stays visible behind a close member.
            axes.plot(*np.array(places).T, zorder=2.9 if kind == _ROOT else 3, clip_on=False, **kind.look)
    if shot.radius_m:  # above the markers, which may be larger
        look: dict[str, Any] = {"linewidths": 0.4, "zorder": 3.5}
        circles = [Circle((body.x_m, body.y_m), shot.radius_m) for body in shot.bodies]
        axes.add_collection(PatchCollection(circles, facecolors="none", edgecolors=style.BLACK, label="bodies", **look))
        lines = list(headings(shot.bodies, shot.radius_m))
        axes.add_collection(LineCollection(lines, colors=style.BLACK, label="headings", **look))
    events = [(event.x_m, event.y_m) for event in shot.events]
    axes.plot(
        *np.array(events, dtype=np.float64).reshape(-1, 2).T,
        linestyle="none",
        marker="o",
        markersize=1.9,
        color=style.BLACK,
        markeredgecolor="white",
        markeredgewidth=0.25,
        zorder=4,
        label="events",
    )
    axes.set_xlim(0, shot.width_m)
    axes.set_ylim(0, shot.height_m)
    axes.set_aspect("equal")
    quarters = np.array([0.25, 0.5, 0.75])  # none at a panel's end, where it would touch the next panel's
    axes.set_xticks(quarters * shot.width_m)
    axes.set_yticks(quarters * shot.height_m)


def _legend(kinds: Sequence[_Kind], shots: Sequence[DrawnSwarm]) -> list[Artist]:
    event: dict[str, Any] = {
        "linestyle": "none",
        "marker": "o",
        "markersize": 2.4,
        "color": style.BLACK,
        "label": "event",
    }
    held = f"{HELD:.0%} of events".replace("%", " %")
    in_trees = any(body.role in IN_TREES for shot in shots for body in shot.bodies)
    return [
        *(Line2D([], [], **kind.look) for kind in kinds),
        *([Line2D([], [], **event)] if any(shot.events for shot in shots) else []),
        *([Line2D([], [], color=style.BLACK, linewidth=0.7, label="to parent")] if _any_edge(shots) else []),
        *([Line2D([], [], **_BODY)] if any(shot.radius_m for shot in shots) else []),
        *([Patch(facecolor=(style.LEVELS[0], 0.15), label="sensing range in trees")] if in_trees else []),
        *([Patch(facecolor=style.GREY, label="obstacle")] if any(shot.obstacles for shot in shots) else []),
        *(
            [Line2D([], [], color=style.GREY, linewidth=0.8, linestyle=":", label=held)]
            if any(level_holding(shot.phi, HELD) is not None for shot in shots)
            else []
        ),
    ]


def _any_edge(shots: Sequence[DrawnSwarm]) -> bool:
    return any(True for shot in shots for _ in edges(shot.bodies))


CELLS = 200
"""Cells along each side of the arena."""

MOMENTS = 100
"""Number of times in a run over which a density that moves is averaged."""


def phi(scenario: Scenario, cells: int = CELLS) -> Floats:
    """Return the density of events (cells, cells) [1/m2] at the cells' centres, rows from y = 0, columns from x = 0.

    For a density that moves, this is the mean over the run. Its integral over the arena is 1, because an event outside
    the arena is drawn again. A grid is read from its file.
    """
    arena, density = scenario.arena, scenario.events.density
    shares = (np.arange(cells) + 0.5) / cells
    if density.kind == "uniform":
        fields = [np.ones((cells, cells))]
    elif density.kind == "grid":
        weights = read_grid(density.file)
        rows, columns = ((shares * side).astype(int) for side in weights.shape)
        fields = [weights[np.ix_(rows, columns)]]
    else:
        places_m = np.stack(np.meshgrid(shares * arena.width_m, shares * arena.height_m), axis=-1)
        moments = MOMENTS if density.moves else 1
        times_s = (np.arange(moments) + 0.5) / moments * scenario.run.duration_s
        fields = [_mixture(density.normals_at(float(time_s)), places_m) for time_s in times_s]
    mean: Floats = np.mean([field / field.sum() for field in fields], axis=0)
    return mean * cells**2 / (arena.width_m * arena.height_m)


def _mixture(normals: Sequence[Component], places_m: Floats) -> Floats:
    field: Floats = np.zeros(places_m.shape[:-1])
    for weight, mean_m, covariance_m2 in normals:
        field += weight * stats.multivariate_normal(mean_m, covariance_m2).pdf(places_m)
    return field


def level_holding(field: Floats, share: float) -> float | None:
    """Return the level above which a density (rows, columns) holds this share of all events; None if it is uniform.

    The paper speaks of the area in which 95 % of the events occur.
    """
    if np.ptp(field) <= 1e-9 * field.max():
        return None
    falling = np.sort(field, axis=None)[::-1]
    held = np.cumsum(falling) / falling.sum()
    return float(falling[np.searchsorted(held, share)])
