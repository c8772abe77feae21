"""Export a video: the swarm from above, drawn by matplotlib and encoded by ffmpeg."""

import itertools
from pathlib import Path

from matplotlib.animation import FFMpegWriter

from deltaswarm_orchestrator.export.formats import ExportError
from deltaswarm_orchestrator.export.picture import DPI, Picture
from deltaswarm_orchestrator.export.snapshots import Film

FRAMES_PER_S = 20
LONGEST_S = 30.0
"""Length of a video [s]; a longer run is shown faster."""


def write(film: Film, out: Path, longest_s: float = LONGEST_S) -> str | None:
    """Write one file, at most `longest_s` long (0: with a frame for each view); return a note if views are left out."""
    if not FFMpegWriter.isAvailable():
        raise ExportError("the format mp4 needs ffmpeg on the PATH (on Debian: apt install ffmpeg)")
    views = sum(1 for _ in film.snapshots())
    most = max(1, round(longest_s * FRAMES_PER_S)) if longest_s else max(1, views)
    every = -(-max(1, views) // most)
    picture = Picture(film)
    writer = FFMpegWriter(fps=FRAMES_PER_S, metadata={"title": "deltaswarm"})
    with writer.saving(picture.figure, str(out), DPI):
        for view in itertools.islice(film.snapshots(), 0, None, every):
            picture.show(view)
            writer.grab_frame()
    if every == 1:
        return None
    length_s = len(range(0, views, every)) / FRAMES_PER_S
    return f"the video lasts {length_s:g} s and shows 1 of {every} views; --longest-s allows more, 0 shows all"
