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

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_studies import looks, style, swarm
from deltaswarm_studies.drawing import draw
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.kinds import MOST_LOOKS
from deltaswarm_studies.swarm import KINDS, snapshot
from tests.support.studying import FIGURES, OWN, SWEEP, built_in, made, series, table

ROOT = Path(__file__).parents[3]


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


SEEN_BY = {
    "anyone": np.eye(3),
    "protanopes": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopes": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopes": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""Linear RGB as readers see it (Machado, Oliveira and Fernandes 2009, severity 1)."""

TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = TO_XYZ.sum(axis=1)


def lab(colour: str, reader: str) -> np.ndarray:
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    seen = TO_XYZ @ np.clip(SEEN_BY[reader] @ linear, 0, 1) / WHITE
    f = np.where(seen > 216 / 24389, np.cbrt(seen), (24389 / 27 * seen + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def lightness(colour: str) -> float:
    """CIE lightness L* of a colour, 0 (black) to 100 (white): what is left of it on a grey printer."""
    return float(lab(colour, "anyone")[0])


MIN_LIGHTNESS_STEP = 20.0
"""Least difference in lightness L* (0 black to 100 white) between two control modes, or two looks in a row."""

MIN_LEVEL_LIGHTNESS_STEP = 10.0
"""The same between a level of a tree and the next: order helps, so less will do."""


def test_lightness_is_that_of_the_cie() -> None:
    assert lightness("#000000") == pytest.approx(0)
    assert lightness("#ffffff") == pytest.approx(100)
    assert lightness("#777777") == pytest.approx(50.0, abs=0.1)
    assert lightness("#ff0000") == pytest.approx(53.24, abs=0.05)


def test_modes_differ_in_grey() -> None:
    for one, other in itertools.combinations(style.MODES.values(), 2):
        step = abs(lightness(one.colour) - lightness(other.colour))
        assert step >= MIN_LIGHTNESS_STEP


def test_levels_grow_lighter_with_depth() -> None:
    steps = np.diff([lightness(colour) for colour in style.LEVELS])
    assert steps.min() >= MIN_LEVEL_LIGHTNESS_STEP
    red, green, blue = (int(style.LEVELS[0][i : i + 2], 16) for i in (1, 3, 5))
    assert blue > 1.5 * max(red, green)


def test_other_looks_differ_from_the_next_in_grey() -> None:
    steps = np.abs(np.diff([lightness(colour) for colour in style.COLOURS]))
    assert steps.min() >= MIN_LIGHTNESS_STEP


MIN_DIFFERENCE = 15.0
"""Least difference (CIE76) between two colours as a colour-blind reader sees them; about 2 is just noticeable."""


@pytest.mark.parametrize("reader", SEEN_BY)
def test_colours_differ_for_colour_blind_readers(reader: str) -> None:
    colours = [*(look.colour for look in style.MODES.values()), *style.COLOURS]
    for one, other in itertools.combinations(colours, 2):
        assert np.linalg.norm(lab(one, reader) - lab(other, reader)) >= MIN_DIFFERENCE, (one, other)


def test_tints_leave_black_readable() -> None:
    looks = [*style.MODES.values(), *itertools.islice(style.others(), len(style.COLOURS))]
    assert min(lightness(look.tint) for look in looks) >= 50


def test_modes_differ_in_marker_hatch_and_line() -> None:
    for part in ("marker", "hatch", "line"):
        values = [getattr(look, part) for look in style.MODES.values()]
        assert len(set(values)) == len(values), part


def test_no_two_looks_of_a_figure_are_alike() -> None:
    """As many as a figure may have: neither as points, nor as lines, nor as boxes, also beside modes and deltas."""
    looks = [*style.MODES.values(), *map(style.hybrid, (2, 4, 5)), *itertools.islice(style.others(), MOST_LOOKS)]
    for part in ("marker", "line", "hatch"):
        seen = [(look.colour, getattr(look, part)) for look in looks]
        assert len(set(seen)) == len(seen), part


def test_all_deltas_have_markers_of_their_own() -> None:
    """In one figure with both other modes; delta 3 has the look of its mode."""
    found = {delta: style.hybrid(delta) for delta in range(2, 11)}
    markers = [look.marker for look in (*found.values(), style.MODES["hierarchical"], style.MODES["decentralised"])]
    assert len(set(markers)) == len(markers)
    assert found[3] == style.MODES["hybrid"]
    assert all(one.line != other.line for one, other in itertools.pairwise(found.values()))


def test_deltas_lie_between_the_modes_in_lightness() -> None:
    """The higher, the closer to decentralised, as in the swarm itself."""
    ends = style.MODES["hierarchical"], style.MODES["decentralised"]
    levels = [lightness(look.colour) for look in (ends[0], *map(style.hybrid, range(2, 11)), ends[1])]
    assert levels == sorted(levels)
    assert len(set(levels)) == len(levels)


def test_a_control_has_its_look_whatever_it_is_called() -> None:
    """By the scenario: a level called "hybrid 3" whose delta is 5 looks like delta 5, in levels, variants and paths."""
    study = made(
        OWN, SWEEP.replace('["decentralised", "hybrid"]', '["decentralised", "hybrid"]\ncontrol.delta = [3, 5]')
    )
    assert looks.of_levels(study, "mode") == {
        "decentralised": style.MODES["decentralised"],
        "hybrid 3": style.hybrid(5),
    }
    names = {f"loss={loss}": [f"loss={loss}, hybrid 3"] for loss in (0.0, 0.5, 0.9)}
    assert looks.of_groups(study, {"hybrid 3": names["loss=0.0"]}) == {"hybrid 3": style.hybrid(5)}
    alike = looks.of_groups(study, names)
    assert len(set(alike.values())) == 3
    assert alike["loss=0.0"] == style.hybrid(5)


def test_a_path_through_one_mode_has_the_look_of_the_mode() -> None:
    study = built_in("paper")
    deltas = [f"hybrid {delta}" for delta in range(4, 8)]
    found = looks.of_groups(study, {"a": deltas, "b": ["rho 4", "rho 5"], "c": ["adaptive"]}, are_paths=True)
    assert [found["a"], found["b"]] == [style.MODES["hybrid"], style.MODES["hierarchical"]]
    assert found["c"] == looks.of_levels(study, "condition")["adaptive"]


def test_agents_of_different_kinds_differ_without_colour() -> None:
    for one, other in itertools.combinations(KINDS, 2):
        apart = abs(lightness(one.markerfacecolor) - lightness(other.markerfacecolor))
        assert one.marker != other.marker or apart >= MIN_LEVEL_LIGHTNESS_STEP, (one.label, other.label)


def test_a_name_is_shown_as_it_is() -> None:
    """A dollar sign starts no mathematics, and no parameter is read out of a name."""
    assert style.shown("hybrid 10") == "hybrid 10"
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
    before = dict(matplotlib.rcParams)
    style.save(drawn(), tmp_path / "figure")
    assert dict(matplotlib.rcParams) == before


def draw_all(folder: Path) -> None:
    study = made(OWN + FIGURES)
    evidence = Evidence.of_sweep(study, table(), series(lambda *_: 20.0))
    figures = [
        *(draw(one, study, evidence).figure for one in study.file.figure),
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
    assert len(files) == 21
    for name in files:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name
