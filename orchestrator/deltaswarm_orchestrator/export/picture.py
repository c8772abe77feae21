"""Draw one view of a run from above: agents by role, trees and open events."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from deltaswarm_orchestrator.export.snapshots import Film, Snapshot
from deltaswarm_orchestrator.recording.scene import role_colour
from deltaswarm_scenario.truth import EventState

SIZE_IN, DPI = (9.0, 7.2), 100
"""900 by 720 pixels: the arena, and the legend beside it."""


class Shown(Figure):
    """A figure that a notebook shows, whether or not the notebook has imported pyplot."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png", bbox_inches="tight")
        return data.getvalue()


def _discs(radius_m: float, axes: Axes, look: Mapping[str, Any]) -> EllipseCollection:
    """Make discs of their true size, without positions as yet."""
    size_m = [2.0 * radius_m]
    return EllipseCollection(size_m, size_m, [0.0], units="xy", offsets=[], offset_transform=axes.transData, **look)


class Picture:
    """One figure, whose contents are replaced for each frame."""

    def __init__(self, film: Film) -> None:
        self.figure = Shown(figsize=SIZE_IN, dpi=DPI)
        self._axes = self.figure.add_axes((0.08, 0.08, 0.7, 0.87), aspect="equal")
        self._axes.set(xlim=(0, film.width_m), ylim=(0, film.height_m), xlabel="x [m]", ylabel="y [m]")
        for wall in film.walls_m:
            self._axes.plot(*zip(*wall, strict=True), color="black", linewidth=1)
        self._trees = LineCollection([], colors=role_colour("member"), linewidths=1.2)
        self._axes.add_collection(self._trees)
        self._events = self._axes.scatter([], [], s=30, c="black", marker="s")
        edge: dict[str, Any] = {"edgecolors": "black", "linewidths": 0.4, "zorder": 3}
        self._radius_m = film.radius_m
        self._headings = LineCollection([], colors="black", linewidths=0.8, zorder=4)
        if film.radius_m:
            self._agents: Collection = self._axes.add_collection(_discs(film.radius_m, self._axes, edge))
            self._axes.add_collection(self._headings)
        else:
            self._agents = self._axes.scatter([], [], s=36, **edge)
        self._roles: list[str] = []
        self._numbers: dict[int, int] = {}
        """Events by the order of their arrival: their ids are long and mean nothing."""
        self._names: list[Text] = []

    def show(self, view: Snapshot) -> None:
        self._trees.set_segments([[(body.x_m, body.y_m) for body in pair] for pair in view.trees])
        self._events.set_offsets(np.array([(event.x_m, event.y_m) for event in view.events]).reshape(-1, 2))
        self._name_events(view.events)
        self._agents.set_offsets(np.array([(body.x_m, body.y_m) for body in view.bodies]).reshape(-1, 2))
        self._headings.set_segments(view.headings_m(self._radius_m))
        self._agents.set_facecolor([role_colour(body.role) for body in view.bodies])
        self._axes.set_title(f"{view.time_s:.0f} s")
        if new := {body.role for body in view.bodies} - set(self._roles):
            self._roles += sorted(new)
            marks = [("o", role_colour(role), role) for role in self._roles] + [("s", "black", "event")]
            signs = [
                Line2D([], [], linestyle="", marker=sign, color=colour, label=text) for sign, colour, text in marks
            ]
            self._axes.legend(handles=signs, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)

    def _name_events(self, events: Sequence[EventState]) -> None:
        for name in self._names:
            name.remove()
        for event in sorted(events, key=lambda event: event.arrived_s):
            self._numbers.setdefault(event.event, len(self._numbers) + 1)
        self._names = [
            self._axes.annotate(
                f"e{self._numbers[event.event]}", (event.x_m, event.y_m), (5, 4), textcoords="offset points", fontsize=8
            )
            for event in events
        ]
