"""Scores of the person's task."""

from collections.abc import Mapping
from statistics import NormalDist
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.task import DECOY, TARGET, JudgementRow, JudgementTask, TaskSettings, judgement_rows, score
from deltaswarm_scenario.technique import Recorded
from deltaswarm_sessions.session import score_form
from tests.support.tiers import in_one_test


def rows(hits: int, misses: int, false_alarms: int, rejections: int, unjudged: int = 0) -> list[JudgementRow]:
    kinds = {(TARGET, TARGET): hits, (TARGET, DECOY): misses, (DECOY, TARGET): false_alarms, (DECOY, DECOY): rejections}
    kinds[DECOY, ""] = unjudged
    return [JudgementRow(0, 0, *kind, None, 0) for kind, count in kinds.items() for _ in range(count)]


COUNTS = st.integers(0, 40)


@given(COUNTS, COUNTS, COUNTS, COUNTS, COUNTS)
def test_all_is_counted_once_and_mirrored_answers_mirror_the_scores(
    hits: int, misses: int, false_alarms: int, rejections: int, unjudged: int
) -> None:
    """Who swaps both answers has minus the d'; who swaps the classes too has the same d' and minus the criterion."""
    one = score(rows(hits, misses, false_alarms, rejections, unjudged))
    kinds = ("hits", "misses", "false_alarms", "correct_rejections", "unjudged")
    assert sum(one[kind] for kind in kinds) == one["events"] == hits + misses + false_alarms + rejections + unjudged
    if one["events"]:
        assert one["share_right"] == (hits + rejections) / one["events"]
    swapped = score(rows(misses, hits, rejections, false_alarms))
    mirrored = score(rows(rejections, false_alarms, misses, hits))
    if hits + misses and false_alarms + rejections:
        assert one["d_prime"] == pytest.approx(-swapped["d_prime"]) == pytest.approx(mirrored["d_prime"])
        assert one["criterion"] == pytest.approx(-mirrored["criterion"])
    else:
        assert one["d_prime"] is one["criterion"] is None


def test_sensitivity_and_criterion_are_those_of_the_textbook() -> None:
    z = NormalDist().inv_cdf
    many = score(rows(8000, 2000, 1000, 9000))
    assert many["d_prime"] == pytest.approx(z(0.8) - z(0.1), abs=1e-3)
    assert many["criterion"] == pytest.approx(-(z(0.8) + z(0.1)) / 2, abs=1e-3)
    assert score(rows(1, 0, 0, 1))["d_prime"] == pytest.approx(z(0.75) - z(0.25))


def test_the_last_judgement_counts() -> None:
    def act(time_s: float, event: int, name: str) -> Mapping[str, Any]:
        return {"kind": "judge", "time_s": str(time_s), "event": str(event), "name": name}

    acts = [act(3, 1, DECOY), {"kind": "read"}, act(4, 1, TARGET), act(5, 1, TARGET), act(5, 1, TARGET)]
    acts.append(act(6, 2, TARGET))
    made = list(judgement_rows([(1, 77), (2, 78), (3, 79)], {77, 79}, acts))
    assert made == [
        JudgementRow(1, 77, TARGET, TARGET, 5.0, 1),
        JudgementRow(2, 78, DECOY, TARGET, 6.0, 0),
        JudgementRow(3, 79, TARGET, "", None, 0),
    ]


def test_the_person_is_told_the_score() -> None:
    form = score_form({"task": score(rows(3, 1, 2, 4, 5))})
    assert form is not None
    assert "7 of 15" in form.text
    assert not form.problems()
    assert score_form({}) is None


@in_one_test(
    ("counts", "share_right", "d_prime", "criterion"),
    [
        ((0, 0, 0, 0, 0), None, None, None),
        ((3, 1, 0, 0, 0), 0.75, None, None),
        ((0, 0, 1, 4, 0), 0.8, None, None),
        ((3, 1, 1, 4, 1), 0.7, 1.1989, 0.0750),
        ((1, 0, 0, 1, 2), 0.5, 1.3490, 0.0),
    ],
)
def test_scores_of_few_events(
    counts: tuple[int, int, int, int, int], share_right: float | None, d_prime: float | None, criterion: float | None
) -> None:
    """Worked out by hand: z(0.7) = 0.5244, z(0.25) = -0.6745 and so on."""
    found = score(rows(*counts))
    kinds = ("hits", "misses", "false_alarms", "correct_rejections", "unjudged")
    assert tuple(found[kind] for kind in kinds) == counts
    assert found["events"] == sum(counts)
    assert found["share_right"] == share_right
    for name, value in (("d_prime", d_prime), ("criterion", criterion)):
        assert found[name] == (None if value is None else pytest.approx(value, abs=1e-4))


def test_the_table_is_there_if_there_was_a_task_and_somebody_to_do_it() -> None:
    numbers = [{"number": "1", "event": "77"}, {"number": "2", "event": "78"}]
    acts = [{"kind": "judge", "time_s": f"{at}", "event": "1", "name": name} for at, name in enumerate("aab")]
    scored = JudgementTask.scored
    assert scored is not None
    assert scored.score(Recorded({"event_numbers": numbers}.get)) is None
    assert scored.score(Recorded({}.get, targets=frozenset({77}))) is None
    unjudged = scored.score(Recorded({"event_numbers": numbers}.get, targets=frozenset({77})))
    assert unjudged == [JudgementRow(1, 77, TARGET, "", None, 0), JudgementRow(2, 78, DECOY, "", None, 0)]
    tables = {"event_numbers": numbers, "actions": acts}
    judged = scored.score(Recorded(tables.get, targets=frozenset({78})))
    assert judged == [JudgementRow(1, 77, DECOY, "b", 2.0, 1), JudgementRow(2, 78, TARGET, "", None, 0)]
    assert list(JudgementTask.of(None)) == []
    assert (TaskSettings().is_on, TaskSettings(target_share=0.5).is_on) == (False, True)
    whole = {measure.key.removeprefix("task.") for measure in JudgementTask.measures if measure.is_whole}
    assert whole == {"hits", "misses", "false_alarms", "correct_rejections", "unjudged", "events"}
