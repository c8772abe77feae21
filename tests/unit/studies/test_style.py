"""The figures' shared look: told apart without colour, files that repeat, nothing of matplotlib's left changed."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from benchmarks import plots as benchmarks
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_studies import style, swarm
from deltaswarm_studies.drawing import draw
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.swarm import KINDS, snapshot
from tests.support.studying import OWN, made, series, table

ROOT = Path(__file__).parents[3]

FIGURES = """
[[figure]]
name = "boxes"
x = "mode"
hue = "loss"

[[figure]]
name = "levels"
kind = "levels"
x = "loss"
hue = "mode"

[[figure]]
name = "time"
kind = "time"
metric = "waiting_all"
hue = "mode"
facet = "loss"
spans = [{ text = "fault", from_s = 100.0, until_s = 300.0 }]

[[figure]]
name = "plane"
kind = "plane"
x = "waiting"
metric = "messages"
hue = "mode"
path = ["loss=0.0, hybrid 3", "loss=0.5, hybrid 3"]
"""


def drawn() -> Figure:
    """A figure with all that could differ from time to time: clips, markers, hatches, an image, mathematics."""
    with style.drawing():
        figure = style.new_figure(3, 2)
        axes = figure.add_subplot()
        axes.imshow(np.arange(12.0).reshape(3, 4))
        axes.bar([0, 1], [1, 2], hatch="//")
        axes.plot([0, 1, 2], [0, 2, 1], marker="o", label=r"$\delta = 3$")
        axes.legend()
    return figure


MIN_LIGHTNESS_STEP = 20.0
"""Least difference in lightness L* (0 black to 100 white) between two control modes, or two looks in a row."""

MIN_LEVEL_LIGHTNESS_STEP = 10.0
"""The same between a level of a tree and the next: order helps, so less will do."""


def lightness(colour: str) -> float:
    """CIE lightness L* of a colour, 0 (black) to 100 (white): what is left of it on a grey printer."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return 116 * luminance ** (1 / 3) - 16 if luminance > 216 / 24389 else luminance * 24389 / 27


def test_lightness_is_that_of_the_cie() -> None:
    """Known values: black, white, middle grey, and pure red."""
    assert lightness("#000000") == pytest.approx(0)
    assert lightness("#ffffff") == pytest.approx(100)
    assert lightness("#777777") == pytest.approx(50.0, abs=0.1)
    assert lightness("#ff0000") == pytest.approx(53.24, abs=0.05)


def test_modes_differ_in_grey() -> None:
    """Every pair of control modes, by at least the stated step."""
    for one, other in itertools.combinations(style.MODES.values(), 2):
        step = abs(lightness(one.colour) - lightness(other.colour))
        assert step >= MIN_LIGHTNESS_STEP


def test_levels_grow_lighter_with_depth() -> None:
    """Each by at least the stated step, from the blue of the roots."""
    steps = np.diff([lightness(colour) for colour in style.LEVELS])
    assert steps.min() >= MIN_LEVEL_LIGHTNESS_STEP
    red, green, blue = (int(style.LEVELS[0][i : i + 2], 16) for i in (1, 3, 5))
    assert blue > 1.5 * max(red, green)


def test_other_looks_differ_from_the_next_in_grey() -> None:
    """And the ablation's boxes, hybrid and decentralised among them, side by side."""
    others = [look.colour for look in style.OTHERS]
    ablation = style.looks(["hybrid 3", "no recruitment", "no dissolution", "decentralised"])
    for colours in (others, [look.colour for look in ablation.values()]):
        steps = np.abs(np.diff([lightness(colour) for colour in colours]))
        assert steps.min() >= MIN_LIGHTNESS_STEP


def test_tints_leave_black_readable() -> None:
    """The median is drawn in black on the tint."""
    looks = [*style.MODES.values(), *style.OTHERS]
    assert min(lightness(look.tint) for look in looks) >= 50


def test_modes_and_others_differ_in_marker_hatch_and_line() -> None:
    """Where colour and lightness fail, each of these alone tells them apart."""
    for looks in (style.MODES.values(), style.OTHERS):
        for part in ("marker", "hatch", "line"):
            values = [getattr(look, part) for look in looks]
            assert len(set(values)) == len(values), part


def test_all_deltas_have_markers_of_their_own() -> None:
    """In one figure with both other modes; delta 3 has the look of its mode, wherever it stands."""
    found = style.looks(["decentralised", "hierarchical", *(f"hybrid {delta}" for delta in range(2, 11))])
    assert len({look.marker for look in found.values()}) == len(found)
    assert found["hybrid 3"] == style.MODES["hybrid"]
    assert style.looks(["hybrid 3"]) == {"hybrid 3": found["hybrid 3"]}
    lines = [found[f"hybrid {delta}"].line for delta in range(2, 11)]
    assert all(one != other for one, other in itertools.pairwise(lines))


def test_deltas_lie_between_the_modes_in_lightness() -> None:
    """The higher, the closer to decentralised, as in the swarm itself."""
    found = style.looks(["hierarchical", *(f"hybrid {delta}" for delta in range(2, 11)), "decentralised"])
    levels = [lightness(look.colour) for look in found.values()]
    assert levels == sorted(levels)
    assert len(set(levels)) == len(levels)


def test_too_many_variants_are_named() -> None:
    """Rather than drawn alike."""
    with pytest.raises(ValueError, match="variant 5"):
        style.looks(f"variant {i}" for i in range(len(style.OTHERS) + 1))


def test_looks_repeat_where_names_stand_beside() -> None:
    """In their order, from the first."""
    found = list(style.looks((f"variant {i}" for i in range(len(style.OTHERS) + 1)), repeat=True).values())
    assert found == [*style.OTHERS, style.OTHERS[0]]


def test_agents_of_different_kinds_differ_without_colour() -> None:
    """By marker, or, for the levels, which share one, by lightness."""
    for one, other in itertools.combinations(KINDS, 2):
        apart = abs(lightness(one.markerfacecolor) - lightness(other.markerfacecolor))
        assert one.marker != other.marker or apart >= MIN_LEVEL_LIGHTNESS_STEP, (one.label, other.label)


def test_names_are_written_out() -> None:
    """Delta as mathematics; a dollar sign of a name starts none."""
    assert style.shown("hybrid 10") == r"hybrid $\delta = 10$"
    assert style.shown("no recruitment") == "no recruitment"
    assert style.shown("5 $ each") == r"5 \$ each"


def test_the_same_figure_gives_the_same_bytes(tmp_path: Path) -> None:
    """Made and saved twice, the second time under a user's own settings of matplotlib."""
    first = style.save(drawn(), tmp_path / "first")
    with matplotlib.rc_context({"font.size": 30, "savefig.dpi": 50, "svg.hashsalt": "mine", "axes.facecolor": "red"}):
        second = style.save(drawn(), tmp_path / "second")
    assert [file.name for file in first] == ["first.png", "first.svg", "first.pdf"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_files_hold_no_date_and_enough_dots(tmp_path: Path) -> None:
    """No date in the SVG; the PNG is as wide in pixels as its inches say. A dot in a name stays."""
    png, svg, _ = style.save(drawn(), tmp_path / "loss-0.3")
    assert (png.name, svg.name) == ("loss-0.3.png", "loss-0.3.svg")
    assert "dc:date" not in svg.read_text()
    width = int.from_bytes(png.read_bytes()[16:20], "big")
    assert width == 3 * 300


def test_matplotlib_is_left_as_it_was(tmp_path: Path) -> None:
    """Its settings do not change."""
    before = dict(matplotlib.rcParams)
    style.save(drawn(), tmp_path / "figure")
    assert dict(matplotlib.rcParams) == before


def draw_all(folder: Path) -> None:
    """Save a figure of each kind."""
    study = made(OWN + FIGURES)
    evidence = Evidence.of_sweep(study, table(), series(lambda *_: 20.0))
    figures = [
        *(draw(one, study, evidence).figure for one in study.file.figure),
        benchmarks.scale([{"agents": n, "steps_per_s": 1000 / n, "peak_memory_mb": n} for n in (10, 100)]),
        swarm.swarm({"hybrid 3": snapshot(load_scenario("smoke"), 50)}),
    ]
    for place, figure in enumerate(figures):
        style.save(figure, folder / str(place))


WITHOUT_PYPLOT = """
import sys
from pathlib import Path
from tests.unit.studies.test_style import draw_all
draw_all(Path(sys.argv[1]))
assert "matplotlib.pyplot" not in sys.modules
"""


@pytest.mark.slow
def test_all_figures_repeat_in_another_process_without_pyplot(tmp_path: Path) -> None:
    """Another hash seed, the same bytes; pyplot, which would look for a display, is never loaded."""
    folders = [tmp_path / "first", tmp_path / "second"]
    for folder in folders:
        folder.mkdir()
    draw_all(folders[0])
    seed = "1" if os.environ.get("PYTHONHASHSEED") == "2" else "2"
    command = [sys.executable, "-c", WITHOUT_PYPLOT, str(folders[1])]
    environment = {**os.environ, "PYTHONHASHSEED": seed}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    files = sorted(file.name for file in folders[0].iterdir())
    assert len(files) == 18
    for name in files:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name
