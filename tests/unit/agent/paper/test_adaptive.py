"""What an agent learns about finding events, and what follows from it: patience, returns, a delta of its own."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.commands import obey
from deltaswarm_agent.controllers.paper.delta import delta_for
from deltaswarm_agent.controllers.paper.finds import FADING_S, FIRST_FINDS, FIRST_S, RANDOM, RETURNING, Finds
from deltaswarm_agent.controllers.paper.frames import Attending, Averages, Member
from deltaswarm_agent.controllers.paper.returning import LEAST, MAX_PLACES, MOST, return_probability
from deltaswarm_agent.controllers.paper.settings import ALL
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_wire.commands import Command, Target
from deltaswarm_wire.plugins import find_controller
from tests.support import strategies
from tests.support.cores import (
    INSIDE,
    OUTSIDE,
    PARENT_AT,
    Lone,
    a_member,
    a_root,
    agent_settings,
    attending,
    event,
    member,
)
from tests.support.tiers import in_one_test

SENDER = 5
RATES = strategies.averages


def finds(step_s: float = 1.0) -> Finds:
    return Finds(agent_settings(step_s=step_s))


def telling(averages: Averages | None) -> Attending:
    return attending(SENDER, PARENT_AT, 1, PARENT_AT)._replace(averages=averages)


def found(lone: Lone) -> list[tuple[float, float]]:
    assert lone.core.controller.agent.found is not None
    return [(x_m, y_m) for x_m, y_m, _ in lone.core.controller.agent.found.places]


def rate_hz(lone: Lone) -> float:
    assert lone.core.controller.agent.finds is not None
    return lone.core.controller.agent.finds.rate_hz


def test_a_walker_expects_one_event_in_300_s_at_first() -> None:
    assert finds().rate_hz == pytest.approx(1 / 300)
    assert finds().ratio == pytest.approx(1.0)
    assert pytest.approx(1 / 300) == 2 * FIRST_FINDS / (2 * FIRST_S)


@given(st.lists(st.tuples(st.integers(1, 400), st.sampled_from([None, RANDOM, RETURNING]), st.booleans()), max_size=8))
def test_averages_do_not_depend_on_how_often_they_are_updated(spans: list[tuple[int, int | None, bool]]) -> None:
    """So an agent that sleeps has the same as one that is asked in every step."""
    seldom, often = finds(), finds()
    now = 0
    for steps, leg, works in spans:
        seldom.begin(leg, works, now)
        often.begin(leg, works, now)
        for step in range(now, now + steps):
            often.update(step)
        now += steps
    seldom.update(now)
    often.update(now)
    assert seldom.rate_hz == pytest.approx(often.rate_hz)
    assert seldom.ratio == pytest.approx(often.ratio)
    assert seldom.busy == pytest.approx(often.busy)


@pytest.mark.parametrize("step_s", [0.5, 1.0, 4.0])
def test_averages_are_in_seconds(step_s: float) -> None:
    """1000 s of walking with a find each 100 s come to the same rate, whatever the length of a step."""
    one = finds(step_s)
    one.begin(RANDOM, works=False, now=0)
    for found_s in range(100, 1001, 100):
        one.update(round(found_s / step_s))
        one.find(1)
    whole = [100 * n for n in range(1, 11)]
    expected_finds = 2 * FIRST_FINDS * math.exp(-1) + sum(math.exp((at_s - 1000) / FADING_S) for at_s in whole)
    expected_s = 2 * FIRST_S * math.exp(-1) + FADING_S * (1 - math.exp(-1))
    assert one.rate_hz == pytest.approx(expected_finds / expected_s)


def test_only_walking_fades_and_finds() -> None:
    """An agent that stands keeps what it knew, and finds nothing by its own walk; but it is busy or idle."""
    one = finds()
    one.begin(None, works=True, now=0)
    one.update(700)
    one.find(3)
    assert one.rate_hz == pytest.approx(1 / 300)
    assert one.busy == pytest.approx(1 - math.exp(-0.7))
    one.begin(None, works=False, now=700)
    one.update(1400)
    assert one.busy == pytest.approx((1 - math.exp(-0.7)) * math.exp(-0.7))


@given(st.lists(RATES, min_size=1, max_size=5), st.randoms(use_true_random=False))
def test_averages_heard_in_any_order_are_mixed_alike(heard: list[Averages], order: random.Random) -> None:
    """To the last bit, since digests depend on it; each counts as much, and all stay positive."""
    one, other = finds(), finds()
    shuffled = order.sample(heard, len(heard))
    one.hear([telling(averages) for averages in heard], 3)
    other.hear([telling(averages) for averages in shuffled], 3)
    assert one.told(3) == other.told(3)
    assert one.rate_hz == other.rate_hz > 0
    assert one.ratio > 0
    assert 0 <= one.busy <= 1


def test_who_hears_another_for_long_comes_to_know_what_it_knows() -> None:
    """2 % of the difference in each second; frames without averages change nothing."""
    one, known = finds(), Averages(2000, 4000, 3000, 1000, 800)
    one.hear([telling(None)], 0)
    assert one.rate_hz == pytest.approx(1 / 300)
    one.hear([telling(known)], 0)
    assert one.busy == pytest.approx(0.02 * 0.8)
    for now in range(1, 400):
        one.hear([telling(known)], now)
    assert one.told(400)[:4] == pytest.approx(known[:4], rel=0.01)
    assert one.busy == pytest.approx(0.8, rel=0.06), "it idles itself, which pulls a little the other way"


def test_whoever_claims_to_walk_for_no_time_breaks_nothing() -> None:
    """Many hostile frames in each step, for as long as it takes until nothing is left of one's own time."""
    one = finds()
    for now in range(400):
        one.hear([telling(Averages(0, 0, 0, 0, 0))] * 255, now)
    assert 0 < one.rate_hz < math.inf
    assert 0 < one.ratio < math.inf
    one.hear([telling(Averages(2**32 - 1, 0, 0, 2**32 - 1, 0))] * 255, 400)
    assert one.ratio**2 < math.inf


@given(RATES)
def test_what_is_told_can_be_told_again(averages: Averages) -> None:
    one = finds()
    for now in range(50):
        one.hear([telling(averages)] * 3, now)
    told = one.told(50)
    assert all(0 <= value <= 2**32 - 1 for value in told[:-1])
    assert told.busy_permille <= 1000


def adaptive(**control: object) -> Lone:
    return Lone(at=(50.0, 50.0), **{"mode": "adaptive", **control})


def test_an_event_that_a_walker_newly_senses_is_a_find_and_a_place() -> None:
    """Once, as long as it is sensed; and again after it was out of sight."""
    lone = adaptive(mode="hierarchical", rho=9, return_to_finds=True)
    lone.step()
    before_hz = rate_hz(lone)
    lone.steps(3, events=[event(1, 52, 50)])
    assert found(lone) == [(52.0, 50.0)]
    assert rate_hz(lone) > before_hz
    lone.step()
    lone.step(events=[event(1, 52, 50)])
    assert len(found(lone)) == 2


@pytest.mark.parametrize("frame", [attending(SENDER, (52.0, 51.0), 1, (52.0, 50.0)), member((SENDER,), (52.0, 51.0))])
def test_an_event_that_somebody_attends_is_no_find(frame: Attending | Member) -> None:
    """But a place worth remembering."""
    lone = adaptive(mode="hierarchical", rho=9, return_to_finds=True)
    lone.step()
    before_hz = rate_hz(lone)
    lone.step(frame, events=[event(1, 52, 50)])
    assert rate_hz(lone) <= before_hz
    assert found(lone)[0] == (52.0, 50.0)


def test_who_newly_meets_an_attending_agent_remembers_its_event() -> None:
    lone = Lone(at=OUTSIDE, mode="decentralised", return_to_finds=True)
    lone.step()
    lone.step(attending(SENDER, PARENT_AT, 1, (49.0, 50.0)), at=INSIDE)
    assert found(lone) == [(49.0, 50.0)]


def test_the_memory_is_bounded() -> None:
    lone = adaptive(mode="hierarchical", rho=9, return_to_finds=True)
    for number in range(50):
        lone.step(events=[event(number, 50 + number % 3, 50)])
    assert len(found(lone)) == MAX_PLACES


def test_the_paper_learns_nothing() -> None:
    """No averages in its frames, so they are as long as they were."""
    lone = Lone(mode="hybrid", delta=9)
    said = lone.steps(4, events=[event(1, 50, 50)])[-1].radio
    assert type(said) is Attending
    assert said.averages is None
    assert lone.core.controller.agent.finds is None


def test_the_probability_of_a_return_follows_what_returns_find() -> None:
    """The more they find beside random legs, the more of them; a few always, to notice a change."""
    assert return_probability(0.0) == MOST
    assert return_probability(0.5) == pytest.approx(0.375)
    assert return_probability(1.0) == return_probability(3.0) == LEAST


def wander(lone: Lone, steps: int, source_m: tuple[float, float] | None = None) -> int:
    """Let an agent go where it wants; return how often it senses a new event at the source, if there is one."""
    visits = 0
    for step in range(steps):
        senses = source_m is not None and math.dist(lone.at, source_m) < 5
        visits += senses and step % 20 == 0
        lone.go_where_it_wants(events=[event(step // 20, *(source_m or lone.at))] if senses else [])
    return visits


def test_a_walker_comes_back_to_where_it_finds_events() -> None:
    """Much more often than one without a memory; over seeds 1 to 8, 4000 s each."""

    def visits(returns: bool) -> int:
        control = {"mode": "hierarchical", "rho": 9, "return_to_finds": returns}
        lones = [Lone(at=(20.0, 20.0), seed=seed, **control) for seed in range(1, 9)]
        return sum(wander(lone, 4000, (20.0, 20.0)) for lone in lones)

    assert visits(returns=True) > 3 * visits(returns=False)


def test_a_place_is_forgotten_after_a_return_in_vain() -> None:
    """A whole leg back without a new event; in time nothing is left of a place where nothing happens."""
    lone = Lone(mode="hierarchical", rho=9, return_to_finds=True, find_memory_s=1e6)
    for number in range(5):
        lone.step(events=[event(number, 52, 50)])
    wander(lone, 20_000)
    assert found(lone) == []


def test_a_place_is_forgotten_with_time() -> None:
    lone = Lone(mode="hierarchical", rho=9, return_to_finds=True, find_memory_s=100)
    lone.step(events=[event(1, 52, 50)])
    lone.step(skip=101)
    places = lone.core.controller.agent.found
    assert places is not None
    assert all(places.next_goal(lone.now) is None for _ in range(200))


@in_one_test(("level", "step_s"), [(1, 1.0), (2, 1.0), (3, 1.0), (1, 0.5), (2, 4.0)])
def test_a_member_leaves_when_a_walker_would_have_found_enough(level: int, step_s: float) -> None:
    """K / w seconds of idling, at level l in 1/l of that; w is 1 in 300 s as long as nobody tells otherwise."""
    path = tuple(range(100, 100 + level))
    lone = a_member(path, patience_finds=0.2, step_s=step_s)
    joined = lone.now
    while lone.path:
        lone.step(member(path, PARENT_AT, pulse=100 + lone.now))
    assert (lone.now - joined + 1) * step_s == pytest.approx(0.2 * 300 / level, abs=step_s)


def test_an_event_renews_patience() -> None:
    lone = a_member((100,), patience_finds=0.2)
    for step in range(200):
        lone.step(member((100,), PARENT_AT, pulse=101 + step), events=[event(1, *INSIDE)] if step % 50 == 0 else [])
    assert lone.path


def test_a_root_leaves_too_and_its_tree_with_it() -> None:
    root = a_root(patience_finds=0.2)
    said = root.steps(60)
    assert root.core.state is State.WALKING
    assert type(said[-1].radio).__name__ == "Leaving"


def test_without_dissolution_nobody_loses_patience() -> None:
    root = a_root(patience_finds=0.2, dissolution=False)
    root.steps(500)
    assert root.core.state is State.ROOT


def test_who_learns_that_walkers_find_much_leaves_sooner() -> None:
    """Averages reach agents that stand in trees by the frames of others."""
    slow, fast = (a_member((100,), patience_finds=0.3) for _ in range(2))
    rich = Averages(5000, 5000, 3000, 3000, 0)
    for step in range(60):
        slow.step(member((100,), PARENT_AT, pulse=101 + step))
        fast.step(member((100,), PARENT_AT, pulse=101 + step)._replace(averages=rich))
    assert slow.path
    assert not fast.path


@in_one_test(("busy", "delta"), [(0.0, 4), (0.2499, 4), (0.25, 3), (0.4999, 3), (0.5, 2), (1.0, 2)])
def test_delta_falls_as_agents_are_busier(busy: float, delta: int) -> None:
    assert delta_for(busy) == delta


def test_an_agent_chooses_its_delta_and_says_so() -> None:
    """In its act and in its report; a swarm that is told to be busy founds trees at two events."""
    lone = adaptive()
    assert lone.step().act.tree_status.delta == 4
    busy = telling(Averages(500, 500, 1500, 1500, 1000))
    lone.steps(60, busy)
    assert lone.step(busy).act.tree_status.delta == 2
    said = lone.step(events=[event(1, 50, 50), event(2, 51, 50)])
    assert said.act.tree_status.role == "root"
    assert said.report is not None
    assert said.report.delta == 2


def test_the_modes_of_the_paper_say_their_threshold() -> None:
    deltas = [
        Lone(mode=mode, delta=5, rho=7).step().act.tree_status.delta
        for mode in ("hybrid", "hierarchical", "decentralised")
    ]
    assert deltas == [5, 7, 0]


def test_an_operator_who_sets_delta_ends_the_agents_own_choice() -> None:
    lone = adaptive()
    obey(lone.core.controller.agent, [Command(1, "set delta", Target("all"), {"delta": 7}, 60.0)])
    assert lone.step().act.tree_status.delta == 7


def test_adaptive_is_hybrid_control_with_other_defaults() -> None:
    own, hybrid = find_controller("adaptive").Settings(), find_controller("hybrid").Settings()
    changed = {name for name in vars(hybrid) if getattr(own, name) != getattr(hybrid, name)}
    assert changed == {"delta_rule", "patience_finds", "return_to_finds", "member_observes"}
    assert own.member_observes == ALL
