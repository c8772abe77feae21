"""Figures of every kind with long names: whole, apart, and with room for what they show."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from deltaswarm_studies import style
from deltaswarm_studies.drawing import draw
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.sensitivity_page import matrix, turning
from tests.support.drawn_studies import CLAIMED, DRAWN, found, noise, rate
from tests.support.studying import made

LONG = "a swarm whose thresholds were chosen by hand long ago number"
RADIOS = ("some kind of radio that is described at some length", "another one")
FIGURES = {
    "boxes": 'x = "radio"\nfacet = "who"\nmetric = "waiting_all"',
    "boxes, x": 'x = "who"\nhue = "radio"\nmetric = "waiting_all"',
    "boxes, hue": 'x = "radio"\nhue = "who"\nmetric = "waiting_all"',
    "levels": 'x = "who"\nfacet = "radio"\nmetric = "told_worst_tenth"',
    "time": 'metric = "agents_in_trees"\nhue = "radio"\nfacet = "who"\n'
    'spans = [{ text = "all of the many agents are lost here", from_s = 500.0 }]',
    "plane": 'x = "told_s"\nmetric = "messages"\nhue = "radio"\nfacet = "who"',
    "frontier": f'x = "told_s"\nmetric = "messages"\nfacet = "radio"\npaths = {{ "all of {LONG}" = VARIANTS }}',
    "survival": 'metric = "told_s"\nhue = "radio"\nfacet = "who"',
    "rings": 'metric = "told_s"\nhue = "radio"\nfacet = "who"\nrings = 2',
    "swarm": "at_s = 5.0\nvariants = VARIANTS",
}


class Shown(NamedTuple):
    what: str
    axes: Axes | None
    box: Bbox


def figure_of(name: str, count: int) -> Figure:
    levels = [f"{LONG} {place}" for place in range(count)]
    variants = [f"{level}, {radio}" for level in levels for radio in RADIOS]
    sweep = (
        'schema = 1\nname = "made-up"\nbase = "smoke"\nscenario.run.duration_s = 1000.0\n'
        "scenario.metrics.horizon_s = 100.0\n[sweep]\nrepeats = 8\nseries_every_s = 100.0\n"
        f"[[sweep.paired]]\nlabel = {levels}\ncontrol.delta = {[*range(1, count + 1)]}\n"
        f"[[sweep.paired]]\nlabel = {[*RADIOS]}\nradio.loss = [0.0, 0.1]\n"
    )
    drawn = FIGURES[name].replace("VARIANTS", str(variants[:count] if name == "swarm" else variants))
    own = (
        '[study]\nfactors = { who = "the kind of control that was chosen for these runs of the study", radio = '
        '"what the radio of all the robots is like during the run" }\nmetrics = ["waiting_all", "messages"]\n'
        f'window_s = 100.0\n[[figure]]\nname = "f"\nkind = "{name.partition(",")[0]}"\n{drawn}\n'
    )
    study = made(own, sweep)
    ids = [
        {"variant": name, "replicate": replicate, "seed": 100 + replicate}
        for name in variants
        for replicate in range(8)
    ]
    columns = [metric.column for metric in study.metrics.values() if metric.column]
    series = [metric.series for metric in study.over_time.values()]
    runs = pd.DataFrame([row | dict.fromkeys(columns, 20.0 + place % 37) for place, row in enumerate(ids)])
    windows = [row | {"time_s": 100.0 * place, "events_followed": 5.0} for row in ids for place in range(10)]
    courses = pd.DataFrame([row | dict.fromkeys(series, float(place % 10)) for place, row in enumerate(windows)])
    waits = {"x_m": 0.0, "y_m": 0.0, "arrived_s": 0.0, "sensed_s": 1.0, "worked_s": math.nan, "completed_s": math.nan}
    events = [
        row | waits | {"event": place, "from_densest_m": place + 1.0, "end_s": 1000.0, "told_s": 20.0 + place}
        for row in ids
        for place in range(4)
    ]
    evidence = Evidence.of_sweep(study, runs, courses, (), pd.DataFrame(events))
    return draw(study.file.figure[0], study, evidence).figure


def shown_in(figure: Figure) -> Iterator[Shown]:
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    for axes in filter(Axes.get_visible, figure.axes):
        around = {"title": axes.title, "label": axes.xaxis.label, "label up": axes.yaxis.label}
        for what, text in (*around.items(), *(("text", text) for text in axes.texts)):
            if text.get_text():
                yield Shown(what, axes, text.get_window_extent(renderer))
        for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            for tick in axis.get_major_ticks():
                if tick.label1.get_visible() and min(ends) <= tick.get_loc() <= max(ends):
                    yield Shown("tick", axes, tick.label1.get_window_extent(renderer))
    yield from (Shown("legend", None, legend.get_window_extent(renderer)) for legend in figure.legends)


def overlap(one: Bbox, other: Bbox) -> bool:
    common = Bbox.intersection(one, other)
    return common is not None and common.width > 0 and common.height > 0


def assert_whole_and_apart(figure: Figure) -> None:
    style.rendered(figure, "svg")  # lays it out
    with style.drawing():
        figure.draw_without_rendering()
    shown, page = list(shown_in(figure)), figure.bbox.padded(1.0)
    panels = [axes for axes in figure.axes if axes.get_visible() and axes.get_label() != "<colorbar>"]
    assert [each for each in shown if Bbox.union([page, each.box]).bounds != page.bounds] == [], "cut off"
    large = [each for each in shown if each.what != "tick"]
    for one, other in itertools.chain(
        itertools.combinations(large, 2), ((one, tick) for tick in shown if tick.what == "tick" for one in large)
    ):
        assert not overlap(one.box, other.box), (one, other)
    for each, axes in itertools.product(large, panels):
        assert (each.what == "text" and each.axes is axes) or not overlap(each.box, axes.bbox), (each, axes)
    assert min(min(axes.bbox.width, axes.bbox.height) for axes in panels) > 0.5 * figure.dpi, "no room is left"


@pytest.mark.parametrize("count", [4, *(pytest.param(count, marks=pytest.mark.slow) for count in (2, 7, 12))])
@pytest.mark.parametrize("name", FIGURES)
def test_long_names_are_whole_and_apart(name: str, count: int) -> None:
    assert {name.partition(",")[0] for name in FIGURES} == KINDS.keys()
    assert_whole_and_apart(figure_of(name, count))


def test_long_names_of_a_sensitivity_study() -> None:
    sweep = DRAWN.replace("Event rate", f"{LONG} one").replace("Radio range", f"{LONG} two")
    study, evidence = found(
        lambda values, number: math.exp(2 * rate(values) - 1) * noise(number),
        CLAIMED.replace("Trees report less", LONG),
        sweep.replace("the nearest", LONG),
    )
    result = evidence.sensitivity
    assert result
    for figure in (
        matrix(study, result),
        *(turning(study, result, study.file.claim[0], result.features[i : i + 2]) for i in (0, 2)),
    ):
        assert_whole_and_apart(figure)
