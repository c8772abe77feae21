"""The criterion of a training: when to train again, and what becomes of a session whose training is not enough."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.run import report
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.situation import SituationRow
from deltaswarm_sessions.folder import summary_of
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.settings import NOT_REACHED, OPEN, REACHED, CriterionSettings, load_session
from deltaswarm_sessions.variables import MEASURES
from deltaswarm_wire.checked import SettingsError, check
from tests.support.complaints import Printed
from tests.support.pages import ROOT
from tests.support.sessions import a_file, with_criterion

ALWAYS = {
    "waiting_time_s.restricted_mean",
    "completed",
    "person.missed_share",
    "person.commands_by_state.done",
    "person.isa",
}

values = st.none() | st.floats(-10, 10)


@given(st.lists(values, max_size=8), st.floats(-10, 10), st.integers(1, 5))
def test_training_goes_on_until_one_run_is_good_enough_or_all_are_done(
    done: list[float | None], least: float, max_runs: int
) -> None:
    """Whatever the order; a run without a value is never good enough."""
    outcome = CriterionSettings("read", at_least=least, max_runs=max_runs).outcome(done)
    is_met = any(value is not None and value >= least for value in done)
    assert outcome == (REACHED if is_met else OPEN if len(done) < max_runs else NOT_REACHED)


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(0, 10))
def test_both_bounds_hold_at_once(value: float, least: float, width: float) -> None:
    """With equality; at most is at least of the opposite."""
    both = CriterionSettings("read", at_least=least, at_most=least + width)
    assert both.outcome([least]) == both.outcome([least + width]) == REACHED
    assert (both.outcome([value]) == REACHED) == (least <= value <= least + width)
    most = CriterionSettings("read", at_most=-least).outcome([-value])
    assert most == CriterionSettings("read", at_least=least).outcome([value])


def test_a_metric_is_a_column_or_a_dotted_name() -> None:
    """True is 1; texts and tables are no values."""
    summary = {"complete": True, "digest": "ff", "delta": {"mean": 2.5}, "person": {"commands_by_state": {"done": 3}}}
    found = {
        metric: CriterionSettings(metric, at_least=1).value(summary)
        for metric in (
            "commands_done",
            "person.commands_by_state.done",
            "delta.mean",
            "complete",
            "digest",
            "delta",
            "x.y",
        )
    }
    assert [*found.values()] == [3.0, 3.0, 2.5, 1.0, None, None, None]


def test_all_mistakes_of_a_criterion_are_told_at_once() -> None:
    """With what must hold."""
    _, problems = check(CriterionSettings, {"max_runs": 0, "if_not_reached": "stop", "most": 1}, "criterion")
    assert {problem.path for problem in problems} == {f"criterion.{k}" for k in ("max_runs", "if_not_reached", "most")}
    _, problems = check(CriterionSettings, {}, "criterion")
    assert {problem.path for problem in problems} == {"criterion.metric", "criterion.at_least"}
    _, problems = check(CriterionSettings, {"metric": "read", "at_least": 2, "at_most": 1})
    assert [str(problem) for problem in problems] == ["at_least must be at most at_most, 1 (got 2)"]


@pytest.mark.parametrize(
    ("metric", "said"),
    [
        ("redd", "must be a number in summary.json by its dotted name, or one of waiting_time_s"),
        ("situation_right_share", "lacks operator.probes.sagat_at_s or .spam_at_s"),
        ("tlx_raw", "lacks operator.probes.tlx"),
        ("person.tlx.weighted", "lacks operator.probes.tlx_weights"),
        ("waiting_time_s.median", ""),
        ("frames_dropped", "must be a number"),
        ("share_right", "lacks operator.task.target_share"),
        *((name, "") for name, measure in MEASURES.items() if measure.path in ALWAYS),
    ],
)
def test_a_metric_that_the_training_lacks_is_refused(metric: str, said: str, tmp_path: Path) -> None:
    """Before a participant trains in vain."""
    settings, beside = load_session(str(a_file(tmp_path, 2, with_criterion(metric))))
    if not said:
        assert plan(settings, 1, beside)[0].criterion == settings.training.criterion
        return
    with pytest.raises(SettingsError) as told:
        plan(settings, 1, beside)
    [problem] = told.value.problems
    assert problem.path == "session.training.criterion.metric"
    assert said in problem.allowed


def test_right_answers_about_the_situation_are_a_share_of_all_questions(tmp_path: Path) -> None:
    """A question without an answer is not right; who was asked nothing has no share."""
    (tmp_path / "summary.json").write_text(json.dumps({"complete": True, "person": {"read": 1}}))
    assert summary_of(tmp_path) == {"complete": True, "person": {"read": 1}}
    answers = [SituationRow("sagat", 0, "trees", 9.0, *row) for row in (("2", "2", 1, 0), ("", "3", None, None))]
    with (tmp_path / "situation.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([SituationRow._fields, *answers])
    found = CriterionSettings("person.situation_right_share", at_least=1).value(summary_of(tmp_path))
    assert found == 0.5


class Runs:
    """Stands for the command for runs: how many items the person reads in each; None: the run is cut off."""

    def __init__(self, *read: int | None) -> None:
        self.read = list(read)
        self.done: list[str] = []
        self.seeds: list[int] = []
        self.consents: list[bool] = []

    def __call__(self, scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        """Do a run."""
        read = self.read.pop(0) if self.read else 0
        self.done.append(options.out.name)
        self.seeds.append(scenario.seed)
        self.consents.append(bool(scenario.operator.probes.consent))
        options.out.mkdir()
        (options.out / "scenario.toml").write_text(to_toml(scenario))
        summary = {"complete": read is not None, "digest": "d", "person": {"read": read, "answers_missing": 0}}
        (options.out / "summary.json").write_text(json.dumps(summary))
        return 0 if read is not None else 1


def tables(file: Path, folder: Path) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """The row of the only participant, and those of the runs."""
    data = folder / "data"
    assert main(["session", str(file), "--out", str(folder / "out"), "--table", str(data)]) == 0
    rows = {}
    for name in ("participants", "runs"):
        with (data / f"{name}.tsv").open(newline="") as stream:
            rows[name] = list(csv.DictReader(stream, delimiter="\t"))
    return rows["participants"][0], rows["runs"]


def test_training_is_repeated_until_it_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """With other arrivals; runs that were complete before a cut count, and the runs follow only once it is enough."""
    runs = Runs(2, None, 4, 6)
    monkeypatch.setattr(report, "run_and_report", runs)
    file = a_file(tmp_path, 2, with_criterion())
    command = ["session", str(file), "--participant", "1", "--out", str(tmp_path / "out")]
    assert main(command) == 1
    participant, _ = tables(file, tmp_path)
    assert (participant["training_runs"], participant["training_outcome"], participant["complete"]) == (
        "1",
        "open",
        "1",
    )
    capsys.readouterr()
    assert main(command) == 0
    assert "training again (3 of at most 3), since read must be at least 5 (got 2, 4)" in capsys.readouterr().err
    trainings = ["0-training", "0-training-2", "0-training-3", "0-training-4"]
    assert runs.done[:4] == trainings
    assert [name[0] for name in runs.done[4:]] == ["1", "2"]
    assert len(set(runs.seeds)) == 6
    assert runs.consents[:4] == [True, False, False, False]
    participant, rows = tables(file, tmp_path)
    assert (participant["training_runs"], participant["training_outcome"]) == ("3", "reached")
    assert (participant["runs"], participant["complete"]) == ("3", "3")
    found = {row["run"]: (row["position"], row["training_value"]) for row in rows}
    assert [found[name] for name in trainings] == [("0", "2.0"), ("0", ""), ("0", "4.0"), ("0", "6.0")]
    assert [found[name][1] for name in runs.done[4:]] == ["", ""]
    assert main(command) == 0
    assert len(runs.done) == 6, "nothing is left to do, and the scenarios are as planned"


@pytest.mark.parametrize(("then", "code", "count"), [("go on", 0, 4), ("end", 1, 2)])
def test_a_session_whose_training_is_not_enough(
    then: str, code: int, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """It goes on or ends, as the file says, says so, and marks the participant; the same when it is continued."""
    runs = Runs(1, 2)
    monkeypatch.setattr(report, "run_and_report", runs)
    file = a_file(tmp_path, 2, with_criterion(more=f'max_runs = 2\nif_not_reached = "{then}"'))
    command = ["session", str(file), "--participant", "1", "--out", str(tmp_path / "out")]
    for _ in range(2):
        assert main(command) == code
        said = "the criterion of the training is not reached: read must be at least 5 (got 1, 2); the session"
        assert said in capsys.readouterr().err
        assert len(runs.done) == count
    participant, _ = tables(file, tmp_path)
    assert (participant["training_runs"], participant["training_outcome"]) == ("2", "not reached")


def test_the_page_names_every_metric() -> None:
    """Before a session there is no table whose columns could be looked up."""
    page = (ROOT / "docs" / "SESSION.md").read_text(encoding="utf-8")
    assert [name for name in MEASURES if f"`{name}`" not in page] == []
