"""The look that all figures share: sizes, type, colours that survive a grey printer, and files that repeat.

No figure touches matplotlib's global state: `drawing()` sets what it needs and puts everything back,
and figures are made without pyplot.
"""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib
import matplotlib.style
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

TEXT_IN = 4.8
"""Width of the paper's text [in]; its figures are as wide, so that nothing is scaled and 8 pt stays 8 pt."""

COLUMN_IN = 3.5
"""Width of a column in a two-column journal [in]."""

DPI = 300
FONT_PT = 8.0

_RC: dict[str, Any] = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": FONT_PT,
    "axes.titlesize": FONT_PT,
    "axes.labelsize": FONT_PT,
    "xtick.labelsize": FONT_PT,
    "ytick.labelsize": FONT_PT,
    "legend.fontsize": FONT_PT,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "lines.linewidth": 1.2,
    "hatch.linewidth": 0.5,
    "patch.linewidth": 0.8,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "axes.formatter.use_mathtext": True,
    "savefig.dpi": DPI,
    "svg.fonttype": "path",
    "svg.hashsalt": "deltaswarm",
}

MIN_LIGHTNESS_STEP = 20.0
"""Least difference in lightness L* (0 black to 100 white) between two control modes, or two looks in a row."""

MIN_LEVEL_LIGHTNESS_STEP = 10.0
"""The same between a level of a tree and the next: order helps, so less will do."""

BLACK, GREY, PALE = "#000000", "#666666", "#d0d0d0"

LEVELS = ("#004488", "#b12a90", "#d6556d", "#f2844b", "#fdb130", "#f7e425")
"""Colours by level in a tree: roots blue as in the paper, then lighter with depth; the last for all deeper ones."""


@dataclass(frozen=True)
class Look:
    """How one variant is drawn, in every figure: each part alone tells it from its neighbours."""

    colour: str
    marker: str
    hatch: str
    line: Literal["-"] | tuple[int, tuple[float, ...]] = "-"

    @property
    def tint(self) -> str:
        """The colour at half strength, for areas on which black must be read."""
        return mix(self.colour, "#ffffff", 0.5)


MODES = {
    "hierarchical": Look("#004488", "s", "////", (0, (5, 1.5))),
    "hybrid": Look("#bb5566", "o", "....", "-"),
    "decentralised": Look("#ddaa33", "^", "", (0, (1, 1))),
}
"""Tol's high-contrast colours, for the colour-blind and for grey; hybrid lies between the other two."""

OTHERS = (
    Look("#56b4e9", "D", r"\\\\", "-"),
    Look("#117733", "v", "xxxx", (0, (4, 1))),
    Look("#332288", "P", "||||", (0, (2, 1))),
    Look("#ddcc77", "X", "----", (0, (6, 2))),
    Look("#888888", "p", "++++", (0, (4, 1, 1, 1))),
)
"""For variants that are no control mode, in their order of appearance."""

HYBRID_DELTA = 3
"""The paper's delta, which has the colour and marker of its mode."""

_DELTA_MARKERS = {2: "D", 4: "v", 5: "P", 6: "X", 7: "<", 8: ">", 9: "p", 10: "h"}
_DELTA_LINES: tuple[Any, ...] = ((0, (3, 1)), (0, (4, 1, 1, 1)), (0, (2, 2)), "-")
_HYBRID = re.compile(r"hybrid\s+(\d+)$")


def delta_of(variant: str) -> int | None:
    """The delta of a variant named "hybrid <delta>"; None for any other."""
    found = _HYBRID.match(variant)
    return int(found[1]) if found else None


def looks(variants: Iterable[str], *, repeat: bool = False) -> dict[str, Look]:
    """The look of each variant of a figure. Modes and deltas look the same in every figure.

    Args:
        variants: in the order in which they are drawn.
        repeat: use looks again when all are used up, for figures that write each variant's name beside it.

    Raises:
        ValueError: more other variants than there are looks that can be told apart.
    """
    found: dict[str, Look] = {}
    others = itertools.cycle(OTHERS) if repeat else iter(OTHERS)
    for variant in variants:
        delta = delta_of(variant)
        look = MODES.get(variant) if delta is None else _of_delta(delta)
        look = look or next(others, None)
        if look is None:
            raise ValueError(f"no look is left for {variant!r}: {len(OTHERS)} variants besides the modes at most")
        found[variant] = look
    return found


def _of_delta(delta: int) -> Look:
    """Between hierarchical and decentralised by delta, as the swarm itself is (delta sensitivity analysis)."""
    hybrid = MODES["hybrid"]
    if delta == HYBRID_DELTA:
        return hybrid
    if delta < HYBRID_DELTA:
        colour = mix(MODES["hierarchical"].colour, hybrid.colour, max(0, delta - 1) / 2)
    else:
        colour = mix(hybrid.colour, MODES["decentralised"].colour, min(1.0, (delta - HYBRID_DELTA) / 8))
    return Look(colour, _DELTA_MARKERS.get(delta, "d"), hybrid.hatch, _DELTA_LINES[delta % len(_DELTA_LINES)])


def shown(variant: str) -> str:
    """A variant's name as it stands in a figure."""
    delta = delta_of(variant)
    return variant.replace("$", r"\$") if delta is None else rf"hybrid $\delta = {delta}$"


def mix(one: str, other: str, share: float) -> str:
    """The colour that lies `share` of the way from one to the other."""
    red, green, blue = (a + (b - a) * share for a, b in zip(to_rgb(one), to_rgb(other), strict=True))
    return to_hex((red, green, blue))


def lightness(colour: str) -> float:
    """CIE lightness L* of a colour, 0 (black) to 100 (white): what is left of it on a grey printer."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return 116 * luminance ** (1 / 3) - 16 if luminance > 216 / 24389 else luminance * 24389 / 27


@contextmanager
def drawing() -> Iterator[None]:
    """Draw with this style on matplotlib's own defaults, whatever the user's are; then put all back."""
    with matplotlib.style.context(_RC, after_reset=True):
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure, laid out so that nothing overlaps or is cut off."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def save(figure: Figure, path: Path) -> list[Path]:
    """Write `<path>.png`, `<path>.svg` and `<path>.pdf`: the same figure gives the same bytes.

    Raises:
        OSError: a file cannot be written.
    """
    metadata: Mapping[str, dict[str, Any]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": "deltaswarm"},
        "pdf": {"CreationDate": None, "Creator": "deltaswarm"},
    }
    files = []
    with drawing():
        for kind, known in metadata.items():
            file = path.with_name(f"{path.name}.{kind}")  # not with_suffix: a name may hold a dot
            figure.savefig(file, format=kind, metadata=known)
            files.append(file)
    return files
