"""The dense engine has the Python engine's outcome: every digest, record, event and count."""

import math
import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from deltaswarm_agent.controllers.paper.policy import WEIGHTS
from deltaswarm_agent.controllers.paper.settings import PaperSettings
from deltaswarm_dense import engine, layout
from deltaswarm_dense.arithmetic import distance_m
from deltaswarm_dense.coverage import _flat, not_covered, rule
from deltaswarm_dense.engine import run_dense
from deltaswarm_dense.measures import sum_as_numpy
from deltaswarm_dense.membership import table_of
from deltaswarm_dense.setting_up import Room
from deltaswarm_orchestrator.results.run_tables import read_rows
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.engine import Wanted
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_links import CommandSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load, plain
from tests.support.dense import differences, first_difference

DENSE_PLACE = {"kind": "gaussian", "mean_m": [12.0, 9.0], "covariance_m2": [[30.0, 4.0], [4.0, 20.0]]}
FOUR_PLACES = {
    "kind": "mixture",
    "components": [
        {"weight": w, "mean_m": [x, y], "covariance_m2": [[8.0, 0.0], [0.0, 8.0]]}
        for w, x, y in ((1.0, 8.0, 8.0), (2.0, 22.0, 8.0), (3.0, 8.0, 22.0), (1.0, 22.0, 22.0))
    ],
}

OPERATORS: list[dict[str, Any]] = [
    {"person": {"policy": "none"}},
    {"person": {"policy": "none"}, "inbox": {"policy": "grouped"}},
    {"person": {"policy": "threshold", "delta_limit": 1, "command_every_s": 20.0}, "threshold_hz": 0.5},
    {"autonomy": {"sets_delta": "budget"}, "budget": {"every_s": 12.0}, "threshold_hz": 0.5},
    {"autonomy": {"sets_delta": "budget"}, "budget": {"every_s": 12.0, "moves": "price"}, "threshold_hz": 0.5},
    {"autonomy": {"sets_delta": "system", "every_s": 15.0, "veto_s": 3.0, "delta_limit": 1}, "threshold_hz": 0.5},
]

UPLINKS: list[dict[str, Any]] = [
    {"loss": 0.3, "outages": [{"from_s": 20.0, "until_s": 40.0}]},
    {"latency_s": 1.5, "jitter_s": 2.0, "burst": {"p_good_to_bad": 0.1, "p_bad_to_good": 0.2}},
    {"base_m": (0.0, 0.0), "range_m": 20.0},
    {"base_m": (0.0, 0.0), "range_m": 20.0, "relay": True, "loss": 0.1, "bandwidth": {"sender_bytes_per_s": 90.0}},
]

ORDERED = (
    (300.0, "set price", {"message_price": 10.0}),
    (600.0, "set delta", {"delta": 2}),
    (900.0, "set price", {"message_price": 0.0}),
)

FAULTS: list[dict[str, Any]] = [
    {"kind": "kill", "at_s": 20.0, "fraction": 0.3},
    {"kind": "kill", "at_s": 30.0, "roots": True},
    {"kind": "restart", "at_s": 25.0, "fraction": 0.5},
    {"kind": "restart", "at_s": 20.0, "duration_s": 30.0, "roots": True},
    {"kind": "freeze", "at_s": 20.0, "duration_s": 15.0, "fraction": 0.4},
    {"kind": "freeze", "at_s": 10.0, "duration_s": 140.0, "agents": [0]},
    {"kind": "actuator-slow", "at_s": 5.0, "factor": 0.4, "fraction": 0.5},
    {"kind": "actuator-stuck", "at_s": 20.0, "duration_s": 30.0, "roots": True},
    {"kind": "radio-dead", "at_s": 15.0, "duration_s": 20.0, "fraction": 0.5},
    {"kind": "sensor-blind", "at_s": 15.0, "fraction": 0.3},
]

ORDERS: st.SearchStrategy[dict[str, Any]] = st.one_of(
    st.fixed_dictionaries({"delta": st.sampled_from([1, 2.5, 3.2]), "working": st.sampled_from([0.0, 0.4, 1.0])}).map(
        lambda arguments: {"name": "set structure", "arguments": arguments}
    ),
    st.sampled_from(
        [{"name": "set price", "arguments": {"message_price": price}} for price in (0, 0.5, 9.0)]
        + [{"name": "set delta", "arguments": {"delta": 2}}]
    ),
)


def a_policy(seed: int) -> list[float]:
    """Draw a policy under which agents differ and change their minds."""
    drawn = random.Random(seed)
    return [drawn.gauss(0.0, 1.0) for _ in range(WEIGHTS)]


scenarios = st.fixed_dictionaries(
    {
        "seed": st.integers(0, 2**31),
        "control": st.fixed_dictionaries(
            {"mode": st.sampled_from(["decentralised", "hierarchical", "hybrid", "adaptive"])},
            optional={
                "delta": st.integers(1, 5),
                "rho": st.integers(1, 4),
                "recruitment": st.booleans(),
                "dissolution": st.booleans(),
                "d_min_m": st.sampled_from([0.0, 3.0, 6.0]),
                "gamma_max": st.sampled_from([5.0, 40.0]),
                "recruitment_interval_s": st.sampled_from([7.0, 60.0]),
                "recruitment_places": st.sampled_from(["any", "with-events"]),
                "idle_root": st.sampled_from(["stays", "leaves"]),
                "root_succession": st.booleans(),
                "patience_finds": st.sampled_from([0.0, 0.1, 0.5]),
                "return_to_finds": st.booleans(),
                "find_memory_s": st.sampled_from([20.0, 1500.0]),
                "delta_rule": st.sampled_from(["fixed", "busy", "learned", "bandit"]),
                "policy": st.integers(0, 2**32).map(a_policy),
                "message_price": st.sampled_from([0.0, 0.3, 20.0]),
                "report_finds": st.booleans(),
                "leg_max_s": st.sampled_from([3.0, 100.0]),
                "leg_exponent": st.sampled_from([0.0, 1.0, 1.7]),
                "member_observes": st.sampled_from(["nearest", "all"]),
                "report_every_s": st.sampled_from([0.3, 1.0, 5.0]),
                "report_members": st.booleans(),
            },
        ),
        "run": st.fixed_dictionaries(
            {"step_s": st.sampled_from([0.25, 0.5, 1.0, 2.0])}, optional={"ask_every_step": st.booleans()}
        ),
        "arena": st.fixed_dictionaries(
            {"width_m": st.sampled_from([30.0, 47.5]), "height_m": st.sampled_from([30.0, 61.0])}
        ),
        "events": st.fixed_dictionaries(
            {"rate_hz": st.sampled_from([0.05, 0.3, 1.0]), "work_agent_s": st.sampled_from([5.0, 200.0])},
            optional={"density": st.sampled_from([{"kind": "uniform"}, DENSE_PLACE, FOUR_PLACES])},
        ),
        "agents": st.fixed_dictionaries(
            {"count": st.integers(1, 40)},
            optional={"speed_mps": st.sampled_from([0.5, 3.0]), "sensing_range_m": st.sampled_from([2.0, 6.5])},
        ),
        "radio": st.fixed_dictionaries(
            {"range_m": st.sampled_from([6.5, 9.0, 25.0]), "loss": st.sampled_from([0.0, 0.0, 0.2, 0.6])},
            optional={
                "latency_s": st.sampled_from([0.4, 2.5]),
                "jitter_s": st.sampled_from([0.7, 3.0]),
                "duplication": st.just(0.3),
                "contention_bytes_per_s": st.just(300.0),
                "burst": st.just({"p_good_to_bad": 0.1, "p_bad_to_good": 0.2}),
                "bandwidth": st.sampled_from([{"sender_bytes_per_s": 40.0}, {"receiver_bytes_per_s": 200.0}]),
                "asymmetry": st.just({"dead_share": 0.2, "range_factor_low": 0.7}),
                "ranges": st.just([{"agents": [0], "range_m": 15.0}]),
                "reception": st.just("log-distance"),
                "walls": st.just([{"a_m": (10.0, 0.0), "b_m": (10.0, 20.0)}]),
                "jammers": st.just([{"center_m": (10.0, 10.0), "radius_m": 8.0, "from_s": 5.0}]),
                "blackouts": st.just([{"from_s": 20.0, "until_s": 30.0}]),
            },
        ),
        "uplink": st.sampled_from([{}, {}, *UPLINKS]),
        "fault": st.lists(st.sampled_from(FAULTS), max_size=3),
        "operator": st.sampled_from([{}, *OPERATORS]),
        "downlink": st.sampled_from([{}, {"loss": 0.5, "range_m": 20.0, "base_m": (0.0, 0.0), "repeat_s": 2.0}]),
        "command": st.lists(
            st.fixed_dictionaries(
                {
                    "at_s": st.sampled_from([0.0, 10.0, 11.0, 30.0]),
                    "life_s": st.sampled_from([4.0, 120.0]),
                }
            ).flatmap(lambda table: ORDERS.map(lambda order: table | order)),
            max_size=12,
        ),
    }
)
"""Crowded and short, so that trees form, meet, lose members and dissolve within a few minutes."""


def made(table: dict[str, Any], steps: int) -> Scenario:
    run = table["run"] | {"duration_s": steps * table["run"]["step_s"]}
    density = {"density": {"mean_m": [15.0, 15.0]}} | table["events"]
    learns = table["control"].get("delta_rule") in ("learned", "bandit")
    orders = [order for order in table["command"] if learns or order["name"] != "set price"]
    return load(Scenario, table | {"command": orders} | {"run": run, "events": density, "metrics": {"horizon_s": 1.0}})


@settings(deadline=None)
@given(scenarios)
def test_both_engines_have_the_same_outcome(table: dict[str, Any]) -> None:
    """Of any covered scenario: the message that differs is named."""
    scenario = made(table, 200)
    assert not_covered(scenario) == []
    assert differences(scenario) == []


@pytest.mark.parametrize("mode", ["decentralised", "hierarchical", "hybrid", "adaptive"])
def test_every_mode_has_the_same_outcome(mode: str) -> None:
    """Long enough for recruits to arrive, and for roots to meet."""
    assert differences(load_scenario("paper-25", [f"control.mode={mode}", "run.duration_s=1500.0", "seed=11"])) == []


@pytest.mark.parametrize("rule", ["learned", "bandit"])
def test_a_swarm_that_learns_has_the_same_outcome(rule: str) -> None:
    """Long enough for averages to change, with orders that replace what was learned, and bring it back."""
    scenario = load_scenario("paper-25", [f"control.delta_rule={rule}", f"control.policy={a_policy(5)}"])
    orders = tuple(CommandSettings(at_s, name, arguments=arguments) for at_s, name, arguments in ORDERED)
    assert differences(replace(scenario, command=orders, run=replace(scenario.run, duration_s=1500.0))) == []


def test_a_person_who_only_reads_has_the_same_tables(tmp_path: Path) -> None:
    """Whether the console takes in the reports during the run or after it."""
    scenario = load_scenario("smoke", ["operator.person.policy=none", "operator.probes.isa_every_s=30.0"])
    tables = []
    for engine_, name in ((run_in_process, "python"), (run_dense, "dense")):
        folder = tmp_path / name
        folder.mkdir()
        engine_(scenario, Wanted(folder=folder))
        tables.append({file.name: without_wall_times(file) for file in folder.iterdir()})
    assert tables[0] == tables[1]
    assert len(tables[0]["inbox.csv"]) > 20
    assert len(tables[0]["probes.csv"]) > 3


def without_wall_times(file: Path) -> list[dict[str, str]]:
    return [
        {key: cell for key, cell in row.items() if not key.endswith(("utc", "monotonic_s"))} for row in read_rows(file)
    ]


def test_code_from_disk_does_the_same() -> None:
    """As a second process has it."""
    settings = ["control.mode=hybrid", "run.duration_s=100.0"]
    program = f"""
from deltaswarm_dense.engine import run_dense
from deltaswarm_orchestrator.scenarios.load import load_scenario
print(run_dense(load_scenario("smoke", {settings})).digest)
"""
    here = run_dense(load_scenario("smoke", settings)).digest
    there = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (there.returncode, there.stdout.split()) == (0, [here]), there.stderr


def test_a_run_that_needs_more_room_gets_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begun with room for one child and one event, it is begun again, with the same outcome."""
    monkeypatch.setattr(engine, "Room", lambda **room: Room(1, 1, **room))
    assert differences(load_scenario("paper-25", ["run.duration_s=600.0", "events.rate_hz=0.2"])) == []


def test_frames_that_wait_for_long_are_kept_for_longer() -> None:
    """Than those of the steps for which there was room at first."""
    sets = ["run.duration_s=300.0", "radio.bandwidth.sender_bytes_per_s=20", "radio.bandwidth.queue_bytes=400"]
    assert differences(load_scenario("paper-25", sets)) == []


def test_more_orders_than_a_frame_holds_leave_the_base_in_steps() -> None:
    """Also when nobody gives one for long, and a block of steps would be long."""
    order = '{at_s=10, name="set delta", arguments={delta=2}}'
    assert differences(load_scenario("smoke", [f"command=[{', '.join([order] * 20)}]", "run.duration_s=100"])) == []


def test_a_run_that_is_stopped_says_how_far_it_came() -> None:
    """After a block of steps, or before the first."""
    scenario = load_scenario("paper-25", ["run.duration_s=900", "record=off"])
    for blocks, steps in ((0, 0), (1, 500)):
        stops = iter([False] * blocks + [True])
        outcome = run_dense(scenario, Wanted(stopped=lambda stops=stops: next(stops)))
        assert (len(outcome.step_records), len(outcome.workloads), outcome.is_complete) == (steps, steps, False)
        summary = summarise(outcome, scenario)
        assert (summary["steps"], summary["complete"], summary["valid"]) == (steps, False, False)


def test_the_first_difference_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """With its step, its agent and its kind: here of agents that walk a little faster in one engine."""
    real = engine.set_up

    def faster(*arguments: Any, **named: Any) -> Any:
        swarm = real(*arguments, **named)
        swarm.settings["speed_mps"] *= 1.0 + 1e-15
        return swarm

    monkeypatch.setattr(engine, "set_up", faster)
    named = first_difference(load_scenario("smoke", ["control.mode=decentralised", "run.duration_s=20.0"]))
    assert named.startswith("step 0, agent 0, act: python ")


def test_every_key_has_a_rule() -> None:
    """Of the scenario and of the controllers that are covered: a new key must be covered or refused on purpose."""
    for key, _ in _flat(plain(Scenario()) | {"control": plain(PaperSettings())}):
        assert rule(key) is not None


@pytest.mark.parametrize(
    "key",
    [
        "control.mode=potential",
        "run.clock=realtime",
        "run.bound=density",
        "downlink.latency_s=2.0",
        "operator.task.target_share=0.5",
    ],
)
def test_what_is_not_covered_is_named(key: str) -> None:
    """By its key and its value."""
    (found, *more) = not_covered(load_scenario("paper-25", [key]))
    assert found.startswith(key.partition("=")[0])
    assert not more


@pytest.mark.parametrize("kind", ["lying", "sensor-noisy"])
def test_false_sensors_are_not_covered(kind: str) -> None:
    option = {"lying": "phantoms=2", "sensor-noisy": "noise_m=1.0"}[kind]
    fault = f'fault=[{{kind="{kind}", at_s=5.0, agents=[0], {option}}}]'
    assert not_covered(load_scenario("paper-25", [fault])) == [f"fault.kind = {kind!r}"]


def test_other_orders_are_not_covered() -> None:
    """Than those to all agents that set delta or the structure."""
    hold = 'command=[{at_s=40, name="hold", arguments={for_s=40}}]'
    circle = 'command=[{at_s=40, name="set delta", target="circle", numbers=[9, 9, 5], arguments={delta=2}}]'
    assert not_covered(load_scenario("paper-25", [hold])) == ["command 'hold'"]
    assert not_covered(load_scenario("paper-25", [circle])) == ["command 'set delta'"]


def test_sums_are_numpy_s() -> None:
    """To the last bit, also of more values than NumPy adds in one go."""
    total = njit(lambda values: sum_as_numpy(values, 0, values.size))
    values = np.random.default_rng(5).lognormal(size=1100)
    for count in (1, 2, 7, 8, 9, 15, 16, 100, 128, 129, 137, 256, 300, 1000, 1100):
        assert total(values[:count]) == values[:count].sum()


def test_a_table_has_at_most_as_many_rows_as_a_frame() -> None:
    """Children first, then what is below them: of 2 children and 400 agents the last 52 are left out."""
    branches, below = np.zeros(2, layout.BRANCH), np.zeros((1, 2, 200, layout.ROW_FIELDS), np.int64)
    branches["child"], branches["rows"] = (1, 2), 200
    below[0, :, :, layout.AGENT_ID] = np.arange(3, 403).reshape(2, 200)
    agent = SimpleNamespace(id=0, children=2, path_length=1, path=[0])
    trees = SimpleNamespace(
        marks=np.zeros(403, np.int64),
        stamp=np.zeros(1, np.int64),
        children=np.array([[0, 1]]),
        branches=branches.view(np.recarray)[np.newaxis],
        branch_tables=below,
    )
    table = np.zeros((500, layout.ROW_FIELDS), np.int64)
    assert table_of.py_func(agent, trees, table) == 350
    assert table[:351, layout.AGENT_ID].tolist() == [*range(1, 351), 0]


@given(*[st.floats(-1e6, 1e6)] * 4)
def test_distances_are_python_s(ax_m: float, ay_m: float, bx_m: float, by_m: float) -> None:
    """To the last bit, which a root of squares does not give."""
    assert distance_m.py_func(ax_m, ay_m, bx_m, by_m) == math.dist((ax_m, ay_m), (bx_m, by_m))
