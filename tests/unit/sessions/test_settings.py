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
    ("criterion", "missed", "bounds"),
    [
        (CriterionSettings("read", at_least=0.0), -0.1, "at least 0"),
        (CriterionSettings("read", at_most=0.0), 0.1, "at most 0"),
    ],
)
def test_one_bound_is_enough(criterion: CriterionSettings, missed: float, bounds: str) -> None:
    """Also if it is 0; three runs unless the file says otherwise."""
    assert (criterion.outcome([0.0]), criterion.outcome([missed]), criterion.bounds) == ("reached", "open", bounds)
    assert (criterion.max_runs, criterion.if_not_reached) == (3, "go on")
    assert criterion.outcome([missed] * 3) == "not reached"


@in_one_test(
    ("table", "wrong"),
    [
        ({"metric": "read", "at_least": 2, "at_most": 2}, []),
        ({"metric": "read", "at_least": 2, "max_runs": 1, "if_not_reached": "end"}, []),
        ({"metric": "read", "at_least": 2, "max_runs": 20}, []),
        ({"metric": "read", "at_least": 2, "max_runs": 21}, ["max_runs"]),
        ({"metric": "read", "at_least": 2, "at_most": 1}, ["at_least"]),
        ({}, ["metric", "at_least"]),
        ({"max_runs": 0, "if_not_reached": "stop", "most": 1}, ["max_runs", "if_not_reached", "most"]),
    ],
)
def test_all_mistakes_of_a_criterion_are_told_at_once(table: dict[str, object], wrong: list[str]) -> None:
    """Equal bounds are allowed, so that a value can be asked for exactly; 1 to 20 runs."""
    assert {problem.path for problem in check(CriterionSettings, table)[1]} == {*wrong}


def test_a_metric_is_a_column_or_a_dotted_name() -> None:
    """True is 1; texts and tables are no values."""
    summary = {"complete": True, "digest": "ff", "delta": {"mean": 2.5}, "person": {"commands_by_state": {"done": 3}}}
    values = {"commands_done": 3.0, "person.commands_by_state.done": 3.0, "delta.mean": 2.5, "complete": 1.0}
    values |= dict.fromkeys(("digest", "delta", "x.y", "delta.mean.x"))
    assert {name: CriterionSettings(name, at_least=1).value(summary) for name in values} == values


TLX, SAGAT, SPAM = "operator.probes.tlx=true", "operator.probes.sagat_at_s=[30]", "operator.probes.spam_at_s=[30]"
TASK, WEIGHTED = "operator.task.target_share=0.5", "operator.probes.tlx_weights=true"
UNKNOWN = "must be a number in summary.json by its dotted name, or one of waiting_time_s"


@pytest.mark.parametrize(
    ("metric", "keys", "said"),
    [
        ("waiting_time_s", [], ""),
        ("waiting_time_s.median", [], ""),
        ("completed", [], ""),
        ("missed_share", [], ""),
        ("commands_done", [], ""),
        ("isa", [], ""),
        ("isa", ["operator.probes.isa_every_s=0"], "it lacks operator.probes.isa_every_s"),
        ("tlx_raw", [], "it lacks operator.probes.tlx"),
        ("tlx_raw", [TLX], ""),
        ("person.tlx.weighted", [TLX], "it lacks operator.probes.tlx_weights"),
        ("tlx_weighted", [TLX, WEIGHTED], ""),
        ("situation_right_share", [], "lacks operator.probes.sagat_at_s, .sagat_count, .spam_at_s or .spam_count"),
        ("situation_right_share", [SAGAT], ""),
        ("situation_right_share", [SPAM], ""),
        ("share_right", [], "it lacks operator.task.target_share"),
        ("hits", [TASK], ""),
        ("task.d_prime", [TASK], ""),
        ("redd", [], UNKNOWN),
        ("frames_dropped", [], UNKNOWN),
    ],
)
def test_a_metric_that_the_training_lacks_is_refused(metric: str, keys: list[str], said: str, tmp_path: Path) -> None:
    """Before a participant trains in vain; the training's own keys say what is asked."""
    file = a_file(tmp_path, 1, with_criterion(metric))
    file.write_text(file.read_text().replace('"run.duration_s=60"', ", ".join(f'"{one}"' for one in keys)))
    settings, beside = load_session(str(file))
    if not said:
        assert plan(settings, 1, beside)[0].criterion == settings.training.criterion
        return
    with pytest.raises(SettingsError) as told:
        plan(settings, 1, beside)
    [problem] = told.value.problems
    assert (problem.path, problem.given) == ("session.training.criterion.metric", repr(metric))
    assert problem.allowed.startswith(said) or problem.allowed.endswith(said)


def test_a_session_has_defaults_and_bounds() -> None:
    """In a file that says nothing else."""
    condition = {"condition": [{"label": "A"}]}
    settings, problems = check(SessionSettings, {**condition, "form": [{"name": "f", "title": "T", "text": "Read."}]})
    assert problems == []
    assert settings is not None
    assert (settings.seed, settings.speed, settings.score) == (1, 1.0, True)
    assert (settings.allocation, settings.arrivals) == ("random", "crossed")
    training = settings.training
    assert (training.label, training.scenario, training.criterion) == ("training", "smoke", None)
    assert (settings.condition[0].scenario, settings.condition[0].set) == ("paper-25", ())
    assert settings.form[0].when == "between"
    for key, least, most in (("seed", 0, 2**63 - 1), ("speed", 0, 1000)):
        for value, is_well in ((least, True), (most, True), (least - 1, False), (most + 1, False)):
            assert (check(SessionSettings, {**condition, key: value})[1] == []) == is_well, (key, value)
    assert check(SessionSettings, {**condition, "allocation": "in turn", "arrivals": "own"})[1] == []


def test_the_page_names_every_metric() -> None:
    """Before a session there is no table whose columns could be looked up."""
    page = (ROOT / "docs" / "SESSION.md").read_text(encoding="utf-8")
    assert [name for name in MEASURES if f"`{name}`" not in page] == []
