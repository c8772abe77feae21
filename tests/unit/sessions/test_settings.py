"""The settings of a session: the criterion of its training, and a training that cannot have the metric."""

from pathlib import Path

import pytest

from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.settings import CriterionSettings, SessionSettings, load_session
from deltaswarm_sessions.variables import MEASURES
from deltaswarm_wire.checked import SettingsError, check
from tests.support.pages import ROOT
from tests.support.sessions import a_file, with_criterion
from tests.support.tiers import in_one_test

ALWAYS = {
    "waiting_time_s.restricted_mean",
    "completed",
    "person.missed_share",
    "person.commands_by_state.done",
    "person.isa",
}


@in_one_test(
    ("values", "outcome"),
    [
        ([], "open"),
        ([4.9], "open"),
        ([None], "open"),
        ([5.0], "reached"),
        ([6.5], "reached"),
        ([6.6], "open"),
        ([1.0, 6.0, None], "reached"),
        ([None, 1.0, 7.0], "not reached"),
        ([1.0, 2.0, 3.0, 4.0], "not reached"),
    ],
)
def test_training_goes_on_until_one_run_is_good_enough_or_all_are_done(
    values: list[float | None], outcome: str
) -> None:
    """Within both bounds, with equality; a run without a value is never good enough."""
    criterion = CriterionSettings("read", at_least=5.0, at_most=6.5, max_runs=3)
    assert criterion.outcome(values) == outcome
    assert criterion.bounds == "at least 5 and at most 6.5"


@pytest.mark.parametrize(
    ("criterion", "met", "missed", "bounds"),
    [
        (CriterionSettings("read", at_least=0.0), 0.0, -0.1, "at least 0"),
        (CriterionSettings("read", at_most=0.0), 0.0, 0.1, "at most 0"),
    ],
)
def test_one_bound_is_enough(criterion: CriterionSettings, met: float, missed: float, bounds: str) -> None:
    """Also if it is 0; three runs unless the file says otherwise."""
    assert (criterion.outcome([met]), criterion.outcome([missed]), criterion.bounds) == ("reached", "open", bounds)
    assert (criterion.max_runs, criterion.if_not_reached) == (3, "go on")
    assert criterion.outcome([missed] * 3) == "not reached"


def test_bounds_are_checked() -> None:
    """Equal ones are allowed, so that a value can be asked for exactly; 1 to 20 runs."""
    table = {"metric": "read", "at_least": 2, "at_most": 2}
    for runs, is_well in ((0, False), (1, True), (20, True), (21, False)):
        assert (check(CriterionSettings, {**table, "max_runs": runs})[1] == []) == is_well
    _, [missing] = check(CriterionSettings, {"metric": "read"})
    assert str(missing) == "at_least must be given, or at_most (got missing)"
    _, [nameless] = check(CriterionSettings, {"at_least": 1})
    assert str(nameless) == "metric must be a column of runs.tsv or a name in summary.json (got missing)"
    assert check(CriterionSettings, {**table, "if_not_reached": "end"})[1] == []


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
        ("situation_right_share", "lacks operator.probes.sagat_at_s, .sagat_count, .spam_at_s or .spam_count"),
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


TASK, WEIGHTED = "operator.task.target_share=0.5", "operator.probes.tlx_weights=true"
TLX, SAGAT = "operator.probes.tlx=true", "operator.probes.sagat_at_s=[30]"


@pytest.mark.parametrize(
    ("metric", "keys", "lacks"),
    [
        ("isa", [], ""),
        ("isa", ["operator.probes.isa_every_s=0"], "operator.probes.isa_every_s"),
        ("tlx_raw", [TLX], ""),
        ("tlx_weighted", [TLX], "operator.probes.tlx_weights"),
        ("tlx_weighted", [TLX, WEIGHTED], ""),
        ("situation_right_share", [SAGAT], ""),
        ("situation_right_share", ["operator.probes.spam_at_s=[30]"], ""),
        ("hits", [], "operator.task.target_share"),
        ("hits", [TASK], ""),
        ("task.d_prime", [TASK], ""),
    ],
)
def test_a_metric_needs_what_it_is_asked_by(metric: str, keys: list[str], lacks: str, tmp_path: Path) -> None:
    """The training's own keys say what is asked."""
    file = a_file(tmp_path, 1, with_criterion(metric))
    file.write_text(file.read_text().replace('"run.duration_s=60"', ", ".join(f'"{one}"' for one in keys)))
    settings, beside = load_session(str(file))
    if not lacks:
        assert plan(settings, 1, beside)[0].criterion == settings.training.criterion
        return
    with pytest.raises(SettingsError) as told:
        plan(settings, 1, beside)
    [problem] = told.value.problems
    assert (problem.path, problem.given) == ("session.training.criterion.metric", repr(metric))
    assert problem.allowed == f"must be a number that the training's runs have; it lacks {lacks}"


def test_a_session_has_defaults() -> None:
    """In a file that says nothing else."""
    settings, problems = check(SessionSettings, {"condition": [{"label": "A"}]})
    assert problems == []
    assert settings is not None
    assert (settings.seed, settings.speed, settings.allocation, settings.arrivals) == (1, 1.0, "random", "crossed")
    assert (settings.consent, settings.set, settings.language, settings.form) == ("", (), "", ())
    assert (settings.training.label, settings.training.scenario, settings.training.criterion) == (
        "training",
        "smoke",
        None,
    )
    assert (settings.condition[0].scenario, settings.condition[0].set) == ("paper-25", ())
    for key, least, most in (("seed", 0, 2**63 - 1), ("speed", 0, 1000)):
        for value, is_well in ((least, True), (most, True), (least - 1, False), (most + 1, False)):
            _, problems = check(SessionSettings, {"condition": [{"label": "A"}], key: value})
            assert (problems == []) == is_well, (key, value)
    for key, value in (("allocation", "in turn"), ("arrivals", "own")):
        assert check(SessionSettings, {"condition": [{"label": "A"}], key: value})[1] == []
    form = {"name": "f", "title": "T", "text": "Read this."}
    made, _ = check(SessionSettings, {"condition": [{"label": "A"}], "form": [form]})
    assert made is not None
    assert made.form[0].when == "between"


def test_the_page_names_every_metric() -> None:
    """Before a session there is no table whose columns could be looked up."""
    page = (ROOT / "docs" / "SESSION.md").read_text(encoding="utf-8")
    assert [name for name in MEASURES if f"`{name}`" not in page] == []
