"""What a person at the station is asked: when, and which answers count."""

from random import Random
from typing import Any

import pytest

from deltaswarm_operator.core.probes import Probes
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_scenario.tlx import SCALES
from tests.support.commanding import reloaded


def probes(**settings: Any) -> Probes:
    return Probes(ProbeSettings(**settings), Random(1))


def isa(asked: Probes, number: int, answer: Any, wall_s: float) -> None:
    asked.answer({"type": "isa", "number": number, "answer": answer}, wall_s)


def tlx(asked: Probes, scales: Any, weights: Any, wall_s: float) -> None:
    asked.answer({"type": "tlx", "scales": scales, "weights": weights}, wall_s)


def test_isa_is_asked_at_its_times_and_missing_without_an_answer() -> None:
    """The answer's latency is wall time; an answer to another question is refused."""
    asked = probes(isa_every_s=100, isa_wait_s=30)
    asked.tick(99.0, False, 9.0)
    assert asked.open(9.0) is None
    asked.tick(100.0, False, 10.0)
    assert asked.open(10.0) == {"kind": "isa", "number": 0, "asked_s": 100.0, "left_s": 30.0}
    for number, answer in ((1, 3), (0, 0), (0, 6), (0, 2.0), (0, True), (0, None)):
        with pytest.raises(ValueError, match=r".+"):
            isa(asked, number, answer, 11.0)
    isa(asked, 0, 3, 14.5)
    with pytest.raises(ValueError, match=r".+"):
        isa(asked, 0, 3, 15.0)
    asked.tick(200.0, False, 20.0)
    assert asked.open(49.9)
    assert asked.open(50.0) is None
    asked.tick(300.0, False, 60.0)
    asked.tick(301.0, True, 61.0)
    assert [(row.number, row.value, row.latency_s) for row in asked.rows] == [
        (0, 3, 4.5),
        (1, None, None),
        (2, None, None),
    ]


def test_nasa_tlx_wants_every_scale_and_15_weights() -> None:
    """Once, after the last step."""
    asked = probes(tlx=True, tlx_weights=True, isa_every_s=0)
    scales, weights = dict.fromkeys(SCALES, 50), dict(zip(SCALES, (5, 4, 3, 2, 1, 0), strict=True))
    with pytest.raises(ValueError, match=r".+"):
        tlx(asked, scales, weights, 0.0)
    asked.tick(9.0, True, 5.0)
    wrong_scales: list[Any] = [None, [], {}, {**scales, "x": 1}, {**scales, "effort": 101}, {**scales, "effort": True}]
    wrong_weights: list[Any] = [None, {**weights, "mental": 4}, {**weights, "mental": 6}, {**weights, "mental": 5.0}]
    for wrong in [(one, weights) for one in wrong_scales] + [(scales, one) for one in wrong_weights]:
        with pytest.raises(ValueError, match=r".+"):
            tlx(asked, *wrong, 6.0)
    tlx(asked, scales, weights, 7.0)
    assert [(row.item, row.value, row.latency_s) for row in asked.rows[:2]] == [
        ("mental", 50, 2.0),
        ("physical", 50, 2.0),
    ]
    assert len(asked.rows) == 12
    asked.tick(9.0, True, 8.0)
    assert asked.open(8.0) is None


def test_a_late_question_does_not_bring_on_the_next() -> None:
    """After a form or a slow answer the questions keep their interval, and do not come one after another."""
    asked = probes(isa_every_s=10, isa_wait_s=30)
    asked.tick(10.0, False, 0.0)
    for second in range(11, 60):
        asked.tick(float(second), False, 1.0)
    isa(asked, 0, 3, 2.0)
    times = []
    for second in range(60, 120):
        asked.tick(float(second), False, 3.0)
        if question := asked.open(3.0):
            times.append(question["asked_s"])
            isa(asked, question["number"], 3, 3.0)
    assert times == [60.0, 70.0, 80.0, 90.0, 100.0, 110.0]


def test_a_question_that_was_open_when_the_operator_was_killed_is_missing() -> None:
    """Its row is there, and it is not asked again."""
    killed = probes(isa_every_s=100, isa_wait_s=30)
    killed.tick(100.0, False, 0.0)
    successor = reloaded(killed)
    assert not successor.resume()
    assert [(row.number, row.value, row.asked_s) for row in successor.rows] == [(0, None, 100.0)]
    assert successor.open(1.0) is None
    successor.tick(200.0, False, 100.0)
    assert successor.open(100.0)["number"] == 1


def test_time_in_which_the_run_is_held_does_not_count() -> None:
    """Neither against the answer nor in its latency, however often it is held and whenever the question came."""
    asked = probes(isa_every_s=10, isa_wait_s=30)
    asked.tick(10.0, False, 100.0)
    asked.hold(110.0, is_held=True)
    assert asked.open(500.0) == {"kind": "isa", "number": 0, "asked_s": 10.0, "left_s": 20.0}
    asked.hold(505.0, is_held=True)
    asked.hold(510.0, is_held=False)
    isa(asked, 0, 2, 515.0)
    [row] = asked.rows
    assert (row.latency_s, row.asked_monotonic_s, row.answered_monotonic_s) == (15.0, 100.0, 515.0)
    asked.hold(600.0, is_held=True)
    asked.tick(20.0, False, 610.0)
    asked.hold(620.0, is_held=False)
    assert asked.open(649.0)
    assert asked.open(650.0) is None


def test_every_question_that_was_asked_has_a_row() -> None:
    """Also NASA-TLX that nobody filled in; its scores are there if somebody did."""
    for tlx_weights in (False, True):
        asked = probes(tlx=True, tlx_weights=tlx_weights, isa_every_s=0)
        asked.tick(9.0, True, 5.0)
        asked.close()
        asked.close()
        assert [(row.probe, row.item, row.value) for row in asked.rows] == [("tlx", scale, None) for scale in SCALES]
        assert asked.outcomes == {"questions": 1, "answers_missing": 1, "isa": None, "tlx": None}
    asked = probes(tlx=True, tlx_weights=True, isa_every_s=5)
    asked.tick(5.0, False, 5.0)
    asked.tick(9.0, True, 6.0)
    weights = dict(zip(SCALES, (5, 4, 3, 2, 1, 0), strict=True))
    tlx(asked, dict(zip(SCALES, range(0, 60, 10), strict=True)), weights, 7.0)
    asked.close()
    assert asked.outcomes["tlx"] == {"raw": 25.0, "weighted": pytest.approx((0 + 40 + 60 + 60 + 40) / 15)}
    assert (asked.outcomes["questions"], asked.outcomes["answers_missing"]) == (2, 1)
