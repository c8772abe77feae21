"""The rule that keeps a budget of messages: what it orders, within which bounds, and what comes of it in a swarm."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.budget import Budget, Structure
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_settings import BudgetSettings
from deltaswarm_wire.checked import SettingsError

PLAIN = BudgetSettings(aim=0.5, average_s=1e-9, every_s=10.0, gain=1.0, taken_off=0.1, delta_per_min=0.6)
"""The newest rate is the average, so that orders can be worked out by hand."""


def rule(settings: BudgetSettings = PLAIN, step_s: float = 1.0, **structure: float) -> Budget:
    """One with a budget of 4 messages per s, and so an aim of 2 under PLAIN."""
    return Budget(settings, 4.0, step_s, Structure(**{"delta": 3.0, "working": 1.0, **structure}))


def orders(one: Budget, rates: list[float], step_s: float = 1.0) -> dict[float, Structure]:
    """The orders by their times, for one rate per step."""
    given = ((step * step_s, one.close_step(step * step_s, rate)) for step, rate in enumerate(rates))
    return {now_s: order for now_s, order in given if order is not None}


def test_twice_the_aim_takes_half_of_the_agents_off() -> None:
    """At 10 s working is 1 x 2/4; delta falls by 0.6 x (0.5 - 0.1) x 10/60 = 0.04; at 20 s all of it once more."""
    assert orders(rule(), [4.0] * 25) == {10.0: Structure(2.96, 0.5), 20.0: Structure(2.9, 0.25)}


def test_room_brings_all_back_and_lets_delta_rise() -> None:
    """Below the aim: 0.5 x 2/1.6 = 0.63, then 0.78, 0.98, 1; at 1 delta rises by 0.6 x 0.1 x 10/60 = 0.01."""
    given = list(orders(rule(working=0.5), [1.6] * 61).values())
    assert [order.working for order in given] == [0.62, 0.78, 0.98, 1.0, 1.0, 1.0]
    assert given[-1].delta - given[-2].delta == pytest.approx(0.01)


def test_the_same_in_steps_of_half_a_second() -> None:
    """Orders follow the time and the average follows time too, whatever a step is."""
    settings = BudgetSettings(average_s=20.0, every_s=7.0)
    whole = orders(rule(settings), [6.0] * 60)
    half = orders(rule(settings, step_s=0.5), [6.0] * 120, 0.5)
    assert list(whole) == list(half)
    for now_s, order in whole.items():
        assert order == pytest.approx(half[now_s], abs=0.03)


def test_what_differs_by_less_than_a_hundredth_is_not_ordered() -> None:
    """At its aim and at its bound the rule is silent."""
    assert not orders(rule(delta=4.0), [2.0] * 200)


@given(rates=st.lists(st.floats(0, 1000), max_size=300), gain=st.floats(0, 5), per_min=st.floats(0, 100))
def test_orders_are_always_such_as_agents_accept(rates: list[float], gain: float, per_min: float) -> None:
    """Delta from 2 to its highest, and a share above 0 up to 1, after no matter which rates."""
    one = rule(BudgetSettings(gain=gain, delta_per_min=per_min, every_s=0.0))
    for order in orders(one, rates).values():
        assert 2 <= order.delta <= 4
        assert 0 < order.working <= 1


def test_a_swarm_keeps_its_budget_better_than_without_the_rule() -> None:
    """By the operator's own count; the run repeats itself."""
    keys = ["record=off", "control.mode=adaptive", "operator.threshold_hz=2.5", "run.duration_s=900", "seed=3"]
    budget = [*keys, "operator.autonomy.sets_delta=budget"]
    scenarios = [load_scenario("smoke", overrides) for overrides in (budget, budget, keys)]
    first, again, alone = (summarise(run_in_process(scenario), scenario) for scenario in scenarios)
    assert first["digest"] == again["digest"] != alone["digest"]
    assert first["operator_time_above_threshold_s"] < 0.5 * alone["operator_time_above_threshold_s"]
    assert first["autonomy"]["changes"] > 0


@pytest.mark.parametrize("mode", ["decentralised", "potential"])
def test_a_swarm_without_such_an_order_cannot_keep_a_budget(mode: str) -> None:
    """Where every agent refuses the order, the run would say nothing; it is refused before."""
    with pytest.raises(SettingsError, match=r"operator\.autonomy\.sets_delta"):
        load_scenario("smoke", [f"control.mode={mode}", "operator.autonomy.sets_delta=budget"])


def test_a_budget_of_nothing_is_refused() -> None:
    """The rule divides by it; before the run, by its key."""
    with pytest.raises(SettingsError, match=r"operator\.threshold_hz"):
        load_scenario("smoke", ["operator.threshold_hz=0", "operator.autonomy.sets_delta=budget"])
    assert load_scenario("smoke", ["operator.threshold_hz=0"])
