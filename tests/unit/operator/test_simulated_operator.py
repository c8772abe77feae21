"""The simulated operator: its items are read, missed or wait; its load is a share; the same seed, the same acts."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.measures import HIGH_LOAD, Attention, Measures
from deltaswarm_operator.core.picture import Picture
from deltaswarm_operator.core.simulated_operator import Act, Read, SetDelta, SimulatedOperator
from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.ledger import Ledger
from deltaswarm_scenario.operator_settings import NONE, THRESHOLD, InboxSettings, PersonSettings
from tests.support.commanding import reloaded
from tests.support.tiers import in_one_test
from tests.unit.operator.test_console import report

CALM = PersonSettings(policy=NONE, sigma=0.0)
THRESHOLD_HZ = 5.0

Told = tuple[int, tuple[int, ...], bool]
"""Of an item: its sender, its events, whether it is new."""

items = st.tuples(st.integers(0, 4), st.lists(st.integers(0, 3), max_size=3).map(tuple), st.booleans())
steps = st.lists(st.tuples(st.lists(items, max_size=6), st.floats(0.0, 12.0)), max_size=60)
persons = st.builds(
    PersonSettings,
    policy=st.sampled_from([NONE, THRESHOLD]),
    new_s=st.floats(0.1, 60.0),
    sigma=st.floats(0.0, 1.5),
    memory_s=st.floats(1.0, 1000.0),
    best_load=st.floats(0.0, 0.95),
    slowing=st.floats(0.0, 10.0),
    patience_s=st.floats(0.5, 100.0),
    command_every_s=st.floats(0.0, 30.0),
    delta_step=st.sampled_from([-2, -1, 1, 3]),
    delta_limit=st.integers(1, 9),
)
seeds = st.integers(0, 5)


def person(settings: PersonSettings = CALM, seed: int = 0, delta: int | None = 4) -> SimulatedOperator:
    """One person with a generator of its own."""
    return SimulatedOperator(settings, Random(seed), THRESHOLD_HZ, delta)


def live(
    one: SimulatedOperator, told: Sequence[tuple[Sequence[Told], float]], first: int = 0
) -> list[tuple[float, Act]]:
    """What it does in steps of 1 s, in each of which it is told some items and a message rate."""
    acts = []
    for step, (arrived, rate_hz) in enumerate(told, first):
        number = 100 * step
        made = [
            Item(number + index, float(step), agent, "free", 0, events, is_new)
            for index, (agent, events, is_new) in enumerate(arrived)
        ]
        acts += [(float(step), act) for act in one.live(float(step), made, rate_hz)]
    return acts


@given(steps, persons, seeds)
def test_every_item_is_read_missed_replaced_or_unread(
    told: list[tuple[list[Told], float]], settings: PersonSettings, seed: int
) -> None:
    """None is lost, none counts twice; what is read is read once."""
    one = person(settings, seed)
    acts = live(one, told)
    found = one.measures
    assert found.items == sum(len(arrived) for arrived, _ in told)
    assert found.items == found.read + found.missed + found.replaced + one.unread
    numbers = [number for _, act in acts if isinstance(act, Read) for number in act.numbers]
    assert len(numbers) == len(set(numbers))
    assert found.read <= len(numbers) <= found.read + found.replaced


@given(steps, persons, seeds)
def test_the_load_is_a_share_and_so_is_its_mean(
    told: list[tuple[list[Told], float]], settings: PersonSettings, seed: int
) -> None:
    """Utilisation state and busy time stay within 0 and 1; the time at high load within the time."""
    one = person(settings, seed)
    for step, (arrived, rate_hz) in enumerate(told):
        live(one, [(arrived, rate_hz)], step)
        assert 0.0 <= one.load <= 1.0
    found = one.measures
    assert found.time_s == pytest.approx(max(0, len(told) - 1))
    assert -1e-9 <= found.load_s <= found.time_s + 1e-9
    assert -1e-9 <= found.busy_s <= found.time_s + 1e-9
    assert 0.0 <= found.high_s <= found.time_s + 1e-9


@given(steps, persons, seeds, st.integers(0, 60))
def test_one_that_goes_on_does_the_same(
    told: list[tuple[list[Told], float]], settings: PersonSettings, seed: int, cut: int
) -> None:
    """The same seed gives the same acts, and one that was saved in between does not differ."""
    whole = person(settings, seed)
    acts = live(whole, told)
    before = person(settings, seed)
    first = live(before, told[:cut])
    after = reloaded(before)
    assert first + live(after, told[cut:], len(told[:cut])) == acts
    assert after.totals() == whole.totals()


@given(steps, persons, seeds)
def test_commands_keep_their_distance_and_their_bounds(
    told: list[tuple[list[Told], float]], settings: PersonSettings, seed: int
) -> None:
    """Neglect benevolence: the swarm is left alone in between. Delta stays between its first value and the limit."""
    one = person(settings, seed)
    given_deltas = [act.delta for _, act in live(one, told) if isinstance(act, SetDelta)]
    assert settings.policy == THRESHOLD or not given_deltas
    low, high = sorted((4, settings.delta_limit))
    assert all(low <= delta <= high for delta in given_deltas)
    assert all(a != b for a, b in pairwise([4, *given_deltas]))
    times = [at_s for at_s, act in live(person(settings, seed), told) if isinstance(act, SetDelta)]
    assert all(b - a > settings.command_every_s - 1 for a, b in pairwise(times))


def test_the_rate_moves_delta_and_lets_it_go_back() -> None:
    """Above the threshold by one step after another down to the limit, below half of it up to where it began."""
    settings = PersonSettings(policy=THRESHOLD, sigma=0.0, slowing=0.0, delta_limit=2)
    one = person(settings, delta=4)
    acts = live(one, [((), 6.0)] * 300 + [((), 4.0)] * 200 + [((), 1.0)] * 300)
    assert [(at_s, act.delta) for at_s, act in acts if isinstance(act, SetDelta)] == [
        (6.0, 3),
        (72.0, 2),
        (506.0, 3),
        (572.0, 4),
    ]


def test_a_swarm_without_delta_is_commanded_nothing() -> None:
    one = person(replace(CALM, policy=THRESHOLD), delta=None)
    assert live(one, [((), 50.0)] * 300) == []


def test_the_new_is_read_first_and_then_the_oldest() -> None:
    """What is known already waits, in the order in which it came."""
    one = person(PersonSettings(policy=NONE, sigma=0.0, slowing=0.0))
    acts = live(one, [([(0, (1,), False), (1, (2,), False), (2, (3,), True)], 0.0), *[([], 0.0)] * 8])
    assert [(at_s, act) for at_s, act in acts] == [(4.0, Read((2,))), (5.0, Read((0,))), (6.0, Read((1,)))]


def test_a_repeat_replaces_what_has_not_been_read() -> None:
    """Both are read at once, as the new thing that the first was."""
    one = person(PersonSettings(policy=NONE, sigma=0.0, slowing=0.0))
    told = [([(3, (9,), True), (0, (1,), True)], 0.0), ([(0, (1, 2), False)], 0.0), *[([], 0.0)] * 8]
    assert live(one, told) == [(4.0, Read((0,))), (8.0, Read((1, 100)))]
    assert one.totals()["replaced"] == 1


@in_one_test(("later", "replaced"), [((1, 2), 1), ((1, 2, 3), 1), ((1,), 0), ((1, 3), 0), ((), 0)])
def test_only_an_item_that_names_all_the_same_events_replaces_another(later: tuple[int, ...], replaced: int) -> None:
    one = person(PersonSettings(policy=NONE, sigma=0.0, slowing=0.0))
    told = [([(3, (9,), True), (0, (1, 2), True)], 0.0), ([(0, later, False)], 0.0), *[([], 0.0)] * 8]
    live(one, told)
    assert one.totals()["replaced"] == replaced


def test_what_waits_too_long_is_missed() -> None:
    one = person(PersonSettings(policy=NONE, sigma=0.0, slowing=0.0, new_s=50.0, patience_s=30.0))
    acts = live(one, [([(0, (1,), True), (1, (2,), True)], 0.0), *[([], 0.0)] * 100])
    assert acts == [(50.0, Read((0,)))]
    assert one.totals()["missed"] == 1


@in_one_test(("now_s", "missed"), [(29.0, 0), (30.0, 0), (30.5, 1), (60.0, 1)])
def test_an_item_is_missed_once_it_is_older_than_the_patience(now_s: float, missed: int) -> None:
    """Not at that age; of a person at the station too, also if the item is read later, and once only."""
    waiting = Item(1, 0.0, 1, "free", 0, (2,), True)
    one = person(PersonSettings(policy=NONE, sigma=0.0, slowing=0.0, new_s=100.0, patience_s=30.0))
    one.live(0.0, [Item(0, 0.0, 0, "free", 0, (1,), True), waiting], 0.0)
    one.live(now_s, [], 0.0)
    assert (one.measures.missed, one.unread) == (missed, 2 - missed)
    picture, ledger = Picture(1.0), Ledger(InboxSettings(), 30.0)
    attention = Attention(ledger, 30.0)
    ledger.close_step(0.0, picture.update([report(0, 1)], 0.0))
    for time_s in (now_s, now_s):
        ledger.close_step(time_s, picture.update([], time_s))
        attention.close_step(time_s)
    assert (attention.measures.missed, ledger.unread) == (missed, 1)


def test_work_is_slowest_at_both_ends_of_the_load() -> None:
    """Reaction times form a U: a person with little to do is slow as well."""

    def takes_s(load: float) -> float:
        one = person(PersonSettings(policy=NONE, sigma=0.0, memory_s=1e6))
        one.load = load
        live(one, [([(0, (1,), True)], 0.0), *[([], 0.0)] * 20])
        return one.measures.interaction_s

    assert takes_s(0.55) == pytest.approx(4.0, rel=1e-4)
    assert takes_s(1.0) == pytest.approx(6.0, rel=1e-4)
    assert takes_s(0.0) > 6.0


def test_the_time_at_high_load_is_exact() -> None:
    """It begins and ends where the load crosses, not with a step."""
    coarse, fine = Measures(), Measures()
    for measures, parts in ((coarse, 1), (fine, 1000)):
        load = 0.5
        for goal in (1.0, 0.0):
            for _ in range(parts):
                after = goal + (load - goal) * 2.718281828459045 ** (-1 / parts)
                measures.add_load(load, after, 300.0 / parts, 300.0, is_busy=goal == 1.0)
                load = after
    assert coarse.high_s == pytest.approx(fine.high_s)
    assert 0 < coarse.high_s < coarse.time_s
    assert coarse.load_s == pytest.approx(fine.load_s)
    assert HIGH_LOAD == 0.7


def test_agents_in_turn_follow_from_the_times_on_and_between_items() -> None:
    """Two items of one agent, 30 s apart, 4 s each."""
    one = person(PersonSettings(policy=NONE, sigma=0.0, slowing=0.0))
    live(one, [([(0, (1,), True)], 0.0), *[([], 0.0)] * 33, ([(0, (2,), True)], 0.0), *[([], 0.0)] * 10])
    totals = one.totals()
    assert (totals["interaction_s"], totals["between_items_s"]) == (pytest.approx(4.0), pytest.approx(30.0))
    assert totals["agents_in_turn"] == pytest.approx(30 / 4 + 1)
    assert totals["acknowledge_s"] == pytest.approx(4.0)
    assert person().totals()["agents_in_turn"] is None
