"""Settings: the paper's values by default, every mistake found, whatever the table."""

import dataclasses
import math
import typing
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_scenario.scenario import RunSettings, Scenario
from deltaswarm_wire.checked import Problem, SettingsError, check, load, plain
from deltaswarm_wire.keys import Keys
from deltaswarm_wire.plugins import as_recorded
from deltaswarm_wire.settings import AgentSettings
from tests.support.strategies import tables_of
from tests.support.tiers import in_one_test

Path = tuple[str, ...]


def leaves(cls: type[Any], path: Path = ()) -> dict[Path, tuple[Any, dict[str, Any]]]:
    """Every key that holds one value: its type and its limits."""
    found: dict[Path, tuple[Any, dict[str, Any]]] = {}
    hints = typing.get_type_hints(cls)
    for spec in dataclasses.fields(cls):
        hint = hints[spec.name]
        if dataclasses.is_dataclass(hint):
            found |= leaves(typing.cast(type[Any], hint), (*path, spec.name))
        elif typing.get_origin(hint) is None:
            found[*path, spec.name] = hint, dict(spec.metadata)
    return found


LEAVES = leaves(Scenario)
NUMBERS = {path: leaf for path, leaf in LEAVES.items() if leaf[0] in (int, float)}
NO_CASTS: dict[Any, tuple[Any, ...]] = {int: (True, False, "1", 2.0), float: (True, False, "1"), bool: (0, 1, "true")}
"""By the type of a key what another language would take for it."""


def table_with(path: Path, value: Any) -> dict[str, Any]:
    for name in reversed(path):
        value = {name: value}
    return dict(value)


def problems(table: Any, cls: type[Any] = Scenario) -> list[str]:
    with pytest.raises(SettingsError) as caught:
        load(cls, table)
    assert str(caught.value) == "\n".join(map(str, caught.value.problems))
    return [str(problem) for problem in caught.value.problems]


def paths_of(texts: list[str]) -> list[str]:
    return [text.split()[0].rstrip(":") for text in texts]


def of_key(path: Path) -> str:
    return ".".join(path)


def test_an_empty_table_is_the_papers_scenario() -> None:
    """Figures of the Experimental Setup, with 25 agents."""
    scenario = load(Scenario, {})
    assert (scenario.agents.count, scenario.arena.width_m, scenario.arena.height_m) == (25, 100.0, 100.0)
    assert (scenario.run.duration_s, scenario.run.steps) == (9000.0, 9000)
    assert (scenario.events.work_agent_s, scenario.events.rate_hz) == (200.0, 0.05)
    control = PaperSettings()
    assert (scenario.control.mode, control.delta, control.rho) == ("hybrid", 3, 2)
    assert (scenario.agents.sensing_range_m, scenario.radio.range_m) == (5.0, 9.0)


@in_one_test("path", LEAVES)
def test_every_key_says_what_it_is(path: Path) -> None:
    _, limits = LEAVES[path]
    assert limits["doc"]
    assert limits["source"].startswith(("paper", "our reading")) or not limits["source"]


def test_settings_survive_the_way_through_a_table() -> None:
    component = {"weight": 2, "mean_m": [10, 20], "covariance_m2": [[9, 1], [1, 4]]}
    table = {
        "seed": 2**63 - 1,
        "control": {"mode": "decentralised", "recruitment": False},
        "events": {"density": {"kind": "mixture", "components": [component, {}]}},
    }
    scenario = load(Scenario, table)
    assert scenario.events.density.components[0].covariance_m2 == ((9.0, 1.0), (1.0, 4.0))
    assert load(Scenario, plain(scenario)) == scenario


@given(
    st.fixed_dictionaries(
        {},
        optional={
            "seed": st.integers(0, 2**63 - 1),
            "run": st.tuples(st.integers(1, 10_000), st.floats(0.01, 60)).map(
                lambda run: {"duration_s": run[0] * run[1], "step_s": run[1]}
            ),
            "agents": st.fixed_dictionaries({"count": st.integers(1, 10_000)}),
            "radio": st.fixed_dictionaries({"range_m": st.floats(6.1, 1e3), "loss": st.floats(0, 1)}),
            "control": st.fixed_dictionaries(
                {"mode": st.sampled_from(["decentralised", "hybrid", "my:Own"]), "delta": st.integers(1, 1000)}
            ),
        },
    )
)
def test_any_valid_scenario_survives_too(table: dict[str, Any]) -> None:
    scenario = load(Scenario, table)
    assert load(Scenario, plain(scenario)) == scenario
    assert scenario.run.steps >= 1


def test_an_integer_serves_where_a_number_is_meant() -> None:
    """`range_m = 12` in TOML is an integer; it becomes a float."""
    scenario = load(Scenario, {"radio": {"range_m": 12}})
    assert type(scenario.radio.range_m) is float


def test_an_agent_is_told_its_task_and_its_body_alone() -> None:
    """This is the whole list: nothing of the others, of the events, of the run's seed."""
    told = {".".join(path) for path in leaves(AgentSettings)}
    task = {"step_s", "width_m", "height_m", "control.mode"}
    assert told == task | {"seed", "speed_mps", "radius_m", "sensing_range_m", "range_m", "latency_s"}
    seeds = {Scenario(seed=seed).for_agent(agent).seed for seed in (1, 2) for agent in range(10)}
    assert len(seeds) == 20
    assert min(seeds) > 2**32


@in_one_test(
    ("table", "path", "hint"),
    [
        ({"radio": {"rnge_m": 3}}, "radio.rnge_m", "'range_m'"),
        ({"contrl": {}}, "contrl", "'control'"),
        ({"run": {"zzz": 1}}, "run.zzz", "duration_s, step_s"),
        ({"events": {"density": {"kinds": "grid"}}}, "events.density.kinds", "'kind'"),
        ({7: 1}, "7", "schema"),
    ],
)
def test_an_unknown_key_is_a_mistake_with_a_suggestion(table: Any, path: str, hint: str) -> None:
    (text,) = problems(table)
    assert path in text.split(": ")
    assert hint in text


def test_all_mistakes_are_found_at_once() -> None:
    table = {
        "sed": 3,
        "record": "all",
        "run": {"duration_s": -5, "clock": "sundial"},
        "agents": {"count": 0},
        "radio": {"loss": 1.5},
        "events": {"density": {"mean_m": [1, 2, 3], "covariance_m2": [[1, "x"], [2, math.nan]]}},
        "control": [],
    }
    assert [(problem.path, problem.given) for problem in check(Scenario, table)[1]] == [
        ("sed", "unknown key"),
        ("record", "'all'"),
        ("run.duration_s", "-5"),
        ("run.clock", "'sundial'"),
        ("events.density.mean_m", "[1, 2, 3]"),
        ("events.density.covariance_m2[0][1]", "'x'"),
        ("events.density.covariance_m2[1][1]", "nan"),
        ("agents.count", "0"),
        ("radio.loss", "1.5"),
        ("control", "[]"),
    ]


NO_VALUES: tuple[Any, ...] = (
    *(math.nan, math.inf, -math.inf, None, b"x", [], [[]], {}),
    *(10**400, -(10**400), 1 << 20_000),
)


@in_one_test("path", LEAVES)
def test_no_key_takes_what_is_no_value_of_its(path: Path) -> None:
    for value in NO_VALUES:
        (text,) = problems(table_with(path, value))
        assert text.startswith(f"{of_key(path)} must ")
        assert len(text) < 300


@in_one_test("path", [path for path, leaf in LEAVES.items() if leaf[0] in NO_CASTS])
def test_a_value_of_another_type_is_a_mistake(path: Path) -> None:
    """Not a cast: `recruitment = 1`, `delta = true`, and a whole number as a float."""
    for value in NO_CASTS[LEAVES[path][0]]:
        assert paths_of(problems(table_with(path, value))) == [of_key(path)]


@in_one_test("path", NUMBERS)
def test_limits_are_where_they_are_said_to_be(path: Path) -> None:
    """`low` and `high` are allowed themselves, `above` is not; what lies beyond is refused by that key."""
    hint, limits = NUMBERS[path]
    step = 1 if hint is int else 1e-6
    for name, outward in (("low", -step), ("high", step)):
        if limits[name] is not None:
            assert of_key(path) in paths_of(problems(table_with(path, hint(limits[name] + outward * 10))))
            _, found = check(Scenario, table_with(path, hint(limits[name])))
            assert not any(problem.allowed.startswith(("must be a number", "must be an integer")) for problem in found)
    if limits["above"] is not None:
        assert paths_of(problems(table_with(path, hint(limits["above"])))) == [of_key(path)]


MIDDLE = {"corners_m": [[40, 40], [60, 40], [60, 60], [40, 60]]}
EVERYWHERE = {"corners_m": [[0, 0], [100, 0], [100, 100], [0, 100]]}


@in_one_test(
    ("table", "path"),
    [
        ({"name": ""}, "name"),
        ({"name": "a/b"}, "name"),
        ({"name": "-a"}, "name"),
        ({"name": "B\u00e4r"}, "name"),
        ({"name": "x" * 49}, "name"),
        ({"name": "x" * 100_000}, "name"),
        ({"run": {"duration_s": 1, "step_s": 2}}, "run.duration_s"),
        ({"run": {"duration_s": 10, "step_s": 4}}, "run.duration_s"),
        ({"run": {"duration_s": 10, "step_s": 0.3}}, "run.duration_s"),
        ({"events": {"density": {"covariance_m2": [[1e9, 0], [0, 1e9]]}}}, "events.density"),
        (
            {"events": {"density": {"covariance_m2": [[1e-4, 0], [0, 1e-4]]}}, "arena": {"obstacles": [MIDDLE]}},
            "events.density",
        ),
        ({"arena": {"obstacles": [EVERYWHERE]}}, "arena.obstacles"),
        ({"run": {"duration_s": 1e8, "step_s": 0.01}}, "run.duration_s"),
        ({"events": {"density": {"mean_m": [101, 5]}}}, "events.density.mean_m"),
        ({"events": {"density": {"kind": "mixture"}}}, "events.density.components"),
        ({"events": {"density": {"kind": "grid", "file": "a.png"}}}, "events.density.file"),
        ({"events": {"density": {"covariance_m2": [[1, 2], [2, 1]]}}}, "events.density.covariance_m2"),
        ({"events": {"density": {"covariance_m2": [[1, 0], [1, 1]]}}}, "events.density.covariance_m2"),
        ({"events": {"density": {"covariance_m2": [[1e9, 1e9], [1e9, 1e9]]}}}, "events.density.covariance_m2"),
        (
            {"events": {"density": {"kind": "mixture", "components": [{}, {"mean_m": [-1, 0]}]}}},
            "events.density.components[1].mean_m",
        ),
    ],
)
def test_keys_that_do_not_fit_together_are_mistakes(table: Any, path: str) -> None:
    (text,) = problems(table)
    assert text.startswith(f"{path} must ")
    assert len(text) < 300


def test_a_name_makes_the_name_of_a_run() -> None:
    """Every scenario's name is a chunk of a key, with room for what tells its runs apart."""
    name = load(Scenario, {"name": "a" * 48}).name
    assert Keys(f"{name}-0123456789abcde").run


@in_one_test("table", [None, [], "x", 5, [("seed", 1)]])
def test_what_is_no_table_is_one_mistake(table: Any) -> None:
    assert paths_of(problems(table)) == ["settings"]
    assert check(OperatorSettings, table, "operator")[1][0].path == "operator"


def test_a_problem_reads_as_one_line() -> None:
    assert str(Problem("a.b", "7", "must be at most 5")) == "a.b must be at most 5 (got 7)"
    assert str(Problem("a.c", "unknown", "use a.b")) == "a.c: unknown; use a.b"


def test_mistakes_are_found_below_a_path() -> None:
    with pytest.raises(SettingsError, match=r"^run\.step_s must .*0\.01.*60.*got 0"):
        load(RunSettings, {"step_s": 0}, "run")


NAMES = sorted({name for path in LEAVES for name in path} | {"x", "components", "mean_m"})


@given(tables_of(NAMES, ["hybrid", "decentralised", "grid", "mixture", "realtime", 10**400]))
def test_no_table_breaks_the_check(table: dict[str, Any]) -> None:
    made, found = check(Scenario, table)
    assert (made is None) == bool(found)
    assert all(problem.path and problem.allowed and len(str(problem)) < 500 for problem in found)


def test_a_table_as_deep_as_you_like_is_a_mistake_like_any_other() -> None:
    value: list[Any] = []
    for _ in range(5000):
        value = [value]
    [problem] = check(Scenario, {"name": value})[1]
    assert problem.path == "name"
    assert problem.given == "list" or problem.given.startswith("[[")  # from Python 3.12 on it can be printed


@pytest.mark.parametrize(
    ("accepted", "said"), [(1.5, "whole number of agents"), (-0.1, "0"), (11, "at most"), (1e9, "10000")]
)
def test_accepted_losses_are_a_share_or_a_number_of_the_agents(accepted: float, said: str) -> None:
    """Below 1 a share; a number is whole, and no larger than the swarm."""
    table = {"agents": {"count": 10}, "run": {"accept_lost": float(accepted)}}
    [problem] = problems(table)
    assert problem.startswith("run.accept_lost ")
    assert said in problem
    for right in (0, 0.5, 1, 10):
        assert load(Scenario, table_with(("run", "accept_lost"), right)).run.accept_lost == right


def test_a_run_that_was_done_is_read_though_it_would_be_refused_today() -> None:
    """A question in the last step is never asked; older versions did such a run."""
    table = {"run": {"duration_s": 300.0}, "operator": {"probes": {"spam_at_s": [299.5]}}}
    assert [one.path for one in check(Scenario, table)[1]] == ["operator.probes.spam_at_s"]
    with as_recorded():
        assert check(Scenario, table)[1] == []


def test_a_base_is_within_the_arena() -> None:
    for link in ("uplink", "downlink"):
        assert paths_of(problems({link: {"base_m": [50.0, 101.0], "range_m": 60.0}})) == [f"{link}.base_m"]
