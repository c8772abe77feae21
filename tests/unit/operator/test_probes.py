"""What a person at the station is asked: when, and which answers count."""

from random import Random
from typing import Any

import pytest

from deltaswarm_operator.core.probes import Probes
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.questions import FormSettings, QuestionSettings
from deltaswarm_scenario.technique import Seen
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_scenario.tlx import SCALES
from tests.support.commanding import reloaded
from tests.support.tiers import in_one_test


def probes(**settings: Any) -> Probes:
    return Probes(ProbeSettings(**settings), Random(1))


def isa(asked: Probes, number: int, answer: Any, wall_s: float) -> None:
    asked.answer({"type": "isa", "number": number, "answer": answer}, wall_s)


def tlx(asked: Probes, scales: Any, weights: Any, wall_s: float) -> None:
    asked.answer({"type": "tlx", "scales": scales, "weights": weights}, wall_s)


def test_a_simulated_person_is_asked_what_it_answers() -> None:
    """A consent that nobody gives would keep all other questions waiting."""
    settings: dict[str, Any] = {"isa_every_s": 100, "consent": "Yes?", "form": (FormSettings("you", when="before"),)}
    simulated, real = probes(**settings), probes(**settings)
    simulated.start(0.0, is_simulated=True)
    real.start(0.0)
    assert simulated.open(0.0) is None
    assert real.is_sheet_open


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
        outcomes = asked.outcomes
        assert outcomes == {**outcomes, "questions": 1, "answers_missing": 1, "isa": None, "tlx": None}
    asked = probes(tlx=True, tlx_weights=True, isa_every_s=5)
    asked.tick(5.0, False, 5.0)
    asked.tick(9.0, True, 6.0)
    weights = dict(zip(SCALES, (5, 4, 3, 2, 1, 0), strict=True))
    tlx(asked, dict(zip(SCALES, range(0, 60, 10), strict=True)), weights, 7.0)
    asked.close()
    assert asked.outcomes["tlx"] == {"raw": 25.0, "weighted": pytest.approx((0 + 40 + 60 + 60 + 40) / 15)}
    assert counts(asked) == (2, 0, 1)


def counts(asked: Probes) -> tuple[int, int, int]:
    """Numbers of questions that were asked, that the person missed, and that were not asked or cut off."""
    return tuple(asked.outcomes[name] for name in ("questions", "answers_missing", "questions_lost"))  # type: ignore[return-value]


BEFORE = FormSettings("you", when="before", question=(QuestionSettings("age", "Age?", "number", 18.0, 99.0),))
READ = FormSettings("read", text="Read this.", when="before")
AFTER = FormSettings("end", question=(QuestionSettings("trust", "Trust?"),))
ALL = {
    "consent": "Yes?",
    "form": (BEFORE, READ, AFTER),
    "sagat_at_s": (20.0,),
    "sagat_questions": ("trees",),
    "spam_at_s": (20.0, 30.0),
    "spam_questions": ("trees",),
    "spam_ready": False,
    "isa_every_s": 20.0,
    "isa_wait_s": 10.0,
    "tlx": True,
}


def told(rows: list[ProbeRow]) -> list[tuple[Any, ...]]:
    return [(row.probe, row.number, row.item, row.value, row.asked_s, row.latency_s) for row in rows]


def test_a_whole_run_asks_in_order() -> None:
    """The sheet and forms before it, those about a moment in their order of precedence, NASA-TLX and forms after it."""
    asked = probes(**ALL)
    asked.start(1.0)
    assert asked.is_sheet_open
    assert asked.holds_run
    assert told(list(asked.opened)) == []
    assert asked.answer({"type": "sheet"}, 2.0) == ({}, True)
    assert not asked.is_sheet_open
    assert asked.open(2.0)["form"]["name"] == "you"
    assert asked.answer({"type": "form", "form": "you", "answers": {"age": 30}}, 3.23456) == ({"name": "you"}, True)
    assert asked.answer({"type": "form", "form": "read", "answers": {}}, 4.0) == ({"name": "read"}, True)
    assert not asked.holds_run
    assert told(asked.take_rows()) == [("you", 0, "age", 30, 0.0, 1.235)]
    assert asked.take_rows() == []
    assert asked.next_hold_s == 20.0
    attended = {"is_attended": True, "is_held": True}
    asked.tick(19.9, False, 5.0, **attended)
    assert asked.open(5.0) is None
    asked.tick(20.0, False, 6.0, **attended)
    assert asked.next_hold_s is None
    assert asked.open(6.0)["form"]["name"] == "sagat"
    asked.tick(21.0, False, 6.5, **attended)
    assert asked.answer({"type": "form", "form": "sagat", "answers": {"trees": 2}}, 7.0) == ({"name": "sagat"}, True)
    assert asked.open(7.0) is None
    asked.tick(22.0, False, 8.0, **attended)
    assert asked.open(8.0)["form"]["name"] == "spam"
    assert not asked.holds_run
    asked.tick(40.0, False, 9.0, **attended)
    assert asked.answer({"type": "form", "form": "spam", "answers": {"trees": 1}}, 9.0) == ({"name": "spam"}, False)
    asked.tick(41.0, False, 10.0, **attended)
    assert asked.open(10.0)["form"]["name"] == "spam"
    asked.tick(42.0, True, 11.0, **attended)
    asked.tick(42.0, True, 11.0, **attended)
    assert asked.open(11.0)["kind"] == "tlx"
    assert not asked.holds_run
    asked.close()
    assert told(asked.take_rows()) == [
        ("sagat", 0, "trees", 2, 20.0, 1.0),
        ("isa", 0, "isa", None, None, None),
        ("spam", 0, "trees", 1, 22.0, 1.0),
        ("spam", 1, "trees", None, 41.0, None),
        ("isa", 1, "isa", None, None, None),
        *[("tlx", 0, scale, None, 42.0, None) for scale in SCALES],
        ("end", 0, "trust", None, 42.0, None),
    ]
    assert counts(asked) == (6, 2, 3)


@in_one_test(
    ("name", "is_attended", "is_held", "kind"),
    [
        ("sagat", True, True, "form"),
        ("sagat", True, False, None),
        ("sagat", False, True, None),
        ("spam", True, False, "form"),
        ("spam", False, False, None),
        ("isa", False, False, "isa"),
        ("isa", True, True, "isa"),
    ],
)
def test_whom_a_question_is_asked(name: str, is_attended: bool, is_held: bool, kind: str | None) -> None:
    """About the situation only a person, SAGAT only once the run is held for it; nobody is the default."""
    settings = {"isa_every_s": 5.0} if name == "isa" else {"isa_every_s": 0.0, f"{name}_at_s": (5.0,)}
    asked = probes(**settings)
    asked.tick(5.0, False, 0.0, is_attended=is_attended, is_held=is_held)
    assert (asked.open(0.0) or {}).get("kind") == kind
    for nobody in ({}, {"is_attended": name == "sagat"}):
        asked = probes(**settings)
        asked.tick(5.0, False, 0.0, **nobody)
        assert (asked.open(0.0) is None) == (name != "isa")


@pytest.mark.parametrize(("first", "second"), [("spam", "isa"), ("isa", "spam")])
def test_no_question_is_asked_over_an_open_one(first: str, second: str) -> None:
    """Neither SPAM over ISA nor ISA over SPAM: it comes once the other is answered or missing."""
    due: dict[str, Any] = {
        "spam_ready": False,
        "spam_at_s": (5.0 if first == "spam" else 7.0,),
        "isa_every_s": 5.0 if first == "isa" else 7.0,
    }
    asked = probes(**due, spam_wait_s=30.0, isa_wait_s=30.0)
    shown = []
    for now_s, wall_s in ((5.0, 0.0), (7.0, 20.0), (8.0, 29.9), (9.0, 30.0)):
        asked.tick(now_s, False, wall_s, is_attended=True)
        probe = asked.open(wall_s)
        shown.append(probe["form"]["name"] if probe["kind"] == "form" else probe["kind"])
    assert shown == [first, first, first, second]
    assert [row.probe for row in asked.rows] == [first]
    assert [row.probe for row in asked.opened] == [first, second]


@pytest.mark.parametrize("has_begun", [True, False])
def test_what_is_asked_before_the_run_is_asked_once(has_begun: bool) -> None:
    """Also after a restart of the operator: again if the run had not begun, else not."""
    one = probes(form=(BEFORE,), isa_every_s=0.0)
    one.start(0.0)
    if has_begun:
        one.answer({"type": "form", "form": "you", "answers": {"age": 30}}, 1.0)
    other = reloaded(one)
    assert not other.resume()
    other.start(5.0)
    assert (other.open(5.0) is None) == has_begun
    assert other.outcomes["questions"] == 1


def test_a_restart_tells_whether_the_run_was_held() -> None:
    """By SAGAT, whose answer is then missing, but not by ISA; rows that were written are not written again."""
    for settings, is_held in (({"sagat_at_s": (5.0,), "isa_every_s": 0.0}, True), ({"isa_every_s": 5.0}, False)):
        one = probes(**settings)
        one.tick(5.0, False, 7.0, is_attended=True, is_held=True)
        other = reloaded(one)
        assert other.resume() == is_held
        assert {row.asked_monotonic_s for row in other.take_rows()} == {None}
        assert counts(other) == (1, 0, 1)
        third = reloaded(other)
        assert not third.resume()
        assert third.take_rows() == []
        assert third.rows == other.rows


def test_a_simulated_person_answers_at_once_and_has_no_wall_time() -> None:
    asked = probes(isa_every_s=5.0, isa_wait_s=1.0, tlx=True)
    asked.is_timed = False
    assert asked.answer_as(0.5, 0.0) is None
    asked.tick(5.0, False, 0.0)
    assert asked.open(1000.0)["left_s"] == 1.0
    assert asked.answer_as(0.5, 1000.0) == ("isa", {"value": 3})
    [row] = asked.rows
    assert (row.latency_s, row.asked_monotonic_s, row.answered_monotonic_s) == (0.0, None, None)
    asked.tick(9.0, True, 1001.0)
    assert asked.answer_as(0.5, 1001.0) is None
    assert asked.given("isa") == [{"isa": 3}]
    assert asked.outcomes["isa"] == 3


def test_after_a_restart_the_last_questions_are_asked_once() -> None:
    """An operator that was killed before it had saved the last step asks them; the time left is told to 0.1 s."""
    one = probes(tlx=True, isa_every_s=5.0, isa_wait_s=10.0)
    one.tick(5.0, False, 0.0)
    assert one.open(0.04)["left_s"] == 10.0
    assert one.open(0.16)["left_s"] == 9.8
    one.tick(9.0, True, 1.0)
    other = reloaded(one)
    other.resume()
    assert other.open(2.0) is None
    other.end(9.0, 2.0)
    assert other.open(2.0) == {"kind": "tlx"}


def test_a_person_says_to_be_ready_before_a_question_in_passing() -> None:
    """Each step has its time limit and both its latencies; the question is about the moment at which it is shown."""
    asked = probes(isa_every_s=0.0, spam_at_s=(5.0, 6.0), spam_questions=("open_events",), spam_wait_s=10.0)
    asked.tick(5.0, False, 100.0, is_attended=True, see=lambda: Seen([(1.0, 1.0)]))
    probe = asked.open(104.0)
    assert (probe["prompt"], probe["left_s"], probe["form"]["question"]) == (True, 6.0, [])
    answer = {"type": "form", "form": "spam", "number": 0, "answers": {"open_events": 2}}
    ready = {"form": "spam", "number": 0, "shown_s": 50.25, "page_s": 54.0}
    with pytest.raises(ValueError, match="no longer open"):
        asked.answer(answer, 104.0)
    asked.be_ready(ready, 9.0, 104.0, Seen([(1.0, 1.0), (2.0, 2.0)]))
    with pytest.raises(ValueError, match="no longer open"):
        asked.be_ready(ready, 9.0, 104.0, Seen())
    probe = asked.open(105.0)
    assert ("prompt" in probe, probe["left_s"], probe["form"]["question"][0]["name"]) == (False, 9.0, "open_events")
    asked.answer({**answer, "shown_s": 54.5, "page_s": 57.0}, 107.0)
    [row] = asked.take_rows()
    assert (row.asked_s, row.ready_s, row.value, row.known) == (5.0, 9.0, 2, "2")
    assert (row.ready_latency_s, row.ready_reaction_s, row.latency_s, row.reaction_s) == (4.0, 3.75, 3.0, 2.5)
    asked.tick(10.0, False, 110.0, is_attended=True)
    asked.open(120.0)
    [row] = asked.take_rows()
    assert (row.number, row.value, row.ready_s, row.latency_s, row.known) == (1, None, None, None, "")


def test_a_late_answer_is_not_that_to_the_next_question() -> None:
    """Though both ask the same: an answer names its question by number."""
    asked = probes(isa_every_s=0.0, spam_at_s=(5.0, 6.0), spam_questions=("trees",), spam_wait_s=10.0, spam_ready=False)
    asked.tick(5.0, False, 0.0, is_attended=True)
    asked.tick(6.0, False, 11.0, is_attended=True)
    late = {"type": "form", "form": "spam", "number": 0, "answers": {"trees": 2}}
    with pytest.raises(ValueError, match="no longer open"):
        asked.answer(late, 12.0)
    asked.answer({**late, "number": 1}, 12.0)
    assert [(row.number, row.value) for row in asked.rows] == [(0, None), (1, 2)]
