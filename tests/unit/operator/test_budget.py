"""The rule that keeps a budget of messages: what it orders, within which bounds, and what comes of it in a swarm."""

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.budget import Budget, Price, Structure, budget_of, structure_at
from deltaswarm_operator.core.command_log import MAX_QUEUE
from deltaswarm_operator.core.console import Console
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.run.operating import briefing_of
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_settings import BudgetSettings
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.commands import Target
from deltaswarm_wire.operator_messages import Clock, Workload

PLAIN = BudgetSettings(aim=0.5, every_s=10.0, gain=0.5, highest_delta=3.0, highest_rho=4.0)
"""Under a budget of 4 it aims at 2."""


def rule(settings: BudgetSettings = PLAIN, delta: float = 2.0, working: float = 1.0) -> Budget:
    return Budget(settings, 4.0, Structure(delta, working))


def orders(one: Budget, rates: Iterable[float], step_s: float = 1.0) -> dict[float, Any]:
    given = ((step * step_s, one.order(step * step_s, rate)) for step, rate in enumerate(rates))
    return {now_s: order for now_s, order in given if order is not None}


def test_too_many_messages_take_agents_off_and_then_raise_rho() -> None:
    """At twice the aim the level falls by a half per order: all work, half of them, nobody; then trees from 2.5 on."""
    assert orders(rule(), [4.0] * 51) == {
        10.0: Structure(2.0, 0.5),
        20.0: Structure(2.0, 0.0),
        30.0: Structure(2.5, 0.0),
        40.0: Structure(3.0, 0.0),
        50.0: Structure(3.5, 0.0),
    }


def test_a_flood_counts_as_three_times_the_aim() -> None:
    """Else a burst would take the swarm down to its lowest level at once."""
    assert orders(rule(), [1000.0] * 11) == orders(rule(), [6.0] * 11) == {10.0: Structure(2.0, 0.0)}


def test_room_brings_all_back_and_then_raises_delta() -> None:
    """Without messages the level rises by a half per order, up to the highest delta."""
    given = list(orders(rule(delta=3.0, working=0.0), [0.0] * 71).values())
    assert given[:3] == [Structure(2.5, 0.0), Structure(2.0, 0.0), Structure(2.0, 0.5)]
    assert given[3:] == [Structure(2.0, 1.0), Structure(2.5, 1.0), Structure(3.0, 1.0), Structure(3.0, 1.0)]


def test_a_level_beyond_its_bounds_stays_where_it_is_put() -> None:
    """A fixed structure of the rule's own scale: with a gain of 0 it is ordered again and again, whatever arrives."""
    for level, structure in ((0.25, Structure(2.0, 0.25)), (4.5, Structure(5.5, 1.0)), (-7.0, Structure(9.0, 0.0))):
        fixed = load_scenario(
            "smoke",
            [
                'operator.autonomy.sets_delta="budget"',
                "operator.budget.gain=0",
                f"operator.budget.first_level={level}",
            ],
        )
        one = budget_of(briefing_of(fixed))
        assert one is not None
        assert set(orders(one, [100.0] * 200).values()) == {structure}


def test_a_rule_can_move_the_price_of_a_message() -> None:
    """At twice the aim it rises by a factor of e to the half per order, at most to 20 s; without messages it falls."""
    one = Budget(PLAIN, 4.0, Price(1.0))
    prices = [order.message_price for order in orders(one, [4.0] * 71).values() if isinstance(order, Price)]
    assert prices == pytest.approx([1.649, 2.718, 4.482, 7.389, 12.182, 20.086, 20.086], rel=0.001)
    one = Budget(PLAIN, 4.0, Price(0.0))
    assert list(orders(one, [0.0] * 11).values()) == [Price(0.05)]


def test_a_rule_begins_with_the_price_of_the_scenario() -> None:
    keys = ["control.delta_rule=learned", "control.message_price=2.5", "operator.autonomy.sets_delta=budget"]
    budget = budget_of(briefing_of(load_scenario("smoke", [*keys, "operator.budget.moves=price"])))
    assert budget is not None
    assert (budget.structure, budget.command) == (Price(2.5), "set price")
    with pytest.raises(SettingsError, match="needs a controller that accepts 'set price'"):
        load_scenario("smoke", [*keys[2:], "control.mode=hybrid", "operator.budget.moves=price"])


def test_an_order_is_repeated_though_nothing_changes() -> None:
    """At its aim the rule says the same again, for those that did not hear it."""
    assert orders(rule(), [2.0] * 21) == {10.0: Structure(2.0, 1.0), 20.0: Structure(2.0, 1.0)}


def test_a_delta_above_the_highest_falls_step_by_step() -> None:
    """It is not raised, and at a rate of twice the aim it falls by a half."""
    assert orders(rule(delta=10.0), [4.0] * 11) == {10.0: Structure(9.5, 1.0)}
    assert orders(rule(delta=10.0), [0.0] * 11) == {10.0: Structure(10.0, 1.0)}


def test_a_delta_of_1_counts_as_2() -> None:
    """A swarm with it is no less centralised than one whose agents found trees at 2."""
    assert orders(rule(delta=1.0), [2.0] * 11) == {10.0: Structure(2.0, 1.0)}


@pytest.mark.parametrize("step_s", [0.5, 0.1, 3.0])
def test_orders_follow_the_time_and_not_the_steps(step_s: float) -> None:
    """Each interval has one, at most a step late, and lateness does not add up."""
    times_s = list(orders(rule(), [6.0] * round(120 / step_s), step_s))
    assert len(times_s) == 11
    assert all(0 <= time_s - 10 * place + 1e-6 < step_s for place, time_s in enumerate(times_s, start=1))


@given(rates=st.lists(st.floats(0, 1000), max_size=300), gain=st.floats(0, 5), delta=st.floats(1, 20))
def test_orders_are_always_such_as_agents_accept(rates: list[float], gain: float, delta: float) -> None:
    """After no matter which rates; never above the highest delta unless the swarm began there."""
    for order in orders(rule(BudgetSettings(gain=gain, every_s=1.0), delta), rates).values():
        assert 2 <= order.delta <= (max(3.0, delta) + 0.01 if order.working == 1 else 8.0)
        assert 0 <= order.working <= 1


@given(st.floats(-6, 5))
def test_a_structure_is_that_of_its_level(level: float) -> None:
    """So a branch that takes over an order goes on from it."""
    assert structure_at(level).level == pytest.approx(level, abs=0.006)


def console_with_budget() -> tuple[Console, Budget]:
    """With an aim of 4.5 messages per s, and a delta of 2."""
    keys = ["control.mode=adaptive", "control.delta=2", "operator.autonomy.sets_delta=budget"]
    console = Console(briefing_of(load_scenario("smoke", keys)))
    assert console.budget is not None
    return console, console.budget


def close(console: Console, step: int, rate_1s_hz: float, rate_60s_hz: float) -> None:
    console.close_step(
        Clock(step, float(step), False), Workload(step, step, 0, 0, rate_1s_hz, rate_60s_hz, *[0] * 4), [], step
    )


def test_the_rule_follows_the_rate_over_a_minute_and_changes_are_counted() -> None:
    """Three orders, of which the first and the last say something new."""
    console, _ = console_with_budget()
    for step, rate_hz in ((30, 4.5), (60, 4.5), (90, 9.0)):
        close(console, step, 0.0, rate_hz)
    working = [sent.command.arguments["working"] for sent in console.command_log.sent]
    assert (working, console.totals["autonomy"]["changes"]) == ([1.0, 1.0, 0.8], 2)
    assert set(console.command_log.outcomes(90.0)["commands_by_state"].values()) == {0}  # these are the person's


def test_an_order_waits_for_room() -> None:
    console, budget = console_with_budget()
    for _ in range(MAX_QUEUE):
        console.command("person", "resume", Target(), {})
    before = budget.structure
    close(console, 60, 9.0, 9.0)
    assert (budget.structure, len(console.command_log.sent)) == (before, MAX_QUEUE)


def test_a_swarm_keeps_its_budget_better_than_without_the_rule() -> None:
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
    with pytest.raises(SettingsError, match=r"operator\.autonomy\.sets_delta") as caught:
        load_scenario("smoke", [f"control.mode={mode}", "operator.autonomy.sets_delta=budget"])
    assert "set structure," not in str(caught.value).partition("accepts:")[2]


def test_orders_are_to_hundredths() -> None:
    """Of delta and of the share that works."""
    assert structure_at(1.23456) == Structure(2.23, 1.0)
    assert structure_at(0.45678) == Structure(2.0, 0.46)


def test_no_rule_keeps_a_budget_unless_it_is_asked_for() -> None:
    """Even where delta can be set."""
    assert budget_of(briefing_of(load_scenario("smoke", []))) is None
    assert budget_of(briefing_of(load_scenario("smoke", ["operator.autonomy.sets_delta=budget"]))) is not None


@pytest.mark.parametrize("budget_hz", ["0", "5e-324", "0.009"])
def test_a_budget_of_nothing_is_refused(budget_hz: str) -> None:
    """The rule divides by it; before the run, by its key."""
    with pytest.raises(SettingsError, match=r"operator\.threshold_hz"):
        load_scenario("smoke", [f"operator.threshold_hz={budget_hz}", "operator.autonomy.sets_delta=budget"])
    assert load_scenario("smoke", ["operator.threshold_hz=0"])
