"""Export a video: the swarm from above, drawn by matplotlib and encoded by ffmpeg."""

import itertools
from pathlib import Path

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deltaswarm_orchestrator.export.formats import ExportError
from deltaswarm_orchestrator.export.snapshots import Film, Snapshot
from deltaswarm_orchestrator.recording.scene import role_colour

FRAMES_PER_S = 20
MAX_FRAMES = 30 * FRAMES_PER_S
"""Most frames of a video; a longer run is shown faster."""

SIZE_IN, DPI = 7.2, 100
"""720 by 720 pixels."""


def write(film: Film, out: Path) -> None:
    """Write one file, at most 30 s long.

    Raises:
        ExportError: ffmpeg is not installed.
    """
    if not FFMpegWriter.isAvailable():
        raise ExportError("--format mp4 needs ffmpeg on the PATH (on Debian: apt install ffmpeg)")
    views = sum(1 for _ in film.snapshots())
    every = -(-max(1, views) // MAX_FRAMES)
    picture = _Picture(film)
    writer = FFMpegWriter(fps=FRAMES_PER_S, metadata={"title": "deltaswarm"})
    with writer.saving(picture.figure, str(out), DPI):
        for view in itertools.islice(film.snapshots(), 0, None, every):
            picture.show(view)
            writer.grab_frame()


class _Picture:
    """One figure, whose contents are replaced for each frame."""

    def __init__(self, film: Film) -> None:
        self.figure = Figure(figsize=(SIZE_IN, SIZE_IN))
        self._axes = self.figure.add_axes((0.1, 0.08, 0.87, 0.87), aspect="equal")
        self._axes.set(xlim=(0, film.width_m), ylim=(0, film.height_m), xlabel="x [m]", ylabel="y [m]")
        for wall in film.walls_m:
            self._axes.plot(*zip(*wall, strict=True), color="black", linewidth=1)
        self._trees = LineCollection([], colors=role_colour("member"), linewidths=1.2)
        self._axes.add_collection(self._trees)
        self._events = self._axes.scatter([], [], s=30, c="black", marker="s")
        self._agents = self._axes.scatter([], [], s=36, edgecolors="black", linewidths=0.4, zorder=3)
        self._roles: list[str] = []

    def show(self, view: Snapshot) -> None:
        """Draw one view."""
        self._trees.set_segments(view.trees_m)
        self._events.set_offsets(np.array([(event.x_m, event.y_m) for event in view.events]).reshape(-1, 2))
        self._agents.set_offsets(np.array([(body.x_m, body.y_m) for body in view.bodies]).reshape(-1, 2))
        self._agents.set_facecolor([role_colour(body.role) for body in view.bodies])
        self._axes.set_title(f"{view.time_s:.0f} s")
        if new := {body.role for body in view.bodies} - set(self._roles):
            self._roles += sorted(new)
            dots = [
                Line2D([], [], linestyle="", marker="o", color=role_colour(role), label=role) for role in self._roles
            ]
            self._axes.legend(handles=dots, loc="upper right", framealpha=0.8)
