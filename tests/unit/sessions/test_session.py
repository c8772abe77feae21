"""What comes next in a session: runs that are open, pages after them, and what the experimenter is told."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_sessions.session import Ask, DoRun, Say, Session
from tests.support.sessions import FORMS, a_session, do, with_criterion

TASK = {"events": 9, "hits": 3, "misses": 1, "false_alarms": 2, "correct_rejections": 2, "unjudged": 1}


def follow(session: Session, *done: dict[str, Any]) -> list[str]:
    """Do the next run as often as there are summaries, and answer nothing; return the steps in words."""
    told, left = [], list(done)
    for step in session.steps():
        if isinstance(step, DoRun):
            told.append(f"do {step.text}")
            if not left:
                break
            do(session, step.run, **left.pop(0))
        elif isinstance(step, Ask):
            told.append(f"ask {step.attempt.folder}: {step.text or 'the score'}")
        else:
            told.append(f"say {step.text}" + ("." if step.is_end else ""))
            if step.is_end:
                break
    return told


def test_each_run_is_done_once_in_order(tmp_path: Path) -> None:
    """Training, then the conditions; what is complete is not done again."""
    session = a_session(tmp_path)
    assert follow(session, {}, {}) == ["do run 0 of 2: training", "do run 1 of 2: A", "do run 2 of 2: B"]
    assert follow(session, {}) == ["do run 2 of 2: B"]
    assert follow(session) == []


def test_a_run_that_was_cut_off_or_is_not_valid_is_done_again(tmp_path: Path) -> None:
    """In the next sitting; in the same one nothing is done twice without a criterion."""
    session = a_session(tmp_path)
    all_runs = ["do run 0 of 2: training", "do run 1 of 2: A", "do run 2 of 2: B"]
    assert follow(session, {"complete": False}, {"valid": False}) == all_runs
    assert follow(session, {}, {}, {}) == all_runs
    attempts = [(one.folder, one.is_valid) for run in session.runs for one in session.attempts[run.folder]]
    assert attempts == [("0-training", False), ("0-training-2", True), ("1-A", False), ("1-A-2", True), ("2-B", True)]


def test_missing_answers_are_asked_for_after_the_run_and_in_the_next_sitting(tmp_path: Path) -> None:
    """NASA-TLX and forms with questions; then the experimenter is told what is still missing."""
    session = a_session(tmp_path, 1, FORMS.replace('name = "end"', 'name = "end"\ntext = "Thanks"'))
    missing = {"person": {"answers_missing": 2}}
    assert follow(session, {"answered": ("you",)}, {"answered": ("trust",), **missing}) == [
        "do run 0 of 1: training",
        "do run 1 of 1: A",
        "ask 1-A: asking again after run 1, A: end",
        "say answers missing in run 1, A: 2",
    ]
    assert follow(session) == ["ask 1-A: asking again after run 1, A: end"]
    session.attempts["1-A"][0] = session.attempts["1-A"][0]._replace(answered=frozenset({"trust", "end"}))
    assert follow(session) == []


def test_what_is_asked_again_is_what_has_no_answer(tmp_path: Path) -> None:
    """A form comes after the run, wherever it was before; questions about a moment are not asked again."""
    session = a_session(tmp_path, 1, FORMS)
    training, run = session.runs
    both, half = do(session, training).unanswered, do(session, run, answered=("trust", "isa")).unanswered
    assert both is not None
    assert half is not None
    assert [(form.name, form.when) for form in both.form] == [("you", "after")]
    assert (both.isa_every_s, both.tlx, both.consent) == (0.0, False, "")
    assert [form.name for form in half.form] == ["end"]


@pytest.mark.parametrize(("answered", "is_asked"), [((), True), (("isa",), True), (("tlx", "x"), False)])
def test_workload_is_asked_again_as_it_was(answered: tuple[str, ...], is_asked: bool, tmp_path: Path) -> None:
    """With its weights; not if it was answered."""
    session = a_session(tmp_path, 1)
    attempt = do(session, session.runs[1], answered=answered)
    operator = attempt.scenario.operator
    asked = replace(operator, probes=replace(operator.probes, tlx=True, tlx_weights=True))
    found = attempt._replace(scenario=replace(attempt.scenario, operator=asked)).unanswered
    assert (found and (found.tlx, found.tlx_weights, found.form)) == ((True, True, ()) if is_asked else None)


def test_the_score_of_a_task_is_shown_once(tmp_path: Path) -> None:
    """On a page of its own, with the numbers of the run, and not again when the session is continued."""
    session = a_session(tmp_path, 1)
    shown = ["do run 0 of 1: training", "do run 1 of 1: A", "ask 1-A: the score"]
    assert follow(session, {}, {"task": TASK}) == shown
    [attempt] = session.attempts["1-A"]
    assert attempt.score is not None
    assert (attempt.score.name, attempt.score.text) == (
        "score",
        "Judged right: 5 of 9 reported events. Targets found: 3. Targets taken for decoys: 1. "
        "Decoys taken for targets: 2. Without a judgement: 1. By tossing a coin about 4 would be right.",
    )
    assert follow(session) == []
    without = Session(1, a_session(tmp_path, 1).runs, shows_score=False)
    assert follow(without, {}, {"task": TASK}) == shown[:2]


def test_the_page_of_the_score_asks_nothing_else(tmp_path: Path) -> None:
    session = a_session(tmp_path, 1)
    steps = session.steps()
    next(steps)
    do(session, session.runs[0], task=TASK)
    step = next(steps)
    assert isinstance(step, Ask)
    assert (step.probes.isa_every_s, [form.name for form in step.probes.form]) == (0.0, ["score"])


def test_training_is_repeated_with_the_reason(tmp_path: Path) -> None:
    """The values so far and the bound; a run that was cut off has no value and does not count."""
    session = a_session(tmp_path, 1, with_criterion(bound="at_least = 2\nat_most = 6.5"))
    read = [{"person": {"read": 1}}, {"complete": False}, {"person": {}}, {"person": {"read": 6}}]
    assert follow(session, *read) == [
        "do run 0 of 1: training",
        "do run 0 of 1: training again (2 of at most 3), since read must be at least 2 and at most 6.5 (got 1)",
        "do run 0 of 1: training again (2 of at most 3), since read must be at least 2 and at most 6.5 (got 1)",
        "do run 0 of 1: training again (3 of at most 3), since read must be at least 2 and at most 6.5 (got 1, none)",
        "do run 1 of 1: A",
    ]
    assert [session.outcome(run) for run in session.runs] == ["reached", "open"]


@pytest.mark.parametrize(("then", "said"), [("go on", "the session goes on"), ("end", "the session ends here.")])
def test_training_that_is_not_enough_ends_the_session_or_not(then: str, said: str, tmp_path: Path) -> None:
    """As the file says, in each sitting."""
    session = a_session(tmp_path, 1, with_criterion(more=f'max_runs = 1\nif_not_reached = "{then}"'))
    steps = follow(session, {"person": {"read": 4}})
    told = f"say the criterion of the training is not reached: read must be at least 5 (got 4); {said}"
    assert steps == ["do run 0 of 1: training", told, *(["do run 1 of 1: A"] if then == "go on" else [])]
    assert follow(session) == steps[1:]
    assert session.outcome(session.runs[0]) == "not reached"


def test_the_record_has_the_order_and_all_attempts(tmp_path: Path) -> None:
    """With the condition's own keys and stream; the value of the criterion for training alone."""
    session = a_session(tmp_path, 2, with_criterion(), participant=3)
    training, first, _ = session.runs
    do(session, training, complete=False, person={"answers_missing": 1, "read": 0})
    do(session, training, person={"answers_missing": 0, "read": 7})
    do(session, first)
    plain = {"digest": "ff", "complete": True, "valid": True}
    cut = {"folder": "0-training", "complete": False, "valid": False, "answers_missing": 1, "training_value": 0.0}
    whole = {"folder": "0-training-2", "answers_missing": 0, "training_value": 7.0}

    def row(place: int, condition: str, key: str, stream: int | None, *attempts: dict[str, Any]) -> dict[str, Any]:
        row = {"place": place, "condition": condition, "scenario": "smoke", "set": [key], "stream": stream}
        return {**row, "attempts": [{**plain, **attempt} for attempt in attempts]}

    assert session.record == {
        "participant": 3,
        "language": "",
        "runs": [
            {**row(0, "training", "run.duration_s=60", None, cut, whole), "outcome": "reached"},
            row(1, "A", "control.delta=2", 1, {"folder": "1-A", "answers_missing": None}),
            row(2, "B", "control.delta=3", 0),
        ],
    }


def test_what_the_experimenter_is_told_goes_with_the_last_attempt(tmp_path: Path) -> None:
    """Answers given on the page that asks again are no longer missing."""
    session = a_session(tmp_path, 1, FORMS)
    told = []
    for step in session.steps():
        if isinstance(step, DoRun):
            do(session, step.run, person={"answers_missing": 1})
        elif isinstance(step, Ask):
            [attempt] = session.attempts[step.attempt.folder]
            left = {**attempt.summary, "person": {"answers_missing": int(attempt.folder == "1-A")}}
            session.attempts[step.attempt.folder] = [attempt._replace(summary=left)]
        elif isinstance(step, Say):
            told.append(step.text)
    assert told == ["answers missing in run 1, A: 1"]
