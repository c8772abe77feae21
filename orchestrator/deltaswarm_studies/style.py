"""The look that all figures share: sizes, type, colours that survive a grey printer, and reproducible files.

No figure touches matplotlib's global state: `drawing()` sets what it needs and restores everything, and figures are
made without pyplot.
"""

import io
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import matplotlib.style
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

TEXT_IN = 4.8
"""Width of the paper's text [in]. The figures are as wide, so that nothing is scaled and 8 pt stays 8 pt."""

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

OTHERS = (
    Look("#56b4e9", "D", r"\\\\", "-"),
    Look("#117733", "v", "xxxx", (0, (4, 1))),
    Look("#332288", "P", "||||", (0, (2, 1))),
    Look("#ddcc77", "X", "----", (0, (6, 2))),
    Look("#888888", "p", "++++", (0, (4, 1, 1, 1))),
)
"""Looks for variants that are not control modes, in order of appearance."""

HYBRID_DELTA = 3
"""The paper's delta, which has the look of the hybrid mode itself."""

_DELTA_MARKERS = {2: "D", 4: "v", 5: "P", 6: "X", 7: "<", 8: ">", 9: "p", 10: "h"}
_DELTA_LINES: tuple[Any, ...] = ((0, (3, 1)), (0, (4, 1, 1, 1)), (0, (2, 2)), "-")
_HYBRID = re.compile(r"hybrid\s+(\d+)$")


def delta_of(variant: str) -> int | None:
    """Return the delta of a variant named "hybrid <delta>"; None for any other."""
    match = _HYBRID.match(variant)
    return int(match[1]) if match else None


def looks(variants: Iterable[str], *, repeat: bool = False) -> dict[str, Look]:
    """Choose the look of each variant of a figure. Modes and deltas look the same in every figure.

    Args:
        variants: in the order in which they are drawn.
        repeat: reuse looks when all are used up, for figures that write each variant's name beside it.

    Raises:
        ValueError: there are more variants besides the modes than distinguishable looks.
    """
    chosen: dict[str, Look] = {}
    others = itertools.cycle(OTHERS) if repeat else iter(OTHERS)
    for variant in variants:
        delta = delta_of(variant)
        look = (MODES.get(variant) if delta is None else _of_delta(delta)) or next(others, None)
        if look is None:
            raise ValueError(f"no look is left for {variant!r}: {len(OTHERS)} variants besides the modes at most")
        chosen[variant] = look
    return chosen


def _of_delta(delta: int) -> Look:
    """Choose a look between hierarchical and decentralised by delta, like the swarm (delta sensitivity analysis)."""
    hybrid = MODES["hybrid"]
    if delta == HYBRID_DELTA:
        return hybrid
    if delta < HYBRID_DELTA:
        colour = mix(MODES["hierarchical"].colour, hybrid.colour, max(0, delta - 1) / 2)
    else:
        colour = mix(hybrid.colour, MODES["decentralised"].colour, min(1.0, (delta - HYBRID_DELTA) / 8))
    return Look(colour, _DELTA_MARKERS.get(delta, "d"), hybrid.hatch, _DELTA_LINES[delta % len(_DELTA_LINES)])


def shown(variant: str) -> str:
    """Return a variant's name as figures show it."""
    delta = delta_of(variant)
    return variant.replace("$", r"\$") if delta is None else rf"hybrid $\delta = {delta}$"


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
    return Figure(figsize=(width_in, height_in), layout="constrained")


METADATA: Mapping[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": "deltaswarm"},
    "pdf": {"CreationDate": None, "Creator": "deltaswarm"},
}


def rendered(figure: Figure, kind: str) -> bytes:
    """Render a figure as PNG, SVG or PDF; the same figure gives the same bytes."""
    stream = io.BytesIO()
    with drawing():
        figure.savefig(stream, format=kind, metadata=METADATA[kind])
    return stream.getvalue()


def save(figure: Figure, path: Path) -> list[Path]:
    """Write `<path>.png`, `<path>.svg` and `<path>.pdf`.

    Raises:
        OSError: a file cannot be written.
    """
    return save_as(partial(rendered, figure), path)


def files_of(path: Path) -> list[Path]:
    """Return the files of a figure: `<path>.png`, `<path>.svg` and `<path>.pdf`.

    Raises:
        ValueError: the path has no last part.
    """
    return [path.with_name(f"{path.name}.{kind}") for kind in METADATA]  # not with_suffix: a name may hold a dot


def save_as(as_kind: Callable[[str], bytes], path: Path) -> list[Path]:
    """Write the same files for a figure that is rendered elsewhere: `as_kind` returns it as `png`, `svg` or `pdf`."""
    files = files_of(path)
    for file, kind in zip(files, METADATA, strict=True):
        file.write_bytes(as_kind(kind))
    return files
