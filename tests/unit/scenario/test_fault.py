"""Fault tables: each mistake has one clear message, and what is allowed survives the way through TOML."""

import tomllib
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.fault import FaultSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import check, load
from deltaswarm_wire.plugins import FAULTS
from tests.support.complaints import mistakes
from tests.support.tiers import in_one_test

KILL = {"kind": "kill", "at_s": 5.0}


@in_one_test(
    ("fault", "said"),
    [
        ({**KILL, "kind": "kil", "roots": True}, ("kind", "'kil'; did you mean 'kill'?")),
        ({**KILL, "kind": "x", "roots": True}, ("kind", "'x'")),
        ({"at_s": 5, "roots": True}, ("kind", "nothing")),
        ({"kind": "kill", "roots": True}, ("at_s", "nothing")),
        ({**KILL, "at_s": -1, "roots": True}, ("at_s", "-1")),
        ({**KILL, "at_s": 300, "roots": True}, ("at_s", "300")),
        ({**KILL, "at_s": 1e9, "roots": True}, ("at_s", "1000000000")),
        ({**KILL, "agents": [1, 6, 9]}, ("agents", "6, 9")),
        ({**KILL, "agents": [-1]}, ("agents[0]", "-1")),
        ({**KILL, "agents": [1, 1]}, ("agents", "[1, 1]")),
        (KILL, ("agents", "0 targets")),
        ({**KILL, "agents": []}, ("agents", "0 targets")),
        ({**KILL, "agents": [1], "roots": True}, ("agents", "2 targets")),
        ({**KILL, "fraction": 1.1}, ("fraction", "1.1")),
        ({**KILL, "fraction": 0.3, "root": True}, ("root", "unknown key")),
        ({**KILL, "kind": "freeze", "roots": True}, ("duration_s", "nothing")),
        ({**KILL, "duration_s": 3, "roots": True}, ("duration_s", "3")),
        ({**KILL, "kind": "actuator-slow", "roots": True}, ("factor", "nothing")),
        ({**KILL, "kind": "sensor-noisy", "roots": True}, ("noise_m", "nothing")),
        ({**KILL, "kind": "lying", "roots": True}, ("phantoms", "nothing")),
        ({**KILL, "factor": 0.5, "roots": True}, ("factor", "unknown key")),
    ],
)
def test_a_mistake_is_one_message(fault: dict[str, Any], said: tuple[str, str]) -> None:
    table = {"run": {"duration_s": 300}, "agents": {"count": 6}, "fault": [{**KILL, "agents": [0]}, fault]}
    assert mistakes(table) == [(f"fault[1].{said[0]}", said[1])]


def test_a_timeline_survives_the_way_through_toml() -> None:
    timeline = 'fault=[{kind="freeze",at_s=1,duration_s=2.5,agents=[3,1]},{kind="lying",at_s=0,roots=true,phantoms=2}]'
    scenario = load_scenario("smoke", [timeline])
    assert [fault.kind for fault in scenario.fault] == ["freeze", "lying"]
    assert load(Scenario, tomllib.loads(to_toml(scenario))) == scenario


def test_each_kind_and_detail_is_explained() -> None:
    page = (Path(__file__).parents[3] / "docs" / "FAULTS.md").read_text()
    for name in (*FAULTS.shipped, "noise_m", "miss", "factor", "phantoms", "duration_s"):
        assert f"`{name}`" in page


@given(st.floats(0, 1e6), st.floats(1e-3, 1e6), st.sampled_from([0.1, 0.3, 1.0, 7.0]))
def test_a_fault_begins_with_the_first_step_at_its_time_and_lasts_a_step_at_least(
    at_s: float, duration_s: float, step_s: float
) -> None:
    """Rounding is up, but for what floats make of an exact step."""
    fault = FaultSettings("freeze", at_s, duration_s, roots=True)
    begins, ends = fault.begins(step_s), fault.ends(step_s)
    assert ends is not None
    assert (begins - 1) * step_s < at_s <= begins * step_s + 1e-6 * step_s
    assert ends > begins
    assert FaultSettings("kill", begins * step_s, roots=True).begins(step_s) == begins
    assert FaultSettings("kill", at_s, roots=True).ends(step_s) is None


@given(
    st.dictionaries(st.sampled_from(["kind", "at_s", "duration_s", "agents", "fraction", "roots", "miss"]), st.none())
)
def test_nothing_is_no_value(table: dict[str, Any]) -> None:
    made, found = check(FaultSettings, table)
    assert made is None
    assert found
