"""Who sets delta: the system's rule, the person's veto, and what the page offers to whom."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.autonomy import Autonomy, next_delta
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import page_hello
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_settings import ISA_ANSWER, SYSTEM, AutonomySettings
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.commands import ArgumentForm, CommandForm, Turn, decode_command
from deltaswarm_wire.operator_messages import Clock, Workload
from tests.support.commanding import GO, briefing, taken_over
from tests.support.tiers import in_one_test
from tests.unit.operator.test_console import say, shown

SET_DELTA = CommandForm("set delta", ("all", "tree"), (ArgumentForm("delta", "integer", 1, 1000, default=4),))
RULE = AutonomySettings(sets_delta=SYSTEM, every_s=20.0, veto_s=5.0)


def console(**table: Any) -> Console:
    """One whose agents accept `set delta`, from a delta of 4 on."""
    settings = {"sets_delta": SYSTEM, "every_s": 20.0, "veto_s": 5.0, **table}
    made = briefing(operator={"threshold_hz": 2.0, "autonomy": settings, "probes": {"isa_every_s": 10.0}})
    return Console(replace(made, forms=(SET_DELTA, GO)))


def close(one: Console, step: int, rate_hz: float) -> Turn:
    workload = Workload(step, float(step), 0, 0, rate_hz, rate_hz, 0.0, 0, 0, 0)
    return one.close_step(Clock(step, float(step), False), workload, (), float(step))


def deltas(turn: Turn) -> list[Any]:
    return [decode_command(signed.body).arguments["delta"] for signed in turn.commands]


@given(
    delta=st.integers(1, 20),
    first=st.integers(1, 20),
    limit=st.integers(1, 20),
    step=st.integers(-9, 9).filter(bool),
    is_high=st.booleans(),
    is_low=st.booleans(),
)
def test_a_change_never_goes_past_its_goal(
    delta: int, first: int, limit: int, step: int, is_high: bool, is_low: bool
) -> None:
    """Towards the limit under load, else back to the first value; never away from its goal."""
    changed = next_delta(delta, first, is_high=is_high, is_low=is_low, step=step, limit=limit)
    goal = limit if is_high else first
    if changed is not None:
        assert is_high or is_low
        assert abs(goal - changed) < abs(goal - delta)
        assert abs(changed - delta) <= abs(step)
        assert (goal - changed) * (goal - delta) >= 0


def test_the_system_proposes_waits_and_commands() -> None:
    """At the limit it stops; with less to do delta returns; between two changes the swarm settles."""
    one = console()
    commanded = {}
    for step in range(140):
        for delta in deltas(close(one, step, 3.0 if step < 70 else 0.5)):
            commanded[step] = delta
    assert commanded == {5: 3, 30: 2, 75: 3, 100: 4}
    acts = [(act.by, act.kind, act.time_s, act.value) for act in one.actions if act.kind == "proposal"]
    assert acts == [("system", "proposal", at_s - 5.0, delta) for at_s, delta in commanded.items()]
    assert one.totals["autonomy"] == {"changes": 4, "vetoes": 0}
    assert [row[12] for row in shown(one)["commands"]] == ["system"] * 4


def test_a_veto_drops_the_proposal_alone() -> None:
    """The next comes after the interval; who is too late is told so; a restarted console goes on with it."""
    one = console()
    one.attend()
    close(one, 0, 3.0)
    assert shown(one)["proposal"] == {"delta": 3, "left_s": 5.0}
    assert say(one, "veto", delta=2)[0]["type"] == "refused"  # one that came late, of an earlier proposal
    assert not say(one, "veto", 1.5, delta=3)
    act = one.actions[-1]
    assert (act.by, act.kind, act.value, act.monotonic_s) == ("person", "veto", 3.0, 1.5)
    assert say(one, "veto")[0]["type"] == "refused"
    for step in range(1, 20):
        assert not deltas(close(one, step, 3.0))
        assert shown(one)["proposal"] is None
    close(one, 20, 3.0)
    other = taken_over(one, has_station=True)
    assert shown(other)["proposal"] == {"delta": 3, "left_s": 5.0}
    assert [deltas(close(other, step, 3.0)) for step in range(21, 26)] == [[], [], [], [], [3]]
    assert other.totals["autonomy"] == {"changes": 1, "vetoes": 1}
    assert other.totals["person"]["commands"] == 0


def test_each_answer_to_isa_is_a_reason_for_one_change() -> None:
    """Above `isa_high` and below `isa_low`, whatever the rate is."""
    settings = replace(RULE, signal=ISA_ANSWER, veto_s=0.0, every_s=0.0)
    one = Autonomy(settings, 1.0, 4)
    answers: list[int] = []
    commanded = []
    for step, answer in enumerate([None, 4, None, 3, 5, 5, 1, None, 2]):
        answers += [] if answer is None else [answer]
        commanded.append(one.close_step(float(step), 9.0, answers))
    assert commanded == [None, 3, None, None, 2, None, 3, None, 4]


def test_who_may_set_delta_is_whom_the_page_offers_it() -> None:
    """A person may neither set it where the system or the swarm does, nor veto where there is nothing to veto."""
    order = {"name": "set delta", "target": {"kind": "all"}, "arguments": {"delta": 2}}
    for who, offered in (("operator", ["set delta", "go"]), ("system", ["go"]), ("swarm", ["go"])):
        one = console(sets_delta=who)
        hello = page_hello(one, "run")
        assert ([form["name"] for form in hello["commands"]], hello["sets_delta"]) == (offered, who)
        assert say(one, "command", **order)[0]["type"] == ("accepted" if who == "operator" else "refused")
        assert say(one, "veto")[0]["type"] == "refused"


def test_a_run_by_the_system_repeats_itself() -> None:
    """In one process too, where nobody vetoes; it differs from the run in which delta stays."""
    keys = ["record=off", "run.duration_s=300", "control.delta=4", "operator.threshold_hz=0.5"]
    system = [*keys, "operator.autonomy.sets_delta=system"]
    first, again, alone = (load_scenario("smoke", overrides) for overrides in (system, system, keys))
    told = [summarise(run_in_process(scenario), scenario) for scenario in (first, again, alone)]
    assert told[0]["digest"] == told[1]["digest"] != told[2]["digest"]
    assert told[0]["autonomy"]["changes"] > 0
    assert "autonomy" not in told[2]


@in_one_test(
    "overrides",
    [
        ["control.mode=potential", "operator.autonomy.sets_delta=system"],
        ["operator.autonomy.sets_delta=swarm"],
        ["operator.autonomy.sets_delta=system", "operator.person.policy=threshold"],
        ["operator.autonomy.delta_step=0"],
        ["operator.autonomy.isa_low=4", "operator.autonomy.isa_high=3"],
    ],
)
def test_what_cannot_work_is_refused(overrides: list[str]) -> None:
    with pytest.raises(SettingsError, match=r"operator\.autonomy"):
        load_scenario("smoke", overrides)


def test_an_adaptive_swarm_sets_it_itself() -> None:
    scenario = load_scenario("smoke", ["control.mode=adaptive", "operator.autonomy.sets_delta=swarm"])
    assert not scenario.has_commander
