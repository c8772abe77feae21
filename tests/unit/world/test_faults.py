"""The timeline of faults by itself: who is hit, what follows for processes and bodies, and that it always ends."""

from collections.abc import Collection
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_wire.messages import Event
from deltaswarm_wire.orders import GO_ON, KILL, NOTE, START, STOP
from deltaswarm_world.core.arrivals import EventIds
from deltaswarm_world.core.faults.timeline import Faults

COUNT, STEPS = 8, 40
ALL = frozenset(range(COUNT))
SEEDS = (0, 1, 2, 3, 4711, 2**32, 2**63 - 1)
"""A few: the first generator of each takes a tenth of a second, so that no agent can guess the world's."""


def faults(*tables: dict[str, Any], seed: int = 1, step_s: float = 1.0) -> Faults:
    head = {"seed": seed, "run": {"duration_s": STEPS * step_s, "step_s": step_s}, "agents": {"count": COUNT}}
    return Faults(load(Scenario, {**head, "fault": list(tables)}))


def fault(kind: str, at_s: float, **keys: Any) -> dict[str, Any]:
    return {"kind": kind, "at_s": at_s, **keys}


def orders(made: Faults, step: int, alive: Collection[int] = ALL, roots: Collection[int] = ()) -> list[Any]:
    """Action and agents of each order of a step."""
    return [(order.action, order.agents) for order in made.inject(step, alive, roots)]


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_named_agents_are_hit_at_their_step_and_at_no_other(step_s: float) -> None:
    made, due = faults(fault("kill", 5, agents=[3, 1]), step_s=step_s), round(5 / step_s)
    assert [orders(made, step) for step in range(due + 3)] == [[]] * due + [[(KILL, (1, 3))]] + [[]] * 2
    assert made.log == [{"fault": 0, "kind": "kill", "step": due, "at_s": 5.0, "until_s": None, "agents": [1, 3]}]


def test_the_dead_are_not_killed_again() -> None:
    """Of named agents those that live are hit; if there are none, that is a note."""
    assert orders(faults(fault("kill", 0, agents=[1, 2])), 0, alive={2, 3}) == [(KILL, (2,))]
    assert orders(faults(fault("freeze", 0, agents=[1], duration_s=5)), 0, alive={2, 3}) == [(NOTE, ())]


def test_the_roots_are_those_of_that_moment() -> None:
    made = faults(fault("kill", 5, roots=True), fault("kill", 7, roots=True))
    orders(made, 4, roots=[0])
    assert orders(made, 5, roots=[2, 6]) == [(KILL, (2, 6))]
    assert orders(made, 7, alive=ALL - {2, 6}, roots=[2]) == [(NOTE, ())]


@given(st.sets(st.sampled_from(sorted(ALL))), st.floats(0, 1), st.sampled_from(SEEDS))
def test_a_share_is_a_share_of_the_living(alive: set[int], fraction: float, seed: int) -> None:
    hits = [orders(faults(fault("kill", 0, fraction=fraction), seed=seed), 0, alive) for _ in range(2)]
    assert hits[0] == hits[1]
    hit = {agent for _, agents in hits[0] for agent in agents}
    assert hit <= alive
    assert len(hit) == int(fraction * len(alive) + 0.5)


def test_chance_is_each_faults_own() -> None:
    """One fault more leaves the targets of the others as they are, and seeds differ."""
    share = fault("kill", 5, fraction=0.5)
    (_, alone), (_, beside) = (
        orders(faults(share), 5)[0],
        orders(faults(share, fault("lying", 5, agents=[1], phantoms=2)), 5)[0],
    )
    assert alone == beside
    assert len({orders(faults(share, seed=seed), 5)[0][1] for seed in SEEDS}) > 3


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_a_freeze_ends(step_s: float) -> None:
    """It stops at its time and goes on after its duration; the log has both in seconds."""
    made = faults(fault("freeze", 2, agents=[4], duration_s=3), step_s=step_s)
    begins, ends = round(2 / step_s), round(5 / step_s)
    assert orders(made, begins) == [(STOP, (4,))]
    assert made.frozen == {4}
    assert [orders(made, step) for step in range(begins + 1, ends)] == [[]] * (ends - begins - 1)
    assert orders(made, ends) == [(GO_ON, (4,))]
    assert not made.frozen
    assert [(one["step"], one["at_s"], one["until_s"]) for one in made.log] == [(begins, 2.0, 5.0)]


def test_freezes_that_overlap_are_one() -> None:
    made = faults(fault("freeze", 2, agents=[4], duration_s=3), fault("freeze", 3, agents=[4, 5], duration_s=5))
    assert orders(made, 2) == [(STOP, (4,))]
    assert orders(made, 3) == [(STOP, (5,))]
    assert orders(made, 5) == []
    assert orders(made, 8) == [(GO_ON, (4, 5))]


def test_a_frozen_agent_that_is_killed_does_not_go_on() -> None:
    made = faults(
        fault("freeze", 2, agents=[4, 5, 6], duration_s=6),
        fault("kill", 3, agents=[4]),
        fault("restart", 4, agents=[5]),
    )
    assert orders(made, 2) == [(STOP, (4, 5, 6))]
    assert orders(made, 3) == [(KILL, (4,))]
    assert orders(made, 4, ALL - {4}) == [(KILL, (5,)), (START, (5,))]
    assert made.frozen == {6}
    assert orders(made, 8, ALL - {4}) == [(GO_ON, (6,))]


def test_a_restart_is_for_the_living_and_the_dead() -> None:
    """Who lives dies first; with a duration the new one comes later, unless it is there by then."""
    assert orders(faults(fault("restart", 1, agents=[1, 2])), 1, ALL - {2}) == [(KILL, (1,)), (START, (1, 2))]
    made = faults(fault("restart", 1, agents=[1, 2], duration_s=9), fault("restart", 5, agents=[2]))
    assert orders(made, 1) == [(KILL, (1, 2))]
    assert orders(made, 5, ALL - {1, 2}) == [(START, (2,))]
    assert orders(made, 10, ALL - {1}) == [(START, (1,))]


def test_a_frozen_agent_that_died_by_accident_is_not_frozen_when_it_restarts() -> None:
    """Its process is a new one, which nobody stopped."""
    made = faults(fault("freeze", 2, agents=[4], duration_s=9), fault("restart", 4, agents=[4]))
    orders(made, 2)
    assert orders(made, 4, ALL - {4}) == [(START, (4,))]
    assert not made.frozen


SOME_KINDS = st.sampled_from(["kill", "freeze", "restart", "radio-dead", "sensor-blind"])


@st.composite
def timelines(draw: st.DrawFn) -> list[dict[str, Any]]:
    made = []
    for _ in range(draw(st.integers(1, 6))):
        kind = draw(SOME_KINDS)
        table = fault(kind, draw(st.integers(0, STEPS - 1)))
        if kind == "freeze" or (kind != "kill" and draw(st.booleans())):
            table["duration_s"] = draw(st.integers(1, STEPS))
        some = st.lists(st.sampled_from(sorted(ALL)), min_size=1, max_size=4, unique=True)
        targets = st.one_of(
            st.fixed_dictionaries({"agents": some}),
            st.fixed_dictionaries({"fraction": st.floats(0, 1)}),
            st.just({"roots": True}),
        )
        made.append({**table, **draw(targets)})
    return made


@given(timelines(), st.sets(st.sampled_from(sorted(ALL)), max_size=3))
def test_orders_can_always_be_carried_out(timeline: list[dict[str, Any]], roots: set[int]) -> None:
    """Only the living are killed or stopped, only the dead are started, only the stopped go on.

    Each order has its own number, and the frozen are exactly those stopped.
    """
    made = faults(*timeline)
    alive, stopped, numbers = set(ALL), set(), []
    for step in range(STEPS):
        for order in made.inject(step, frozenset(alive), roots):
            numbers.append(order.number)
            targets = set(order.agents)
            assert order.step == step
            assert list(order.agents) == sorted(targets)
            if order.action == KILL:
                assert targets <= alive
                alive -= targets
                stopped -= targets
            elif order.action == START:
                assert not targets & alive
                alive |= targets
            elif order.action == STOP:
                assert targets <= alive - stopped
                stopped |= targets
            elif order.action == GO_ON:
                assert targets <= stopped
                stopped -= targets
        assert made.frozen == stopped
    assert numbers == list(range(len(numbers)))
    assert len(made.log) == len(timeline)


def test_a_dead_radio_is_deaf_at_once_and_what_it_said_before_is_heard() -> None:
    """Frames are a step on their way: mute is who was deaf when it spoke."""
    made = faults(fault("radio-dead", 3, agents=[1], duration_s=2))
    seen = []
    for step in range(7):
        orders(made, step)
        seen.append((set(made.deaf), set(made.mute)))
    assert seen[2:] == [(set(), set()), ({1}, set()), ({1}, {1}), (set(), {1}), (set(), set())]


def test_slow_actuators_multiply() -> None:
    made = faults(
        fault("actuator-slow", 0, agents=[1, 2], factor=0.5), fault("actuator-slow", 2, agents=[2], factor=0.4)
    )
    orders(made, 0)
    orders(made, 2)
    velocities_mps = np.ones((COUNT, 2))
    made.drive(velocities_mps)
    assert velocities_mps[:, 1].tolist() == pytest.approx([1, 0.5, 0.2, 1, 1, 1, 1, 1])


def test_a_stuck_actuator_keeps_its_velocity() -> None:
    """The last one from before the fault; others and later commands are as they were."""
    made = faults(fault("actuator-stuck", 2, agents=[1, 3], duration_s=3))
    done = []
    for step in range(7):
        orders(made, step)
        velocities_mps = np.full((COUNT, 2), float(step))
        made.drive(velocities_mps)
        done.append(velocities_mps[:4, 0].tolist())
    assert done == [[now, min(now, 2) if now < 5 else now] * 2 for now in range(7)]


def test_a_body_that_is_stuck_from_the_start_never_moves() -> None:
    """And one that is slow when it gets stuck keeps the slow speed."""
    made = faults(
        fault("actuator-stuck", 0, agents=[1]),
        fault("actuator-slow", 0, agents=[2], duration_s=3, factor=0.5),
        fault("actuator-stuck", 1, agents=[2]),
    )
    for step in range(5):
        orders(made, step)
        velocities_mps = np.ones((COUNT, 2))
        made.drive(velocities_mps)
        assert velocities_mps[:3, 1].tolist() == [1.0, 0.0, 0.5]


def test_the_blind_and_the_frozen_see_nothing() -> None:
    made = faults(fault("sensor-blind", 0, agents=[1]), fault("freeze", 0, agents=[2], duration_s=9))
    orders(made, 0)
    assert made.seeing([agent != 0 for agent in range(COUNT)]) == [agent > 2 for agent in range(COUNT)]


def test_a_noisy_sensor_errs_in_place_but_not_in_the_event() -> None:
    """By the same error each time; the others sense what is there."""
    made = faults(fault("sensor-noisy", 0, agents=[1], noise_m=0.5))
    orders(made, 0)
    seen = []
    for _ in range(3):
        sensed = [[Event(7, 40.0, 60.0)] for _ in range(COUNT)]
        made.distort(sensed, np.full((COUNT, 2), 40.0))
        assert sensed[0] == [Event(7, 40.0, 60.0)]
        seen.append(sensed[1])
    assert seen[0] == seen[1] == seen[2]
    ((number, x_m, y_m),) = seen[0]
    assert number == 7
    assert 0 < abs(x_m - 40.0) < 5
    assert 0 < abs(y_m - 60.0) < 5


def test_a_sensor_misses_its_share() -> None:
    made = faults(fault("sensor-noisy", 0, agents=[1], miss=0.3))
    orders(made, 0)
    assert 230 < sum(made.misses(1) for _ in range(1000)) < 370
    assert not any(made.misses(0) for _ in range(1000))


@given(st.lists(st.tuples(st.floats(0, 100), st.floats(0, 100)), min_size=1, max_size=8), st.integers(0, 99))
def test_a_liar_always_senses_its_phantoms(places: list[tuple[float, float]], seed: int) -> None:
    """As many as it is told, within its range and the arena, in the same places while it stays.

    Their ids are such as no event has.
    """
    made = faults(fault("lying", 0, agents=[5], phantoms=3), seed=seed)
    of = EventIds(seed)
    ids = {of.of(number) for number in range(100)}
    orders(made, 0)
    before: list[Event] = []
    for place in places:
        for again in range(2):
            sensed: list[list[Event]] = [[] for _ in range(COUNT)]
            made.distort(sensed, np.full((COUNT, 2), place))
            found = sensed[5]
            assert not any(sensed[:5] + sensed[6:])
            assert len({event.event for event in found}) == 3
            for event in found:
                assert np.hypot(event.x_m - place[0], event.y_m - place[1]) <= 5 + 1e-9
                assert 0 <= event.x_m <= 100
                assert 0 <= event.y_m <= 100
                assert event.event not in ids
            assert not again or found == before
            before = found
