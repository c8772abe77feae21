"""The look that all figures share: sizes, type, colours that survive a grey printer, and reproducible files.

No figure touches matplotlib's global state: `drawing()` sets what it needs and restores everything, and figures are
made without pyplot.
"""

import io
import itertools
import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import matplotlib.style
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from deltaswarm_studies import fitting
from deltaswarm_wire.files import write_whole

TEXT_IN = 4.8
"""Width of the paper's text [in]. The figures are as wide, so that nothing is scaled and 8 pt stays 8 pt."""

LETTERS = 70
"""Letters that are side by side in a figure as wide as the text."""

LINE_IN = 0.14
"""Height of a line of text [in]."""

LAYOUTS = 4
"""Most layouts of a figure whose texts become narrower from one to the next."""

SPACING: Mapping[str, float] = {"columnspacing": 1.2}

STYLE = Path(__file__).with_name("deltaswarm.mplstyle")

BLACK, GREY, PALE = "#000000", "#666666", "#d0d0d0"

LEVELS = ("#004488", "#b12a90", "#d6556d", "#f2844b", "#fdb130", "#f7e425")
"""Colours by level in a tree: roots blue as in the paper, then lighter with depth; the last for all deeper levels."""


@dataclass(frozen=True)
class Look:
    """How a variant is drawn in every figure. Each attribute alone distinguishes it from its neighbours."""

    colour: str
    marker: str
    hatch: str
    line: Literal["-"] | tuple[int, tuple[float, ...]] = "-"

    @property
    def tint(self) -> str:
        """The colour at half strength, for areas on which black must be legible."""
        return mix(self.colour, "#ffffff", 0.5)


MODES = {
    "hierarchical": Look("#004488", "s", "////", (0, (5, 1.5))),
    "hybrid": Look("#bb5566", "o", "....", "-"),
    "decentralised": Look("#ddaa33", "^", "", (0, (1, 1))),
}
"""Tol's high-contrast colours, for colour-blind readers and grey printing; hybrid lies between the other two."""

COLOURS = ("#56b4e9", "#117733", "#a0a0a0", "#661100", "#000000")
MARKERS = ("D", "v", "P", "X", "p", "h", "*")
HATCHES = (r"\\\\", "xxxx", "||||", "----", "++++", "oo")
LINES: tuple[Any, ...] = ("-", (0, (4, 1)), (0, (2, 1)), (0, (4, 1, 1, 1)))
"""What makes looks besides those of the modes. The numbers of all four differ, so that each look differs from the next
ones in all, and two of one colour in marker, hatch and line."""

HYBRID_DELTA = 3
"""The paper's delta, which has the look of the hybrid mode itself."""

_DELTA_MARKERS = {2: "D", 4: "v", 5: "P", 6: "X", 7: "<", 8: ">", 9: "p", 10: "h"}
_DELTA_LINES: tuple[Any, ...] = ((0, (3, 1)), (0, (4, 1, 1, 1)), (0, (2, 2)), "-")


def others() -> Iterator[Look]:
    """Yield the looks for everything but the control modes, in order of appearance."""
    return map(Look, *map(itertools.cycle, (COLOURS, MARKERS, HATCHES, LINES)))


def hybrid(delta: int) -> Look:
    """Choose a look between hierarchical and decentralised by delta, like the swarm (delta sensitivity analysis)."""
    look = MODES["hybrid"]
    if delta == HYBRID_DELTA:
        return look
    if delta < HYBRID_DELTA:
        colour = mix(MODES["hierarchical"].colour, look.colour, max(0, delta - 1) / 2)
    else:
        colour = mix(look.colour, MODES["decentralised"].colour, min(1.0, (delta - HYBRID_DELTA) / 8))
    return Look(colour, _DELTA_MARKERS.get(delta, "d"), look.hatch, _DELTA_LINES[delta % len(_DELTA_LINES)])


def shown(name: str) -> str:
    """Return a name as Matplotlib must be given it: a dollar sign starts no mathematics."""
    return name.replace("$", r"\$")


def mix(colour: str, other: str, share: float) -> str:
    """Mix two colours; `share` is the part of `other`, from 0 to 1."""
    red, green, blue = (a + (b - a) * share for a, b in zip(to_rgb(colour), to_rgb(other), strict=True))
    return to_hex((red, green, blue))


@contextmanager
def drawing() -> Iterator[None]:
    """Draw with this style on matplotlib's own defaults, whatever the user's are; then restore everything."""
    with matplotlib.style.context(STYLE, after_reset=True):
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """Make an empty figure, laid out so that nothing overlaps or is cut off."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def add_legend(
    figure: Figure, handles: Sequence[Any], title: str = "", *, columns: int = 3, spacing: Mapping[str, float] = SPACING
) -> None:
    """Put a legend below all panels, in as many columns as fit, and make the figure taller by it."""
    for handle in handles:
        handle.set_label("\n".join(textwrap.wrap(str(handle.get_label()), LETTERS)))
    for count in range(min(columns, len(handles)), 0, -1):
        legend = figure.legend(
            handles=handles,
            title="\n".join(textwrap.wrap(shown(title), LETTERS)) or None,
            loc="outside lower center",
            ncols=count,
            **spacing,
        )
        box = legend.get_window_extent(figure.canvas.get_renderer())  # type: ignore[attr-defined]
        if count == 1 or box.width <= 0.98 * figure.bbox.width:
            break
        legend.remove()
    figure.set_figheight(figure.get_figheight() + box.height / figure.dpi)


def laid_out(figure: Figure, taller_in: float = 0.0) -> Figure:
    """Lay a figure out, made taller if need be, for good: that takes long, and what follows relies on all places.

    Titles and labels that would be cut or lie on others are written in more lines.
    """
    figure.set_figheight(figure.get_figheight() + taller_in)
    with drawing(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "constrained_layout not applied")  # until the texts are narrower
        for _ in range(LAYOUTS):
            figure.set_layout_engine("constrained")
            figure.draw_without_rendering()
            if not (lines := fitting.wrapped(figure)):
                break
            figure.set_figheight(figure.get_figheight() + lines * LINE_IN)
    figure.set_layout_engine("none")
    return figure


CANVASES: Mapping[str, type[FigureCanvasBase]] = {
    "png": FigureCanvasAgg,
    "svg": FigureCanvasSVG,
    "pdf": FigureCanvasPdf,
}
METADATA: Mapping[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": "deltaswarm"},
    "pdf": {"CreationDate": None, "Creator": "deltaswarm"},
}


def rendered(figure: Figure, kind: str) -> bytes:
    """Render a figure as PNG, SVG or PDF; the same figure gives the same bytes.

    The canvas prints directly: `savefig` would draw everything once more beforehand, for its layout.
    """
    stream = io.BytesIO()
    with drawing():
        if isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
            laid_out(figure)
        dpi = figure.dpi
        figure.set_dpi(matplotlib.rcParams["savefig.dpi"])
        try:
            getattr(CANVASES[kind](figure), f"print_{kind}")(stream, metadata=METADATA[kind])
        finally:
            figure.set_dpi(dpi)
            FigureCanvasAgg(figure)
    return stream.getvalue()


def save(figure: Figure, path: Path) -> list[Path]:
    """Write `<path>.png`, `<path>.svg` and `<path>.pdf`."""
    return save_as(partial(rendered, figure), path)


def files_of(path: Path) -> list[Path]:
    return [path.with_name(f"{path.name}.{kind}") for kind in METADATA]  # not with_suffix: a name may hold a dot


def save_as(as_kind: Callable[[str], bytes], path: Path) -> list[Path]:
    """Write the same files for a figure that is rendered elsewhere: `as_kind` returns it as `png`, `svg` or `pdf`."""
    files = files_of(path)
    for file, kind in zip(files, METADATA, strict=True):
        write_whole(file, as_kind(kind))
    return files
