"""What an agent does every so many seconds: as often as that, whatever the length of a step."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.recurring import Recurring
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario

STEPS_S = st.integers(1, 400).map(lambda hundredths: hundredths / 100)


@given(STEPS_S, STEPS_S, st.integers(1, 300))
def test_it_occurs_every_so_many_seconds(step_s: float, every_s: float, steps: int) -> None:
    """At most a step late and without drift; with longer steps, once a step."""
    recurring = Recurring(every_s)
    times_s = [step * step_s for step in range(steps) if recurring.is_due(step * step_s)]
    step, every = Fraction(str(step_s)), Fraction(str(every_s))
    if step >= every:
        assert len(times_s) == steps
        return
    expected = [math.ceil(number * every / step) for number in range(math.floor((steps - 1) * step / every) + 1)]
    assert times_s == [number * step_s for number in expected if number < steps]


@given(STEPS_S, st.floats(0.1, 50))
def test_after_a_pause_it_occurs_at_once(every_s: float, pause_s: float) -> None:
    """And then again after the whole interval, not all that was missed at once."""
    recurring = Recurring(every_s)
    assert recurring.is_due(0.0)
    now_s = every_s + pause_s
    assert recurring.is_due(now_s)
    in_turn_s = 2 * every_s if pause_s < every_s - 1e-6 else now_s + every_s
    assert not recurring.is_due(in_turn_s - min(every_s, 0.01) / 2)
    assert recurring.is_due(in_turn_s)


@pytest.mark.parametrize("mode", ["decentralised", "hybrid", "potential"])
def test_the_operator_gets_as_many_messages_with_any_step(mode: str) -> None:
    """Per second, within what other dynamics change; per step there are a quarter and twice as many."""

    def messages(*sets: str) -> float:
        base = ["run.duration_s=100", "events.rate_hz=0.3", f"control.mode={mode}", "record=off"]
        runs = [run_in_process(load_scenario("smoke", [*base, *sets], seed)) for seed in (1, 2)]
        return sum(workload.messages for run in runs for workload in run.workloads) / 200

    by_second = messages()
    assert messages("run.step_s=0.25") == pytest.approx(by_second, rel=0.2)
    assert messages("control.report_every_s=4") == pytest.approx(by_second / 4, rel=0.1)
    assert messages("run.step_s=2") == pytest.approx(by_second / 2, rel=0.2)
