"""What is on file of a session: attempts, their numbers, and answers that were given in a run or after it."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_scenario.situation import SituationRow
from deltaswarm_sessions.folder import answers, attempts_at, folders_of_later_answers, read_record, summary_of
from tests.support.sessions import a_session, with_criterion

SCALES = {"mental": 60, "physical": 0, "temporal": 60, "performance": 0, "effort": 60, "frustration": 0}
LATE = "2026-11-27T10:00:00.000Z"


def a_run(folder: Path, summary: dict[str, Any] | None = None, *rows: ProbeRow) -> Path:
    """The folder of a run with a summary, or of a page that asked again, with answers."""
    folder.mkdir(parents=True)
    if summary is not None:
        (folder / "summary.json").write_text(json.dumps(summary))
    write_csv(folder / "probes.csv", ProbeRow._fields, rows)
    return folder


def row(probe: str, item: str, value: str | float | None = None) -> ProbeRow:
    """An answer, or its absence."""
    return ProbeRow(probe, 0, item, value, 60.0, None, answered_utc="" if value is None else LATE)


def test_later_answers_stand_in_place_of_missing_ones(tmp_path: Path) -> None:
    """Item by item; what was answered in the run stays, and what has no answer on either page is still missing."""
    run = a_run(
        tmp_path / "1-A", {}, row("isa", "isa", 3), row("trust", "why"), row("tlx", "mental"), row("you", "age")
    )
    a_run(tmp_path / "1-A.again-1", None, row("tlx", "mental", 40), row("trust", "why"))
    a_run(tmp_path / "1-A.again-2", None, row("trust", "why", "It was quick."))
    a_run(tmp_path / "1-A.again-10", None)
    a_run(tmp_path / "1-A.score", None, row("score", "score", 1))
    assert [path.name for path in folders_of_later_answers(run)] == ["1-A.again-1", "1-A.again-2", "1-A.again-10"]
    assert [(one["probe"], one["item"], one["value"]) for one in answers(run)] == [
        ("isa", "isa", "3"),
        ("you", "age", ""),
        ("tlx", "mental", "40"),
        ("trust", "why", "It was quick."),
    ]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("tlx,0,mental,40", "tlx,0,mental,forty", "row 3, column value: must be a finite number (got 'forty')"),
        (",60.0,", ",soon,", "row 2, column asked_s: must be a finite number (got 'soon')"),
        ("answered_utc", "when", "it lacks the columns answered_utc"),
        ("It was quick.", "\xff", "must be UTF-8"),
    ],
)
def test_a_cell_that_cannot_be_used_is_named(old: str, new: str, said: str, tmp_path: Path) -> None:
    """With the file, the row and the column; a form's answer may be any text."""
    run = a_run(tmp_path / "1-A", {}, row("trust", "why", "It was quick."), row("tlx", "mental", 40))
    file = run / "probes.csv"
    file.write_bytes(file.read_bytes().replace(old.encode(), new.encode("latin-1"), 1))
    with pytest.raises(CommandError, match=re.escape(said)) as caught:
        answers(run)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(("missing", "left"), [(3, 1), (2, 0), (1, 0), (None, 0)])
def test_the_summary_counts_questions_not_items(missing: int | None, left: int, tmp_path: Path) -> None:
    """A question that was answered later is no longer missing, however many items it has; workload is scored."""
    person = {"answers_missing": missing, "isa": 2.0}
    run = a_run(tmp_path / "1-A", {"complete": True, "person": person})
    assert summary_of(run) == {"complete": True, "person": person}
    later = (*(row("tlx", name, value) for name, value in SCALES.items()), row("trust", "why", "x"))
    a_run(tmp_path / "1-A.again-1", None, *later)
    assert summary_of(run)["person"] == {"answers_missing": left, "isa": 2.0, "tlx": {"raw": 30.0}}


def test_answers_to_forms_alone_leave_the_scores(tmp_path: Path) -> None:
    """And without a person nothing changes."""
    for name, person in (("1-A", {"answers_missing": 2, "tlx": {"raw": 50.0}}), ("2-B", None)):
        run = a_run(tmp_path / name, {"complete": True, "person": person})
        a_run(tmp_path / f"{name}.again-1", None, row("trust", "why", "x"))
        assert summary_of(run)["person"] == (person and person | {"answers_missing": 1})


KNOWN_AND_TRUE = (
    ("2", "2", "2", 1, 0, 1, 0, 1, 0),
    ("1", "1", "3", 1, 0, 0, -2, 0, -2),
    ("2", "1", "3", 0, 1, 0, -1, 0, -2),
)


def test_right_answers_about_the_situation_are_a_share_of_all_questions(tmp_path: Path) -> None:
    """A question without an answer is not right; who was asked nothing has no share. Older tables lack columns."""
    run = a_run(tmp_path / "1-A", {"complete": True, "person": {"read": 1}})
    assert summary_of(run)["person"] == {"read": 1}
    rows = [SituationRow("sagat", 0, "trees", 9.0, *of) for of in KNOWN_AND_TRUE]
    unanswered = SituationRow("spam", 1, "trees", 9.0, "", "", "3", None, None, None, None, None, None)
    for header, table, (right, true, known) in (
        (SituationRow._fields, [*rows, unanswered], (0.5, 0.25, 1 / 3)),
        (("probe", "is_right"), [("sagat", 1), ("sagat", "")], (0.5, None, None)),
    ):
        write_csv(run / "situation.csv", header, table)
        shares = {"situation_right_share": right, "situation_true_share": true, "situation_known_share": known}
        shares["situation_chance_share"] = None
        assert summary_of(run)["person"] == {"read": 1, **shares}


def test_attempts_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """Those that have ended, with the probes that have an answer; consent is asked for until one is complete."""
    training = a_session(tmp_path, 1, with_criterion()).runs[0]
    assert attempts_at(tmp_path / "nowhere", training) == []
    out = tmp_path / "out"
    a_run(out / "0-training", {"complete": False})
    a_run(out / "0-training-10", {"complete": True})
    a_run(out / "0-training-2.part", None)
    a_run(out / "0-training-3", {"complete": True}, row("tlx", "mental", 4), row("trust", "why"))
    for other in ("0-training-x", "1-A", "0-training.again-1", "0-trainings"):
        a_run(out / other, {"complete": True})
    found = attempts_at(out, training)
    assert [(attempt.folder, attempt.is_valid, attempt.answered) for attempt in found] == [
        ("0-training", False, frozenset()),
        ("0-training-3", True, frozenset({"tlx"})),
        ("0-training-10", True, frozenset()),
    ]
    assert [attempt.scenario.seed for attempt in found] == [training.attempt(number).seed for number in (1, 3, 10)]
    assert [bool(attempt.scenario.operator.probes.consent) for attempt in found] == [True, True, False]


@pytest.mark.parametrize("content", ["", "[]", "{", '{"participant": 1}', "7"])
def test_a_file_that_was_cut_off_is_named(content: str, tmp_path: Path) -> None:
    """The record, or a summary; with what to do."""
    (tmp_path / "session.json").write_text(content)
    with pytest.raises(CommandError, match=r"session.json must be a whole .*; restore it, or move it"):
        read_record(tmp_path)
    (tmp_path / "summary.json").write_text(content)
    with pytest.raises(CommandError, match=r"summary.json must be a whole"):
        summary_of(tmp_path)
