"""Figures of a study file that would say what is not so, or cannot be drawn, are refused before the runs."""

import tomllib

import pytest

from deltaswarm_orchestrator.sweeps.load import make_sweep
from deltaswarm_studies.load import MAIN, bare_study
from deltaswarm_studies.metrics import BUILT_IN
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import OWN, SWEEP, made, table


@pytest.mark.parametrize("name", ["", "..", "../page", "/tmp/x", "a/b", "a\\u0000", "x" * 300])
def test_a_figures_name_stays_in_its_folder(name: str) -> None:
    with pytest.raises(SettingsError, match=r"figure\[0\]\.name.*must be a file's name"):
        made(f'{OWN}[[figure]]\nname = "{name}"\nmetric = "messages"\nx = "loss"\n')


FAULT_AT_500 = """
[[sweep.paired]]
label = ["whole", "a third lost"]
fault = [[], [{ kind = "kill", agents = [1, 2, 3], at_s = 500.0 }]]
"""
SPAN = (
    OWN.replace('mode = "control"', 'mode = "control", lost = "agents"')
    + '[[figure]]\nname = "f"\nkind = "time"\nmetric = "trees"\nhue = "mode"\nfacet = "lost"\n'
    'variants = ["loss=0.0, decentralised, whole", "loss=0.0, decentralised, a third lost"]\n'
    'spans = [{ text = "agents lost", from_s = 500.0 }]\n'
)


def test_a_span_is_refused_where_nothing_happens() -> None:
    """It would say in the panel of the whole swarm that agents are lost; in its own panel, and everywhere, it may."""
    with pytest.raises(SettingsError, match=r"spans\[0\]\.levels must be 'a third lost'.*nothing happens in 'whole'"):
        made(SPAN, SWEEP + FAULT_AT_500)
    assert made(SPAN.replace("500.0 }]", '500.0, levels = ["a third lost"] }]'), SWEEP + FAULT_AT_500)
    assert made(SPAN.replace("from_s = 500.0", "from_s = 600.0"), SWEEP + FAULT_AT_500)  # the reader's own mark


def test_more_colours_than_can_be_told_apart_are_refused() -> None:
    rates = ", ".join(str(index / 20) for index in range(1, 14))
    sweep = SWEEP.replace("[0.0, 0.5, 0.9]", f"[{rates}]")
    figure = '[[figure]]\nname = "f"\nx = "{}"\nhue = "{}"\n'
    with pytest.raises(SettingsError, match=r"figure\[0\]\.hue must be at most 12.*got 13 to tell apart"):
        made(OWN + figure.format("mode", "loss"), sweep)
    assert made(OWN + figure.format("loss", "mode"), sweep)


def test_a_report_of_any_sweep_draws_what_it_can_tell_apart() -> None:
    """Of three factors, the third is held over time; fourteen numbers stand along the axis and are no colours."""
    three = SWEEP.replace("[sweep.axes]\n", "[sweep.axes]\nradio.range_m = [7.0, 9.0]\n")
    study = bare_study(make_sweep(tomllib.loads(three)), table(), has_series=True)
    assert study.factor_title("range_m") == "range [m]"
    [course] = [figure for figure in study.file.figure if figure.kind == "time"]
    assert {study.levels[name]["mode"] for name in course.variants} == {"decentralised"}
    assert course.caption == "Agents in trees over time, mode: decentralised."
    many = SWEEP.replace("[0.0, 0.5, 0.9]", str([place / 20 for place in range(14)]))
    study = bare_study(make_sweep(tomllib.loads(many)), table(), has_series=True)
    assert {(figure.kind, figure.x, figure.hue) for figure in study.file.figure} == {("levels", "loss", "mode")}


@pytest.mark.parametrize(
    ("scenario", "axis", "lost"),
    [
        ("events.work_agent_s = 5000.0", "", "until an event is complete, compared by loss; "),
        ("", "metrics.horizon_s = [50.0, 100.0]", "until an event is complete, compared by"),
        ("metrics.horizon_s = 100.0", "run.step_s = [0.5, 1.0]", "Radio frames sent, compared by"),
    ],
)
def test_a_report_leaves_out_by_name_what_its_runs_cannot_show(scenario: str, axis: str, lost: str) -> None:
    """After all runs nothing is refused that nobody named: the page has the rest, and a line says what it lacks."""
    swept = SWEEP.replace("metrics.horizon_s = 100.0", scenario).replace("[sweep.axes]\n", f"[sweep.axes]\n{axis}\n")
    columns = {BUILT_IN[name].column: 5.0 for name in MAIN}
    study = bare_study(make_sweep(tomllib.loads(swept)), table().assign(**columns), has_series=True)
    assert any(line.startswith("Left out: ") and lost in line for line in study.left_out), study.left_out
    assert {contrast.factor for contrast in study.file.contrast} == study.factors.keys()
    assert {"waiting", "messages"} <= {figure.metric for figure in study.file.figure}
