"""Each question technique: when it is due, which answers it takes, and how they are scored."""

import math
from itertools import combinations, pairwise
from random import Random
from typing import Any

import pytest

from deltaswarm_scenario.isa import Isa
from deltaswarm_scenario.questions import Form, FormSettings, QuestionSettings
from deltaswarm_scenario.situation import QUARTERS, SITUATION, AtTimes, Sagat, Spam
from deltaswarm_scenario.techniques import NAMED, SCORED, ProbeSettings
from deltaswarm_scenario.tlx import SCALES, Tlx
from tests.support.tiers import in_one_test

SIX = dict(zip(SCALES, (10, 20, 30, 40, 50, 60), strict=True))
WEIGHTS = dict(zip(SCALES, (5, 4, 3, 2, 1, 0), strict=True))
ALL = (*SITUATION,)
TOP = "top left"
SHARES = [f"person.situation_{name}_share" for name in ("right", "true", "known", "chance")]
NOTHING = {"open_events": 0, "agents_in_trees": 0, "trees": 0, "most_events": "top left"}
ANSWERS = {"open_events": 3, "agents_in_trees": 2, "trees": 1, "most_events": "top left"}
FORM = FormSettings(
    "f",
    question=(
        QuestionSettings("trust", "Trust?"),
        QuestionSettings("age", "Age?", "number", 18.0, 99.0),
        QuestionSettings("why", "Why?", "text", required=False),
        QuestionSettings("side", "Side?", "choice", choices=("left", "right")),
    ),
)
GIVEN = {"trust": 7, "age": 30.5, "side": "left"}
NEEDED = "an answer to each of mental, physical, temporal, performance, effort, frustration is needed"


def technique(**settings: Any) -> Any:
    [one] = ProbeSettings(**{"isa_every_s": 0.0, **settings}).techniques
    return one


@in_one_test(
    ("settings", "names"),
    [
        ({}, ["isa"]),
        ({"isa_every_s": 0.0}, []),
        ({"consent": "Yes?"}, ["sheet", "isa"]),
        ({"participant": "P1", "tlx": True}, ["sheet", "isa", "tlx"]),
        ({"condition": "A"}, ["isa"]),
        ({"tlx_weights": True}, ["isa"]),
        ({"sagat_at_s": (5.0,), "spam_at_s": (5.0,)}, ["sagat", "spam", "isa"]),
        ({"form": (FORM,)}, ["isa", "f"]),
    ],
)
def test_the_settings_say_which_techniques_a_run_uses(settings: dict[str, Any], names: list[str]) -> None:
    assert [one.name for one in ProbeSettings(**settings).techniques] == names


def test_the_names_and_the_scored_tables_follow_from_the_list() -> None:
    assert {"sagat", "spam", "isa", "tlx"} <= {*NAMED}
    assert {"judgements", "situation"} <= SCORED.keys()
    for name in (*NAMED, "f"):
        form = FormSettings(name, text="Read this.")
        assert bool(ProbeSettings(form=(form, FORM)).problems()), name
    assert not ProbeSettings(form=(FORM,)).problems()


@pytest.mark.parametrize(
    ("settings", "path"),
    [
        ({"sagat_at_s": (5.0,), "sagat_questions": ()}, "sagat_questions"),
        ({"spam_at_s": (5.0,), "spam_questions": ()}, "spam_questions"),
    ],
)
def test_who_asks_about_the_situation_asks_something(settings: dict[str, Any], path: str) -> None:
    assert [problem.path for problem in ProbeSettings(**settings).problems()] == [path]
    assert not ProbeSettings(sagat_questions=(), spam_questions=()).problems()


@pytest.mark.parametrize(
    ("at_s", "step_s", "late"),
    [((9.0, 10.0, 12.0), 1.0, "10, 12"), ((9.0,), 1.0, None), ((9.9,), 1.0, "9.9"), ((9.9,), 0.1, None)],
)
@pytest.mark.parametrize("name", ["sagat", "spam"])
def test_times_are_before_the_last_step(name: str, at_s: tuple[float, ...], step_s: float, late: str | None) -> None:
    """A question of the last step would be asked at the end of the run, when nobody is asked any more."""
    problems = technique(**{f"{name}_at_s": at_s}).problems_within(10.0, step_s)
    assert [(problem.path, problem.given) for problem in problems] == (
        [(f"operator.probes.{name}_at_s", late)] if late else []
    )


@in_one_test(
    ("settings", "due_s"),
    [
        ({"isa_every_s": 30.0}, [130.0, 130.0]),
        ({"sagat_at_s": (50.0, 20.0)}, [20.0, 50.0, math.inf]),
        ({"spam_at_s": (50.0, 20.0)}, [20.0, 50.0, math.inf]),
        ({"tlx": True}, [math.inf]),
    ],
)
def test_a_question_is_due(settings: dict[str, Any], due_s: list[float]) -> None:
    assert [technique(**settings).due_s(number, 100.0, Random(1)) for number in range(len(due_s))] == due_s


@in_one_test(
    ("settings", "step_s", "path"),
    [
        ({"sagat_at_s": (100.2, 100.6)}, 1.0, "operator.probes.sagat_at_s"),
        ({"sagat_at_s": (100.2, 100.6)}, 0.5, None),
        ({"sagat_at_s": (100.0, 101.0)}, 1.0, None),
        ({"sagat_count": 3, "situation_gap_s": 5.0}, 10.0, "operator.probes.situation_gap_s"),
        ({"sagat_count": 3, "situation_gap_s": 10.0}, 10.0, None),
        ({"spam_count": 1, "situation_gap_s": 5.0}, 10.0, "operator.probes.situation_gap_s"),
        ({"spam_at_s": (100.2, 100.6)}, 1.0, None),  # asked beside the map, one after the other
    ],
)
def test_a_run_is_held_once_before_a_step(settings: dict[str, Any], step_s: float, path: str | None) -> None:
    """A second question that holds it there would never be asked, and hold it for good."""
    [one] = [found for found in ProbeSettings(**settings).techniques if isinstance(found, AtTimes)]
    assert [problem.path for problem in one.problems_within(1000.0, step_s)] == ([path] if path else [])


@in_one_test(
    ("question", "path"),
    [
        (QuestionSettings("a", "A?"), None),
        (QuestionSettings("", "A?"), "name"),
        (QuestionSettings("a", ""), "name"),
        (QuestionSettings("a", "A?", "choice", choices=("x", "y")), None),
        (QuestionSettings("a", "A?", "choice", choices=("x", "x")), "choices"),
        (QuestionSettings("a", "A?", "likert", 1.0, 1.0), "high"),
        (QuestionSettings("a", "A?", "likert", 1.0, 2.0), None),
        (QuestionSettings("a", "A?", "likert", 0.0, 10.0), None),
        (QuestionSettings("a", "A?", "likert", 0.0, 11.0), "high"),
        (QuestionSettings("a", "A?", "likert", 0.5, 6.5), "low"),
        (QuestionSettings("a", "A?", "number", 5.0, 5.0), None),
        (QuestionSettings("a", "A?", "number", 5.0, 4.0), "high"),
        (QuestionSettings("a", "A?", "text", 5.0, 4.0), None),
    ],
)
def test_a_question_of_a_form_can_be_answered(question: QuestionSettings, path: str | None) -> None:
    assert [problem.path for problem in question.problems()] == ([path] if path else [])


@in_one_test(
    ("form", "is_right"),
    [
        (FORM, True),
        (FormSettings("f", text="Read this."), True),
        (FormSettings("f"), False),
        (FormSettings("", text="Read this."), False),
        (FormSettings("f", question=(FORM.question[0], FORM.question[0])), False),
        (FormSettings("f", text="Read this.", question=(FORM.question[0], FORM.question[0])), False),
    ],
)
def test_a_form_has_a_name_and_something_to_show(form: FormSettings, is_right: bool) -> None:
    assert [problem.path for problem in form.problems()] == ([] if is_right else ["question"])


def test_the_longest_text_is_taken() -> None:
    assert technique(form=(FORM,)).answers(0, {"answers": {**GIVEN, "why": "x" * 2000}})["why"] == "x" * 2000


def test_the_jitter_of_isa_is_added_to_its_interval() -> None:
    rng = Random(1)
    times_s = [technique(isa_every_s=30.0, isa_jitter_s=10.0).due_s(0, 0.0, rng) for _ in range(200)]
    assert 30.0 <= min(times_s) < 31.0
    assert 39.0 < max(times_s) <= 40.0


@in_one_test(
    ("settings", "number", "message", "answers", "act"),
    [
        ({"isa_every_s": 9}, 0, {"answer": 1}, {"isa": 1}, {"value": 1}),
        ({"isa_every_s": 9}, 0, {"answer": 5}, {"isa": 5}, {"value": 5}),
        ({"tlx": True}, 0, {"scales": SIX, "weights": None}, SIX, {}),
        ({"tlx": True}, 0, {"scales": {**SIX, "mental": 0, "effort": 100}}, {**SIX, "mental": 0, "effort": 100}, {}),
        (
            {"tlx": True, "tlx_weights": True},
            0,
            {"scales": SIX, "weights": WEIGHTS},
            {**SIX, **{f"{scale} weight": weight for scale, weight in WEIGHTS.items()}},
            {},
        ),
        ({"sagat_at_s": (5.0,), "sagat_questions": ALL}, 0, {"answers": ANSWERS}, ANSWERS, {"name": "sagat"}),
        ({"sagat_at_s": (5.0,), "sagat_questions": ALL}, 0, {"answers": NOTHING}, NOTHING, {"name": "sagat"}),
        ({"spam_at_s": (5.0,)}, 0, {"answers": {"open_events": 9999}}, {"open_events": 9999}, {"name": "spam"}),
        ({"spam_at_s": (5.0,)}, 3, {"answers": {"most_events": TOP}}, {"most_events": TOP}, {"name": "spam"}),
        ({"form": (FORM,)}, 0, {"answers": GIVEN}, {**GIVEN, "why": None}, {"name": "f"}),
    ],
)
def test_answers_that_are_taken(
    settings: dict[str, Any], number: int, message: dict[str, Any], answers: dict[str, Any], act: dict[str, Any]
) -> None:
    one = technique(**settings)
    assert one.answers(number, message) == answers
    assert one.act(answers) == act
    assert set(one.items(number)) <= set(answers)


@in_one_test(
    ("settings", "message", "why"),
    [
        *(({"isa_every_s": 9}, {"answer": wrong}, "from 1 to 5") for wrong in (0, 6, 2.0, True, None, "3")),
        *(({"tlx": True}, {"scales": wrong}, NEEDED) for wrong in (None, [], {}, {**SIX, "x": 1})),
        *(
            ({"tlx": True}, {"scales": {**SIX, "effort": wrong}}, "each scale must be from 0 to 100")
            for wrong in (-1, 101, True, 50.0)
        ),
        *(
            ({"tlx": True, "tlx_weights": True}, {"scales": SIX, "weights": wrong}, why)
            for wrong, why in (
                (None, NEEDED),
                ({**WEIGHTS, "mental": 6, "effort": 0}, "each weight must be from 0 to 5"),
                ({**WEIGHTS, "frustration": -1, "effort": 2}, "each weight must be from 0 to 5"),
                ({**WEIGHTS, "mental": 4}, "the weights must add up to 15"),
                ({**WEIGHTS, "frustration": 1}, "the weights must add up to 15"),
            )
        ),
        *(
            ({"sagat_at_s": (5.0,), "sagat_questions": ALL}, {"answers": wrong}, "answer")
            for wrong in (
                None,
                {},
                {**ANSWERS, "more": 1},
                {**ANSWERS, "trees": -1},
                {**ANSWERS, "trees": 10_000},
                {**ANSWERS, "trees": True},
                {**ANSWERS, "most_events": "left"},
            )
        ),
        ({"spam_at_s": (5.0,)}, {"answers": {"trees": 1}}, "an answer is of no question of this form"),
        *(
            ({"form": (FORM,)}, {"answers": {**GIVEN, **wrong}}, why)
            for wrong, why in (
                ({"trust": 0}, "this is no answer to: Trust?"),
                ({"trust": 8}, "this is no answer to: Trust?"),
                ({"trust": 3.0}, "this is no answer to: Trust?"),
                ({"trust": None}, "an answer is needed: Trust?"),
                ({"trust": ""}, "an answer is needed: Trust?"),
                ({"age": 17.9}, "this is no answer to: Age?"),
                ({"age": 99.1}, "this is no answer to: Age?"),
                ({"age": math.nan}, "this is no answer to: Age?"),
                ({"age": "30"}, "this is no answer to: Age?"),
                ({"why": 3}, "this is no answer to: Why?"),
                ({"why": "x" * 2001}, "this is no answer to: Why?"),
                ({"side": "middle"}, "this is no answer to: Side?"),
            )
        ),
    ],
)
def test_answers_that_are_refused(settings: dict[str, Any], message: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=rf".*{why.replace('?', '[?]')}"):
        technique(**settings).answers(0, message)


@in_one_test(
    ("given", "isa", "tlx"),
    [
        ([], {"isa": None}, {"tlx": None}),
        ([SIX], None, {"tlx": {"raw": 35.0}}),
        ([{**SIX, "mental": 100}, SIX], None, {"tlx": {"raw": 35.0}}),
        (
            [{**SIX, **{f"{scale} weight": weight for scale, weight in WEIGHTS.items()}}],
            None,
            # 5 * 10 + 4 * 20 + 3 * 30 + 2 * 40 + 1 * 50 = 350, by 15
            {"tlx": {"raw": 35.0, "weighted": pytest.approx(23.33333333)}},
        ),
        ([{"isa": 2}, {"isa": 5}, {"isa": 5}], {"isa": 4.0}, None),
    ],
)
def test_scores(given: list[dict[str, Any]], isa: dict[str, Any] | None, tlx: dict[str, Any] | None) -> None:
    assert isa is None or Isa.scores(given) == isa
    assert tlx is None or Tlx.scores(given) == tlx
    assert Sagat.scores([ANSWERS]) == Form.scores([GIVEN]) == {}


@in_one_test(("load", "answer"), [(0.0, 1), (0.19, 1), (0.2, 2), (0.39, 2), (0.5, 3), (0.79, 4), (0.8, 5), (1.0, 5)])
def test_a_simulated_person_answers_isa_by_its_load(load: float, answer: int) -> None:
    assert Isa.simulated(load) == {"isa": answer}
    assert Tlx.simulated(load) is Spam.simulated(load) is None


@in_one_test(
    ("settings", "words"),
    [
        ({"isa_every_s": 60.0}, "ISA every 60 s"),
        ({"isa_every_s": 60.0, "isa_jitter_s": 30.0}, "ISA every 60 to 90 s"),
        ({"tlx": True}, "NASA-TLX"),
        ({"tlx": True, "tlx_weights": True}, "NASA-TLX with weights"),
        ({"sagat_at_s": (20.0, 5.0)}, "SAGAT at 5, 20 s"),
        ({"spam_at_s": (5.0,)}, "SPAM at 5 s"),
        ({"spam_count": 3}, "SPAM at 3 drawn times"),
        ({"form": (FORM,)}, None),
        ({"consent": "Yes?"}, None),
    ],
)
def test_the_outline_of_a_session_says_what_is_asked(settings: dict[str, Any], words: str | None) -> None:
    assert technique(**settings).outline == words


@in_one_test(
    ("settings", "keys"),
    [
        ({"isa_every_s": 60.0}, ["person.isa"]),
        ({"tlx": True}, ["person.tlx.raw"]),
        ({"tlx": True, "tlx_weights": True}, ["person.tlx.raw", "person.tlx.weighted"]),
        ({"sagat_at_s": (5.0,)}, SHARES),
        ({"spam_count": 1}, SHARES),
        ({"form": (FORM,)}, []),
    ],
)
def test_the_numbers_that_a_technique_gives_a_run(settings: dict[str, Any], keys: list[str]) -> None:
    assert [measure.key for measure in technique(**settings).measures] == keys


def test_what_the_page_shows() -> None:
    """SAGAT hides the situation and asks all; SPAM asks one question in turn, in a limited time."""
    isa = technique(isa_every_s=9, isa_wait_s=7.0)
    assert (isa.wait_s, isa.shown(4, 50.0, 6.5)) == (7.0, {"kind": "isa", "number": 4, "asked_s": 50.0, "left_s": 6.5})
    sagat = technique(sagat_at_s=(5.0,), sagat_questions=("trees", "most_events"))
    shown = sagat.shown(0, 5.0, None)
    assert (sagat.wait_s, shown["kind"], shown["hides"], shown["left_s"]) == (None, "form", True, None)
    assert [question["name"] for question in shown["form"]["question"]] == ["trees", "most_events"]
    assert shown["form"]["question"][1]["choices"] == ["top left", "top right", "bottom left", "bottom right"]
    assert QUARTERS == ("top left", "top right", "bottom left", "bottom right")
    spam = technique(spam_at_s=(5.0, 6.0, 7.0), spam_questions=("trees", "open_events"), spam_wait_s=11.0)
    shown = spam.shown(1, 6.0, 3.0)
    assert (spam.wait_s, shown["hides"], shown["left_s"], shown["number"]) == (11.0, False, 3.0, 1)
    assert [spam.items(number) for number in range(3)] == [("trees",), ("open_events",), ("trees",)]
    assert (technique(tlx=True).shown(0, 9.0, None), technique(consent="Yes?").shown(0, 0.0, None)) == (
        {"kind": "tlx"},
        {"kind": "sheet"},
    )


def test_times_and_orders_are_drawn_anew_in_each_run() -> None:
    """The same from the same seed: times with their gap within the run, every question once a round."""
    drawn = []
    for seed in (1, 1, *range(2, 40)):
        spam = technique(spam_count=5, spam_questions=ALL, situation_first_s=30.0, situation_gap_s=50.0)
        spam.draw(Random(seed), 310.0)
        times_s = [spam.due_s(number, 0.0, Random(0)) for number in range(5)]
        assert spam.due_s(5, 0.0, Random(0)) == math.inf
        assert times_s[0] >= 30.0
        assert all(after - before >= 49.9 for before, after in pairwise([*times_s, 310.0]))
        items = [item for number in range(8) for item in spam.items(number)]
        assert set(items[:4]) == set(items[4:]) == {*ALL}
        drawn.append((times_s, items))
    assert drawn[0] == drawn[1]
    assert len({tuple(times_s) for times_s, _ in drawn}) == 39
    assert len({tuple(items) for _, items in drawn}) > 30
    sagat = technique(sagat_at_s=(5.0, 9.0), sagat_questions=ALL)
    sagat.draw(Random(3), 10.0)
    assert len({tuple(sagat.items(number)) for number in (0, 1)}) == 2


@in_one_test(
    ("settings", "problem"),
    [
        ({"spam_count": 5}, None),
        ({"spam_count": 6}, "operator.probes.spam_count must be at most 5: times from situation_first_s = 60 on"),
        ({"sagat_count": 1, "situation_first_s": 400.0}, "operator.probes.sagat_count must be at most 0: times from"),
    ],
)
def test_drawn_times_fit_into_the_run(settings: dict[str, Any], problem: str | None) -> None:
    """With their gaps, the last one before the end; or the run is refused."""
    found = [str(one) for one in technique(**settings).problems_within(360.0, 1.0)]
    assert len(found) == (problem is not None)
    assert all(one.startswith(problem or "") for one in found)


def test_the_pairs_of_nasa_tlx_have_a_drawn_order() -> None:
    orders = set()
    for seed in range(20):
        tlx = technique(tlx=True, tlx_weights=True)
        tlx.draw(Random(seed), 100.0)
        pairs = tlx.shown(0, 9.0, None)["pairs"]
        assert {frozenset(pair) for pair in pairs} == {frozenset(pair) for pair in combinations(SIX, 2)}
        orders.add(tuple(map(tuple, pairs)))
    assert len(orders) == 20
    assert len({pair for order in orders for pair in order}) == 30
