"""Learning while it runs: what comes of a structure is counted for it, told to others, and forgotten."""

import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.bandit import ARMS, FADING_S, Bandit
from deltaswarm_agent.controllers.paper.commands import obey
from deltaswarm_agent.controllers.paper.finds import WEIGHT_PER_S
from deltaswarm_agent.controllers.paper.frames import MAX_ARM, Attending, Averages, Tried
from deltaswarm_agent.controllers.paper.policy import Structure
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_wire.commands import Command, Target
from tests.support import strategies
from tests.support.cores import INSIDE, OUTSIDE, PARENT_AT, Lone, attending, event, lives, member, near_frames

AVERAGES = Averages(500, 500, 1500, 1500, 300)

UNLIKE: tuple[tuple[float, float], ...] = ((0.5, 1.0), (0.5, 0.1), (0.5, 1.0), (0.2, 1.0), (0.5, 1.0), (0.5, 1.0))
"""Under each structure, the share of its time in which an agent works, and its messages per second of work."""


def bandit() -> Bandit:
    made = Bandit(1.0)
    made.begin(False, 0)
    return made


def lived(one: Bandit, spans: int, price_s: float, outcomes: tuple[tuple[float, float], ...], now: int) -> list[int]:
    """Let it choose every 50 s, and get what the structure gives; return its choices."""
    drawn, chosen = random.Random(3), []
    for _ in range(spans):
        one.choose(0.4, price_s, drawn, now)
        works, messages = outcomes[one.arm]
        one.begin(True, now)
        for _ in range(round(50 * works * messages)):
            one.report(now)
        one.begin(False, now + round(50 * works))
        now += 50
        chosen.append(one.arm)
    return chosen


def lone_bandit(**control: Any) -> Lone:
    return Lone(mode="hybrid", delta_rule="bandit", **control)


def of(lone: Lone) -> Bandit:
    found = lone.core.controller.agent.bandit
    assert found is not None
    return found


def told(arm: int, sender: int = 5) -> Attending:
    tried = Tried(arm, 4000, 1000, 50_000)
    return attending(sender, PARENT_AT, 1, PARENT_AT)._replace(averages=AVERAGES._replace(tried=tried))


def test_every_structure_has_a_place_in_frames() -> None:
    assert len(ARMS) == MAX_ARM + 1


def test_the_structures_are_hybrid_decentralised_and_hierarchical() -> None:
    assert [arm.founds_at for arm in ARMS if arm.attends] == [3, 2, 4, 6, None]
    assert [arm.founds_at for arm in ARMS if not arm.attends] == [2]


@pytest.mark.parametrize(("price_s", "best", "worst"), [(5.0, 1, 4), (0.0, None, 3)])
def test_the_structure_that_costs_less_is_chosen_more_often(price_s: float, best: int | None, worst: int) -> None:
    """At a price the one with few messages; without one, that under which agents hardly work is left."""
    late = lived(bandit(), 200, price_s, UNLIKE, 0)[100:]
    assert best is None or late.count(best) > 70
    assert late.count(worst) < 15


def test_it_forgets_what_has_changed() -> None:
    one, now = bandit(), 100 * 50
    before = lived(one, 100, 5.0, UNLIKE, 0)
    changed = list(UNLIKE)
    changed[1], changed[2] = (0.5, 2.0), (0.5, 0.1)
    after = lived(one, 100, 5.0, tuple(changed), now)[50:]
    assert before[50:].count(1) > 35
    assert after.count(2) > 35


def test_counts_fade() -> None:
    one = bandit()
    one.report(0)
    one.follow(2, 0)
    one.update(round(FADING_S))
    assert one.messages[0] == pytest.approx(1 / 2.71828, abs=1e-4)
    assert one.time_s[2] == pytest.approx(FADING_S * (1 - 1 / 2.71828), abs=1e-2)


def test_an_agent_that_begins_late_has_not_lived_before() -> None:
    one = Bandit(1.0)
    one.begin(False, 500)
    one.update(500 + round(FADING_S))
    assert one.time_s[0] == pytest.approx(FADING_S * (1 - 1 / 2.71828), abs=1e-2)
    assert one.work_s == [0.0] * len(ARMS)


def test_time_passes_in_seconds_and_when_something_changes() -> None:
    """So an agent that is not asked in every step has the same counts."""
    one = Bandit(0.5)
    one.begin(True, 0)
    one.begin(True, 700)
    assert one.time_s == [0.0] * len(ARMS)
    one.begin(False, round(2 * FADING_S))
    assert (one.time_s[0], one.work_s[0]) == pytest.approx([FADING_S * (1 - 1 / 2.71828)] * 2, abs=1e-2)


@pytest.mark.parametrize(("messages", "best"), [(6.05, 1), (5.95, 0)])
def test_each_structure_begins_with_a_minute_at_the_mean_cost(messages: float, best: int) -> None:
    """The mean is (10 + 6 +- 0.05) / (100 + 60); below 10 / 100, the first of those not tried is as good as any."""
    one = bandit()
    one.messages[1], one.work_s[1], one.messages[2] = 10.0, 100.0, messages
    assert one.best(0.0, 1.0) == best


def test_counts_are_told_in_whole_parts_of_their_units() -> None:
    one = bandit()
    one.arm, one.time_s[2], one.work_s[2], one.messages[2] = 2, 12.34, 5.67, 0.8912
    assert one.told(0) == Tried(2, 123, 57, 891)


@given(st.lists(st.builds(Tried, st.integers(0, MAX_ARM), *[st.integers(0, 10**6)] * 3), min_size=1), st.randoms())
def test_what_is_heard_in_any_order_is_mixed_alike(heard: list[Tried], order: random.Random) -> None:
    one, other, shuffled = bandit(), bandit(), list(heard)
    order.shuffle(shuffled)
    one.hear(heard, 3)
    other.hear(shuffled, 3)
    assert (one.time_s, one.work_s, one.messages) == (other.time_s, other.work_s, other.messages)


def test_what_others_tell_is_taken_in_by_and_by() -> None:
    """2 % of the difference in each second, of the structure that they follow alone."""
    one = bandit()
    one.hear([Tried(3, 4000, 1000, 50_000)], 0)
    assert one.time_s[3] == pytest.approx(400 * WEIGHT_PER_S)
    assert one.work_s[3] == pytest.approx(100 * WEIGHT_PER_S)
    assert one.messages[3] == pytest.approx(50 * WEIGHT_PER_S)
    assert one.time_s[:3] == [0.0] * 3


def test_what_was_heard_decides() -> None:
    """An agent that has tried nothing else leaves a structure of which it hears that it costs much."""
    one = bandit()
    for now in range(60):
        one.hear([Tried(0, 4000, 500, 500_000), Tried(4, 4000, 3000, 5_000)], now)
    assert one.best(0.5, 1.0) == 4


def test_a_member_counts_for_the_structure_of_its_parent() -> None:
    lone = Lone(at=OUTSIDE, mode="hybrid", delta_rule="bandit")
    lone.step()
    frame = member((100,), PARENT_AT, pulse=5)._replace(averages=AVERAGES._replace(tried=Tried(3, 10, 0, 0)))
    lone.step(frame, at=INSIDE)
    assert lone.core.state is State.MEMBER
    assert of(lone).arm == 3


def test_an_agent_chooses_when_it_begins_to_walk() -> None:
    """Not while it works; then it has the structure that it follows, whichever that is."""
    lone = lone_bandit(message_price=10.0)
    agent, one = lone.core.controller.agent, of(lone)
    one.time_s[4] = one.work_s[4] = 300.0
    chosen = []
    for number in range(40):
        lone.steps(3, events=[event(number, 50, 50)])
        assert (lone.core.state, one.arm) == (State.ATTENDING, chosen[-1] if chosen else 0)
        lone.step()
        chosen.append(one.arm)
        assert Structure(agent.strategy.founds_at, agent.strategy.attends) == ARMS[one.arm]
        if not agent.strategy.attends:
            break
    assert 4 in chosen


def test_the_newest_order_says_who_chooses() -> None:
    lone = lone_bandit()
    agent = lone.core.controller.agent
    obey(agent, [Command(3, "set delta", Target("all"), {"delta": 7}, 60.0)])
    lone.steps(3, events=[event(1, 50, 50)])
    lone.step()
    assert agent.delta == 7
    obey(agent, [Command(4, "set price", Target("all"), {"message_price": 6.0}, 60.0)])
    assert (agent.price_s, Structure(agent.strategy.founds_at, agent.strategy.attends)) == (6.0, ARMS[of(lone).arm])


def test_what_comes_of_an_order_is_neither_counted_nor_told() -> None:
    lone = lone_bandit()
    agent, one = lone.core.controller.agent, of(lone)
    lone.steps(3, events=[event(1, 50, 50)])
    counts = [*one.time_s, *one.work_s, *one.messages]
    obey(agent, [Command(3, "set delta", Target("all"), {"delta": 7}, 60.0)])
    frame = lone.steps(20, events=[event(1, 50, 50)])[-1].radio
    assert type(frame) is Attending
    assert frame.averages is not None
    assert frame.averages.tried is None
    assert all(after <= before for after, before in zip([*one.time_s, *one.work_s, *one.messages], counts, strict=True))
    obey(agent, [Command(4, "set price", Target("all"), {"message_price": 6.0}, 60.0)])
    before = one.time_s[one.arm], one.work_s[one.arm], one.messages[one.arm]
    lone.steps(3, events=[event(1, 50, 50)])
    assert one.told(agent.now) is not None
    after = one.time_s[one.arm], one.work_s[one.arm], one.messages[one.arm]
    assert [later - sooner for later, sooner in zip(after, before, strict=True)] == pytest.approx([3, 3, 3], rel=0.1)


PLACES = st.lists(st.tuples(st.sets(st.integers(0, 4)), st.sets(st.integers(0, 4))), min_size=1, max_size=15)


@given(PLACES, st.permutations(range(5)), st.permutations(range(5)))
def test_who_is_who_changes_nothing(
    life: list[tuple[set[int], set[int]]], events: list[int], senders: list[int]
) -> None:
    """Numbers of events and of agents tell an agent nothing: only where something is, and how often."""

    def counts(event_ids: list[int], sender_ids: list[int]) -> list[list[float]]:
        lone = lone_bandit()
        for sensed, heard in life:
            lone.step(
                *(told(n, 20 + sender_ids[n])._replace(x_cm=5200 + 100 * n) for n in heard),
                events=[event(10 + event_ids[n], 50.5 + 0.7 * n, 50.0) for n in sensed],
            )
        return [of(lone).time_s, of(lone).work_s, of(lone).messages]

    assert counts(events, senders) == counts(list(range(5)), list(range(5)))


@given(lives(near_frames(), steps=20))
def test_what_it_tells_can_be_told(life: list[tuple[list[Any], list[Any]]]) -> None:
    """Whatever others claim; each step encodes a frame if there is something to tell."""
    lone = lone_bandit()
    for heard, sensed in life:
        lone.step(*heard, events=sensed, skip=1)
        told = of(lone).told(lone.core.controller.agent.now)
        assert told is not None
        assert all(0 <= count <= 2**32 for count in told)


@given(strategies.tried)
def test_the_most_that_was_told_can_be_told_again(tried: Tried) -> None:
    one = bandit()
    one.follow(tried.arm, 0)
    for now in range(1, 4):
        one.hear([tried] * 200, now)
        one.report(now)
    told = one.told(4)
    assert told is not None
    assert all(0 <= count < 2**32 for count in told)
