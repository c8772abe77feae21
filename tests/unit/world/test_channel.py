"""The models of the air, one by one: reach, chance, places and times, queues."""

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from deltaswarm_scenario.radio import (
    AsymmetrySettings,
    BlackoutSettings,
    BurstSettings,
    JammerSettings,
    PathLossSettings,
    WallSettings,
)
from deltaswarm_world.core.air.channel.links import Ends, LinkDraws, Links
from deltaswarm_world.core.air.channel.loss import Asymmetry, Bursts, Contention
from deltaswarm_world.core.air.channel.queues import DelayLine, Packet, RateLimitedQueue
from deltaswarm_world.core.air.channel.reach import SHADOWING_CUT, PathLoss, RangeDisc
from deltaswarm_world.core.air.channel.zones import Blackouts, Jammers, Walls
from tests.support.airs import Stage
from tests.support.tiers import in_one_test

Place = tuple[float, float]
coordinates = st.floats(-50, 150)
points = st.tuples(coordinates, coordinates)


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def ends(ids: object, places_m: object) -> Ends:
    return Ends(np.array(ids), np.array(places_m, dtype=np.float64).reshape(-1, 2))


def link(sender: int, at: Place, receiver: int, to: Place) -> Links:
    return Links.of_pairs(ends([sender], at), ends([receiver], to))


def crowd(count: int) -> Links:
    """All directed links of agents who stand together."""
    pairs = [(sender, receiver) for receiver in range(count) for sender in range(count) if sender != receiver]
    senders, receivers = zip(*pairs, strict=True)
    nowhere = np.zeros((len(pairs), 2))
    return Links.of_pairs(Ends(np.array(senders), nowhere), Ends(np.array(receivers), nowhere))


def test_a_link_keeps_its_luck() -> None:
    """In any company and order; another link, direction or seed has its own; from either end the same if mutual."""
    draws = LinkDraws(rng())
    senders, receivers = draws.ends(np.arange(50)), draws.ends(np.arange(50) + 1)
    all_at_once = draws.uniform(senders, receivers)
    assert draws.uniform(draws.ends(np.array([7])), draws.ends(np.array([8]))) == all_at_once[7]
    assert list(draws.uniform(senders[::-1], receivers[::-1])) == list(all_at_once[::-1])
    other = LinkDraws(rng(2))
    others = (
        draws.uniform(receivers, senders),
        draws.uniform(senders, receivers, mutual=True),
        other.uniform(other.ends(np.arange(50)), other.ends(np.arange(50) + 1)),
        draws.uniform(draws.ends(np.arange(50), np.arange(50)), receivers),
    )
    assert not np.isin(np.concatenate(others), all_at_once).any()
    assert np.array_equal(others[1], draws.uniform(receivers, senders, mutual=True))


@pytest.mark.parametrize("mutual", [False, True])
def test_dice_are_fair(mutual: bool) -> None:
    """Uniform and normal, over 90,000 links; those of one end, or of the other direction, tell nothing of a link."""
    draws = LinkDraws(rng(3))
    one, other = (draws.ends(axis.ravel()) for axis in np.meshgrid(np.arange(300), np.arange(300, 600)))
    uniform = draws.uniform(one, other, mutual)
    normal, back = (draws.normals[draws.pick(*ends, mutual)] for ends in ((one, other), (other, one)))
    assert uniform.min() >= 0
    assert uniform.max() < 1
    assert uniform.mean() == pytest.approx(0.5, abs=0.005)
    assert np.histogram(uniform, 10, (0, 1))[0] == pytest.approx(np.full(10, 9000), rel=0.05)
    assert normal.mean() == pytest.approx(0, abs=0.025)
    assert normal.std() == pytest.approx(1, abs=0.015)
    square = normal.reshape(300, 300)
    assert abs(np.corrcoef(square[1:].ravel(), square[:-1].ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(square[:, 1:].ravel(), square[:, :-1].ravel())[0, 1]) < 0.02
    assert np.corrcoef(normal, back)[0, 1] == pytest.approx(float(mutual), abs=0.02)


CLEAR = PathLossSettings(shadowing_db=0.0)


@given(st.floats(0, 1e5), st.floats(0, 1e5), st.floats(1, 10))
def test_path_loss_grows_with_distance(one_m: float, other_m: float, exponent: float) -> None:
    """Never falls; a tenfold distance costs ten times the exponent; within 1 m it is that of 1 m."""
    model = PathLoss(PathLossSettings(exponent=exponent))
    near, far = sorted((one_m, other_m))
    losses = model.loss_db(np.array([near, far, 7.0, 70.0, 0.0, 1.0]))
    assert losses[0] <= losses[1]
    assert losses[3] - losses[2] == pytest.approx(10 * exponent)
    assert losses[4] == losses[5] == 40.0


def test_the_default_reaches_as_far_as_is_said() -> None:
    """9.3 m without shadowing: 29 dB to spare at 1 m, 30 dB a decade."""
    model = PathLoss(CLEAR)
    reach_m = 10 ** (29 / 30)
    assert reach_m == pytest.approx(9.26, abs=0.01)
    for distance_m, heard in ((reach_m - 1e-6, 1), (reach_m + 1e-6, 0)):
        rows = model.find(ends([1], (distance_m, 0)), ends([0], (0, 0))).rows
        assert len(rows) == heard


@given(points, points, st.booleans(), st.sampled_from([0.0, 5.0]), st.floats(0, 20))
def test_shadowing_is_mutual_unless_asked(a: Place, b: Place, mutual: bool, side_m: float, sigma_db: float) -> None:
    """The same both ways, bounded, and the same again when both ends are where they were."""
    settings = PathLossSettings(shadowing_db=sigma_db, shadowing_symmetric=mutual, decorrelation_m=side_m)
    model = PathLoss(settings, None, LinkDraws(rng()))
    there, back = model.shadowing_db(link(3, a, 8, b))[0], model.shadowing_db(link(8, b, 3, a))[0]
    if mutual:
        assert there == back
    elif sigma_db > 0.1:
        assert there != back
    assert abs(there) <= SHADOWING_CUT * sigma_db
    assert model.shadowing_db(link(3, a, 8, b))[0] == there


def test_shadowing_stays_with_a_link_or_changes_with_the_ground() -> None:
    """Fixed by default; drawn anew once an end is in another square, and no sooner."""
    for side_m, kinds in ((0.0, 1), (5.0, 8)):
        model = PathLoss(PathLossSettings(decorrelation_m=side_m), None, LinkDraws(rng()))
        drawn = [float(model.shadowing_db(link(0, (x, 0.0), 1, (3.0, 3.0)))[0]) for x in range(40)]
        assert len(set(drawn)) == kinds
        assert len(set(drawn[:5])) == 1


def test_shadowing_has_its_spread() -> None:
    """Its standard deviation over many links is the one asked for."""
    found = PathLoss(PathLossSettings(shadowing_db=6.0), None, LinkDraws(rng())).shadowing_db(crowd(150))
    assert found.std() == pytest.approx(6.0, rel=0.05)


@given(st.lists(points, min_size=2, max_size=8), st.integers(0, 99))
def test_nobody_in_reach_is_missed(places: list[Place], seed: int) -> None:
    """The search for pairs is as wide as the luckiest link; every pair with enough power is found."""
    model = PathLoss(PathLossSettings(shadowing_db=8.0), np.linspace(-3, 6, len(places)), LinkDraws(rng(seed)))
    agents = ends(range(len(places)), places)
    found = set(zip(*(side.tolist() for side in model.find(agents, agents)[:2]), strict=True))
    for receiver, to in enumerate(places):
        for sender, at in enumerate(places):
            power_dbm = model.received_dbm(link(sender, at, receiver, to))[0]
            if abs(power_dbm - -69.0) > 1e-6:
                assert ((receiver, sender) in found) == (power_dbm >= -69.0)


def test_an_own_range_is_the_sender_s() -> None:
    """It is heard farther, and hears no farther; with path loss as a gain that gives the same factor."""
    for table in ({}, {"reception": "log-distance", "path_loss": {"shadowing_db": 0, "sensitivity_dbm": -70}}):
        stage = Stage([[0, 0], [15, 0]], ranges=[{"agents": [0], "range_m": 20}], **table)
        assert stage.carry().links == [(0, 1)]


def test_a_share_of_directed_links_is_dead_for_ever() -> None:
    """The same ones in each step, about as many as asked for; the other direction is independent of it."""
    links = crowd(60)
    model = Asymmetry(AsymmetrySettings(dead_share=0.3), RangeDisc(10.0), 60, rng())
    first, second = model.cuts(links, 0.0), model.cuts(links, 1.0)
    assert first is not None
    assert np.array_equal(first, second)
    assert first.mean() == pytest.approx(0.3, abs=0.03)
    dead = set(zip(links.senders[first].tolist(), links.receivers[first].tolist(), strict=True))
    both = sum((receiver, sender) in dead for sender, receiver in dead)
    assert both / len(dead) == pytest.approx(0.3, abs=0.07)


def test_links_are_as_bad_in_a_large_swarm() -> None:
    """Where no table of them is kept, the same is drawn each time."""
    settings, links = AsymmetrySettings(0.2, 0.5), crowd(20)
    small, large = (Asymmetry(settings, RangeDisc(10.0), count, rng()) for count in (20, 5000))
    assert np.array_equal(small.factors(links), large.factors(links))


@given(st.floats(0, 0.99), st.floats(0, 10), st.integers(0, 99))
def test_a_range_factor_shortens_a_direction(low: float, distance_m: float, seed: int) -> None:
    """Below the lowest factor all is heard; beyond, who is heard depends on the direction."""
    model = Asymmetry(AsymmetrySettings(range_factor_low=low), RangeDisc(10.0), 2, rng(seed))
    one = link(0, (0.0, 0.0), 1, (distance_m, 0.0))
    (factor,) = model.factors(one)
    cut = model.cuts(one, 0.0)
    assert low <= factor <= 1
    assert cut is not None
    assert cut[0] == (distance_m / 10 > factor)


@in_one_test(
    ("p", "r", "good", "bad"), [(0.02, 0.1, 0.0, 1.0), (0.3, 0.7, 0.1, 0.6), (0.5, 0.5, 0.0, 1.0), (1.0, 1.0, 0.0, 1.0)]
)
def test_bursts_lose_their_stationary_share(p: float, r: float, good: float, bad: float) -> None:
    """From the first step on, also where links are used only now and then."""
    links = crowd(30)
    model = Bursts(BurstSettings(p, r, good, bad), 30, 1.0, rng())
    expected = good + (bad - good) * p / (p + r)
    lost = [model.cuts(links, float(step)) for step in (0, 1, 2, 3, 40, 41, 42, 43, 90, 91, 130)]
    shares = [float(one.mean()) for one in lost if one is not None]
    assert shares[0] == pytest.approx(expected, abs=0.08)
    assert np.mean(shares) == pytest.approx(expected, abs=0.04)


def test_a_burst_lasts_as_long_as_it_should() -> None:
    """A bad link is good again after 1 / p_bad_to_good steps on average."""
    model = Bursts(BurstSettings(0.05, 0.2), 20, 1.0, rng())
    links = crowd(20)
    bad = np.array([model.cuts(links, float(step)) for step in range(400)])
    begins = np.count_nonzero(bad[1:] & ~bad[:-1])
    assert np.count_nonzero(bad[1:]) / begins == pytest.approx(5.0, rel=0.06)


def test_frames_of_one_link_in_one_step_share_its_state() -> None:
    """Two frames that a queue lets out together are lost together where a bad link loses all."""
    pair = Links.of_pairs(ends([0, 0, 2], np.zeros((3, 2))), ends([1, 1, 1], np.zeros((3, 2))))
    model = Bursts(BurstSettings(0.5, 0.5), 3, 1.0, rng())
    lost = np.array([model.cuts(pair, float(step)) for step in range(200)])
    assert np.array_equal(lost[:, 0], lost[:, 1])
    assert not np.array_equal(lost[:, 1], lost[:, 2])


@given(st.lists(st.integers(7, 60), min_size=1, max_size=12), st.integers(1, 300), st.integers(0, 99))
def test_no_receiver_hears_more_than_the_medium_carries(sizes: list[int], most: int, seed: int) -> None:
    count = len(sizes)
    nowhere = np.zeros((count, 2))
    frames = [bytes(size) for size in sizes]
    links = Links.of_pairs(Ends(np.arange(count), nowhere), Ends(np.full(count, count), nowhere), frames)
    cut = Contention(float(most), rng(seed)).cuts(links, 0.0)
    if sum(sizes) <= most:
        assert cut is None
    else:
        assert cut is not None
        assert sum(np.array(sizes)[~cut]) <= most
        assert cut.any()


@given(points, points, points, points)
def test_a_wall_cuts_from_both_sides_alike(a: Place, b: Place, p: Place, q: Place) -> None:
    assume(a != b)
    there, back = link(0, p, 1, q), link(1, q, 0, p)
    one = Walls([WallSettings(a, b)]).cuts(there, 0.0)
    assert one is not None
    for wall, links in ((WallSettings(a, b), back), (WallSettings(b, a), there)):
        other = Walls([wall]).cuts(links, 0.0)
        assert other is not None
        if min(abs(side) for side in _sides(a, b, p, q)) > 1e-6:
            assert one[0] == other[0]


def _sides(a: Place, b: Place, p: Place, q: Place) -> list[float]:
    def side(u: Place, v: Place, w: Place) -> float:
        return (v[0] - u[0]) * (w[1] - u[1]) - (v[1] - u[1]) * (w[0] - u[0])

    return [side(a, b, p), side(a, b, q), side(p, q, a), side(p, q, b)]


@in_one_test(
    ("p", "q", "cut"),
    [
        ((0, 5), (20, 5), True),
        ((0, 15), (20, 15), False),
        ((0, 5), (9, 5), False),
        ((0, 10), (20, 10), True),
        ((10, -5), (10, 15), False),
        ((10, 5), (20, 5), False),
    ],
)
def test_a_wall_is_where_it_is(p: Place, q: Place, cut: bool) -> None:
    """From (10, 0) to (10, 10): cut is what has ends on opposite sides and passes between its ends."""
    found = Walls([WallSettings((10, 0), (10, 10))]).cuts(link(0, p, 1, q), 0.0)
    assert found is not None
    assert found[0] == cut


@in_one_test(("time_s", "on"), [(4.9, False), (5.0, True), (7.9, True), (8.0, False)])
def test_zones_keep_their_times(time_s: float, on: bool) -> None:
    through = link(0, (0.0, 0.0), 1, (20.0, 0.0))
    for model in (
        Blackouts([BlackoutSettings(5.0, 8.0)]),
        Walls([WallSettings((10, -9), (10, 9), 5.0, 8.0)]),
        Jammers([JammerSettings((20, 0), 1.0, 5.0, 8.0)]),
    ):
        cut = model.cuts(through, time_s)
        assert (cut is not None and bool(cut[0])) == on
        assert model.explain(through, time_s).cuts == on


@in_one_test(("time_s", "at"), [(0, (0, 0)), (10, (0, 0)), (15, (10, 0)), (20, (20, 0)), (25, (20, 5)), (99, (20, 10))])
def test_a_jammer_goes_its_way(time_s: float, at: Place) -> None:
    """In straight lines, at the times given; it jams who is within, and nobody else."""
    zone = JammerSettings((0, 0), 2.0, 10.0, None, ((20, 0), (20, 10)), (20.0, 30.0))
    jammers = Jammers([zone])
    assert tuple(jammers.center_m(0, time_s)) == at
    within, without = (at[0] + 2, at[1]), (at[0] - 2.001, at[1])
    if time_s >= 10:
        for place, cut in ((within, True), (without, False)):
            found = jammers.cuts(link(0, (70, 70), 1, place), time_s)
            assert found is not None
            assert found[0] == cut
        from_within = jammers.cuts(link(0, within, 1, (70, 70)), time_s)
        assert from_within is not None
        assert not from_within[0]


@given(st.lists(st.lists(st.integers(1, 40), max_size=3), max_size=30), st.floats(1, 60), st.integers(0, 100))
def test_a_pipe_is_exact(steps: list[list[int]], rate: float, queue_bytes: int) -> None:
    """In order, never faster than its rate, never more waiting than its queue, each packet once, every byte counted."""
    pipes = RateLimitedQueue(rate, queue_bytes)
    entered, left, dropped = deque[Packet](), [], []
    number = 0
    for now, sizes in enumerate(steps, 1):
        new = [Packet(0, number + index, bytes(size)) for index, size in enumerate(sizes)]
        number += len(new)
        entered += new
        through, lost = pipes.take(5, new)
        left += through
        dropped += lost
        assert sum(len(packet.data) for packet in left) == pipes.passed_bytes <= rate * now + 1e-6
        assert sum(len(packet.data) for packet in pipes.holds(5)) <= queue_bytes
        assert pipes.waiting == len(pipes.holds(5))
        assert len(left) + len(dropped) + pipes.waiting == len(entered)
    assert [packet.number for packet in left] == sorted(packet.number for packet in left)
    assert sorted(packet.number for packet in (*left, *dropped, *pipes.holds(5))) == list(range(number))


@given(st.lists(st.integers(1, 60), max_size=40), st.integers(60, 200))
def test_a_wide_pipe_is_none(sizes: list[int], rate: int) -> None:
    pipes = RateLimitedQueue(float(rate), 0)
    for number, size in enumerate(sizes):
        packet = Packet(0, number, bytes(size))
        assert pipes.take(0, [packet]) == ([packet], [])


def line(latency_s: float, jitter_s: float, step_s: float = 1.0) -> DelayLine:
    return DelayLine(latency_s, jitter_s, step_s, rng(1), rng(2))


@in_one_test(
    ("latency_s", "jitter_s", "step_s"),
    [(0.0, 0.4, 1.0), (0.5, 0.0, 1.0), (1.5, 0.0, 1.0), (2.5, 1.0, 1.0), (0.25, 3.1, 1.0), (0.12, 0.05, 0.1)],
)
def test_the_mean_delay_is_latency_and_half_the_jitter(latency_s: float, jitter_s: float, step_s: float) -> None:
    """Also where the jitter is shorter than a step, or a delay ends on half a step; over 100,000 frames."""
    delays = line(latency_s, jitter_s, step_s).draw(100_000)
    assert delays.mean() * step_s == pytest.approx(latency_s + jitter_s / 2, abs=0.01 * step_s)
    assert math.floor(latency_s / step_s) <= delays.min()
    assert delays.max() <= math.ceil((latency_s + jitter_s) / step_s)


@in_one_test(("latency_s", "step_s", "steps"), [(0.0, 1.0, 0), (3.0, 1.0, 3), (0.3, 0.1, 3), (7.0, 3.5, 2)])
def test_a_latency_of_whole_steps_is_exact_and_draws_nothing(latency_s: float, step_s: float, steps: int) -> None:
    jitter_rng, rounding_rng = rng(1), rng(2)
    delays = DelayLine(latency_s, 0.0, step_s, jitter_rng, rounding_rng).draw(1000)
    assert set(delays.tolist()) == {steps}
    assert (jitter_rng.random(), rounding_rng.random()) == (rng(1).random(), rng(2).random())
