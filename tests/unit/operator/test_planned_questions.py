"""Each planned question has its rows: late, cut off, not asked, or answered over a slow link."""

import pytest

from deltaswarm_scenario.technique import Seen
from tests.support.tiers import in_one_test
from tests.unit.operator.test_probes import counts, isa, probes


def test_each_planned_question_has_a_row_that_says_what_became_of_it() -> None:
    """Asked late while another is open; not asked from half the interval on; cut off by the end; missed in peace."""
    asked = probes(isa_every_s=10.0, isa_wait_s=6.0, spam_at_s=(19.0, 48.0), spam_wait_s=15.0, spam_ready=False)
    asked.heard_wall_s = 0.0
    for second in range(1, 51):
        is_away = second == 30
        asked.heard_wall_s = asked.heard_wall_s if is_away else float(second)
        asked.tick(float(second), second == 50, float(second), is_attended=True, is_away=is_away)
        if (open_now := asked.open(float(second))) and open_now["kind"] == "isa" and second in (11, 31):
            isa(asked, open_now["number"], 3, float(second))
    rows = [(row.probe, row.planned_s, row.asked_s, row.late_s, row.outcome) for row in asked.rows]
    assert sorted(rows) == [
        ("isa", 10.0, 10.0, 0.0, "answered"),
        ("isa", 20.0, None, None, "not asked: another question was open"),
        ("isa", 30.0, 34.0, 4.0, "missed"),
        ("isa", 40.0, 40.0, 0.0, "missed"),
        ("spam", 19.0, 19.0, 0.0, "missed"),
        ("spam", 48.0, 48.0, 0.0, "cut off by the end"),
    ]
    assert counts(asked) == (5, 3, 2)


def test_a_run_that_ends_early_tells_what_was_planned() -> None:
    """Of the time until then, and after the run."""
    asked = probes(isa_every_s=0.0, spam_at_s=(5.0, 90.0), tlx=True)
    asked.tick(4.0, False, 4.0, is_attended=True)
    asked.tick(7.0, False, 7.0)
    asked.close()
    [spam, *tlx_rows] = asked.rows
    assert (spam.planned_s, spam.asked_s, spam.outcome) == (5.0, None, "not asked: no station")
    assert {row.outcome for row in tlx_rows} == {"not asked: the run ended"}
    assert counts(asked) == (0, 0, 2)


@in_one_test(("rtt_s", "at_end"), [(0.0, False), (2.0, False), (4.0, False), (0.0, True), (4.0, True)])
def test_an_answer_in_time_counts_however_slow_the_link_is(rtt_s: float, at_end: bool) -> None:
    """The page shows the question a way late, and the answer takes a way: the page's own clock says when it was."""
    for took_s, counts_then in ((19.5, True), (25.0, False)):
        asked = probes(isa_every_s=10.0, isa_wait_s=20.0)
        asked.grace_s = 1.0 + 2 * rtt_s
        asked.tick(10.0, False, 100.0)
        if at_end:  # of the run, just before the answer is made
            asked.tick(11.0, True, 100.0 + took_s)
        message = {"type": "isa", "number": 0, "answer": 4, "shown_s": 50.0, "page_s": 50.0 + took_s}
        if counts_then:
            asked.answer(message, 100.0 + took_s + rtt_s)
            assert [(row.value, row.outcome, row.reaction_s) for row in asked.rows] == [(4, "answered", 19.5)]
        else:
            with pytest.raises(ValueError, match="no longer open"):
                asked.answer(message, 100.0 + took_s + rtt_s)


def test_what_several_answers_would_answer_is_not_asked() -> None:
    """SAGAT leaves it out, with a row; SPAM asks another of its questions."""
    tied, open_now = Seen([(10.0, 10.0), (90.0, 90.0)], (), 100.0, 100.0), Seen([(10.0, 10.0)], (), 100.0, 100.0)
    names = {}
    for name in ("sagat", "spam"):
        for seen in (tied, open_now):
            asked = probes(isa_every_s=0.0, spam_ready=False, **{f"{name}_at_s": (5.0, 6.0)})
            found = set()
            for now_s in (5.0, 6.0):
                asked.tick(now_s, False, now_s, is_attended=True, is_held=True, see=lambda seen=seen: seen)  # type: ignore[misc]
                form = asked.open(now_s)["form"]  # type: ignore[index]
                found |= {question["name"] for question in form["question"]}
                answers = {one["name"]: 2 if one["kind"] == "number" else "bottom left" for one in form["question"]}
                asked.answer({"type": "form", "form": name, "answers": answers}, now_s)
            names[name, seen is tied] = found
            left_out = [row.item for row in asked.rows if row.outcome == "not asked: several answers were right"]
            assert left_out == (["most_events"] * 2 if name == "sagat" and seen is tied else [])
            assert counts(asked) == (2, 0, 0)
    assert names["sagat", True] == names["spam", True] == {"open_events"}
    assert names["sagat", False] == names["spam", False] == {"open_events", "most_events"}
