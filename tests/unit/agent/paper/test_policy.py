"""The learned rule: what a policy makes of an agent's own experience, and what the operator's price changes."""

import json
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper import policy
from deltaswarm_agent.controllers.paper.commands import obey
from deltaswarm_agent.controllers.paper.experience import FADING_S, Experience
from deltaswarm_agent.controllers.paper.finds import Finds
from deltaswarm_agent.controllers.paper.policy import INPUTS, WEIGHTS, Structure, policy_of, structure_of
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.commands import Command, Target
from tests.support.cores import PARENT_AT, Lone, agent_settings, attending, event, lives, near_frames
from tests.support.tiers import in_one_test

UNTRAINED = (0.0,) * WEIGHTS
WORKING_AT = 1 + len(INPUTS)
"""Where the numbers of the second output begin: its constant, then those of inputs."""


def weights(**given: float) -> tuple[float, ...]:
    """Return a policy with these numbers, by the place in it (`n12`)."""
    made = list(UNTRAINED)
    for name, value in given.items():
        made[int(name[1:])] = value
    return tuple(made)


def by_price(weight: float) -> tuple[float, ...]:
    """Return a policy by which a price lets all work, or none."""
    return weights(**{f"n{WORKING_AT + 1 + INPUTS.index('price')}": weight})


def learner(numbers: Sequence[float] = UNTRAINED, **control: Any) -> Lone:
    return Lone(mode="hybrid", delta_rule="learned", policy=list(numbers), **control)


def inputs_of(lone: Lone) -> tuple[float, ...]:
    agent = lone.core.controller.agent
    assert agent.experience is not None
    assert agent.finds is not None
    return agent.experience.inputs(agent.finds, agent.state is State.ATTENDING, agent.price_s, agent.now)


@pytest.mark.parametrize("mode", ["hybrid", "adaptive"])
def test_an_untrained_swarm_does_what_delta_3_does(mode: str) -> None:
    """To every event happens the same, at the same times; only averages are on the air besides."""
    keys = [f"control.mode={mode}", "run.duration_s=600", "events.rate_hz=0.1", "radio.loss=0.1"]
    fixed = run_in_process(load_scenario("paper-25", [*keys, "control.delta_rule=fixed"]))
    untrained = [*keys, "control.delta_rule=learned", f"control.policy={list(UNTRAINED)}"]
    learned = run_in_process(load_scenario("paper-25", untrained))
    assert learned.events_digest == fixed.events_digest
    assert max(record.trees for record in fixed.step_records) > 1


@in_one_test(
    ("constant", "rank", "founds_at"),
    [(0.0, 0.0, 3), (0.5, 0.4, 5), (0.5, 0.6, 4), (-0.2, 0.3, 3), (-0.2, 0.5, 2), (-9.0, 0.9, 2), (3.1, 0.0, None)],
)
def test_delta_is_split_over_agents_by_rank_within_bounds(constant: float, rank: float, founds_at: int | None) -> None:
    """3 and three times the output: 4.5 is 5 for one half and 4 for the other; below 2 it is 2, above 12 never."""
    assert structure_of(weights(n0=constant), [0.0] * len(INPUTS), rank).founds_at == founds_at


@in_one_test(
    ("constant", "rank", "attends"), [(0.0, 0.999, True), (2.0, 0.999, True), (-0.4, 0.59, True), (-0.4, 0.61, False)]
)
def test_a_share_of_the_agents_works(constant: float, rank: float, attends: bool) -> None:
    assert structure_of(weights(**{f"n{WORKING_AT}": constant}), [0.0] * len(INPUTS), rank).attends is attends


def test_outputs_are_weighted_sums() -> None:
    """Of delta 1 and twice the third input of 0.5; of working -1 and half of the last input of 1."""
    numbers = weights(n0=1.0, n3=2.0, **{f"n{WORKING_AT}": -1.0, f"n{WORKING_AT + len(INPUTS)}": 0.5})
    inputs = [0.0, 0.0, 0.5] + [0.0] * (len(INPUTS) - 4) + [1.0]
    assert policy.outputs(numbers, inputs) == (2.0, -0.5)
    assert structure_of(numbers, inputs, 0.6) == Structure(9, False)


@given(lives(near_frames(), steps=20))
def test_inputs_are_from_minus_1_to_1(life: list[tuple[list[Any], list[Any]]]) -> None:
    lone = learner()
    for heard, sensed in life:
        lone.step(*heard, events=sensed, skip=1)
        assert all(-1.0 <= value <= 1.0 for value in inputs_of(lone))


PLACES = st.lists(st.tuples(st.sets(st.integers(0, 4)), st.sets(st.integers(0, 4))), min_size=1, max_size=15)


@given(PLACES, st.permutations(range(5)), st.permutations(range(5)))
def test_who_is_who_changes_nothing(
    life: list[tuple[set[int], set[int]]], events: list[int], senders: list[int]
) -> None:
    """Numbers of events and of agents tell an agent nothing: only where something is, and how often."""

    def lived(event_ids: list[int], sender_ids: list[int]) -> list[tuple[float, ...]]:
        lone, told = learner(), []
        for sensed, heard in life:
            lone.step(
                *(attending(20 + sender_ids[n], (52.0 + n, 51.0), 9, (54.0, 50.0 + n)) for n in heard),
                events=[event(10 + event_ids[n], 50.5 + 0.7 * n, 50.0) for n in sensed],
            )
            told.append(inputs_of(lone))
        return told

    assert lived(events, senders) == lived(list(range(5)), list(range(5)))


def test_experience_by_hand() -> None:
    """Two events for 10 s, one agent attending heard for 5 s, and 3 reports; then nothing for as long as it fades."""
    own, finds = Experience(1.0), Finds(agent_settings())
    for step in range(10):
        own.note(2, [attending(5, PARENT_AT, 1, PARENT_AT)] if step < 5 else [], step)
    for step in (7, 8, 9):
        own.report(step)
    own.found = own.changed = 0
    now = 9 + round(FADING_S)
    told = dict(zip(INPUTS, own.inputs(finds, False, 3.0, now), strict=True))
    crowd, heard, reports = (60 + 20) / (60 + 10), 5 / FADING_S / 2.72, 3 / FADING_S / 2.72
    assert told["crowd"] == pytest.approx((crowd - 2) / (crowd + 2), abs=0.01)
    assert told["attending_heard"] == pytest.approx((heard - 0.5) / (heard + 0.5), abs=0.01)
    assert told["reports"] == pytest.approx((reports - 0.1) / (reports + 0.1), abs=0.01)
    assert (told["members_heard"], told["in_trees"], told["attends"], told["price"]) == (-1.0, -1.0, -1.0, 0.5)
    assert told["since_find"] == pytest.approx((now - 100) / (now + 100))


def test_who_is_not_to_work_ends_what_it_has_begun() -> None:
    """Under a higher price it goes on with its event, and then leaves others alone."""
    lone, first, second = learner(by_price(-2.0), message_price=0.0), event(1, 50, 50), event(2, 52, 50)
    lone.steps(3, events=[first])
    assert lone.core.state is State.ATTENDING
    obey(lone.core.controller.agent, [Command(1, "set price", Target("all"), {"message_price": 1000.0}, 60.0)])
    assert lone.step(events=[first, second]).act.observed == (1,)
    lone.step(events=[second])
    assert lone.core.state is State.WALKING
    obey(lone.core.controller.agent, [Command(2, "set price", Target("all"), {"message_price": 0}, 60.0)])
    lone.step(events=[second])
    assert lone.core.state is State.GOING


def test_the_newest_order_says_who_chooses_delta() -> None:
    """An operator who sets delta ends the agents' choice, and one who sets the price gives it back."""
    lone = learner(by_price(-2.0), message_price=1000.0)
    agent, near = lone.core.controller.agent, [event(1, 50, 50)]
    lone.step(events=near)
    assert not agent.strategy.attends
    obey(agent, [Command(3, "set delta", Target("all"), {"delta": 7}, 60.0)])
    lone.step(events=near)
    assert (agent.delta, agent.strategy.attends) == (7, True)
    obey(agent, [Command(2, "set price", Target("all"), {"message_price": 5.0}, 60.0)])
    obey(agent, [Command(4, "set price", Target("all"), {"message_price": 6.0}, 60.0)])
    lone.step(events=near)
    assert (agent.delta, agent.price_s, agent.strategy.attends) == (3, 6.0, False)


def test_only_agents_with_a_policy_have_a_price() -> None:
    lone = Lone(mode="hybrid")
    obey(lone.core.controller.agent, [Command(1, "set price", Target("all"), {"message_price": 5.0}, 60.0)])
    assert lone.core.controller.agent.refused == [1]


def test_a_scenario_has_the_numbers_of_the_shipped_policy() -> None:
    """So that a run can be repeated when another is shipped; under other rules it has none."""
    assert load_scenario("smoke", ["control.delta_rule=learned"]).control.options["policy"] == list(policy.shipped())
    assert load_scenario("smoke", ["control.mode=hybrid"]).control.options["policy"] == []
    with pytest.raises(SettingsError, match=f"control.policy must be {WEIGHTS} numbers, or none"):
        load_scenario("smoke", ["control.delta_rule=learned", "control.policy=[1.0]"])


@in_one_test("change", [{"weights": [0.1] * WEIGHTS}, {"inputs": ["busy"]}, {"digest": None}])
def test_a_policy_file_that_was_changed_is_refused(change: dict[str, Any]) -> None:
    record = json.loads((files(policy.__package__) / policy.SHIPPED).read_text(encoding="ascii"))
    assert len(policy_of(record)) == WEIGHTS
    with pytest.raises(ValueError, match="must be a policy"):
        policy_of(record | change)
