"""Warnings about questions whose answer is nearly always the same."""

from pathlib import Path

from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.settings import load_session
from deltaswarm_sessions.trivial_questions import situation_warnings
from tests.support.sessions import a_file

ASKS = "operator.probes.spam_at_s=[20]"


def warnings_of(folder: Path, first: str, second: str) -> list[str]:
    """The warnings about two conditions of a short run, of which each has its keys."""
    shared = f'set = ["run.duration_s=120", "{ASKS}"]'
    file = a_file(folder, 2)
    text = file.read_text().replace("[session]", f"[session]\n{shared}", 1)
    for before, own in (("control.delta=2", first), ("control.delta=3", second)):
        text = text.replace(f'"{before}"', own)
    file.write_text(text)
    settings, beside = load_session(str(file))
    return situation_warnings(plan(settings, 1, beside))


def test_an_answer_that_is_always_right_is_told(tmp_path: Path) -> None:
    """Without trees the number of trees is 0; where there are trees it is not, and neither are events."""
    trees = "\"operator.probes.spam_questions=['trees', 'open_events']\""
    found = warnings_of(tmp_path, f'"control.mode=decentralised", {trees}', trees)
    [about_trees] = [line for line in found if "gives away" in line]
    assert about_trees.startswith("condition A gives away the answer: chance level of trees is 100%")
    assert sum("chance level of" in line for line in found) == 4, "of both questions in both conditions"


def test_a_task_of_one_class_is_told(tmp_path: Path) -> None:
    """Who always says target is right."""
    shares = [f'"operator.task.target_share={share}"' for share in (0.95, 0.5)]
    found = warnings_of(tmp_path, *shares)
    assert "condition A gives away the judgements: 95% of its events are targets" in found


def test_conditions_that_ask_different_questions_are_told(tmp_path: Path) -> None:
    """A share of right answers would differ for it."""
    *_, said = warnings_of(tmp_path, "\"operator.probes.spam_questions=['open_events']\"", '"control.delta=3"')
    assert said.endswith("(A: spam open_events; B: spam open_events, most_events)")
    *_, said = warnings_of(tmp_path, '"control.delta=2"', '"control.delta=3"')
    assert "different questions" not in said
