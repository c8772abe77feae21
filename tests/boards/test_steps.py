"""What a board's steps are made of, without clock or network: pace, inbox, set point, driver."""

import math
from random import Random

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from deltaswarm_agent.body import NOWHERE, Sensed
from deltaswarm_agent.core.agent_core import FORGET_SENDER_S, Receiver
from deltaswarm_board.driver import Driver, SetPoint
from deltaswarm_board.inbox import (
    MAX_BURST,
    MAX_KNOWN,
    MAX_NEIGHBOURS,
    MAX_RATE_HZ,
    MAX_TOLD,
    SETTLES_S,
    Allowance,
    Lateness,
    RadioInbox,
)
from deltaswarm_board.process import StepTimer
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.envelope import Sample, Sent, decode_sent, encode_sample, encode_sent
from tests.support.cores import Core, agent_settings, event

delays = st.lists(st.floats(0, 5), min_size=1, max_size=60)


@example([1.0, 0.0], 0.010000000000000002, 1.0)
@given(delays, st.floats(0.01, 2), st.floats(0, 1e6))
def test_steps_are_due_at_their_times_and_once(waits: list[float], step_s: float, start_s: float) -> None:
    """However late the loop is: steps rise, none is early, all are done or counted as skipped."""
    pace = StepTimer(step_s, start_s)
    now_s, done = start_s, []
    for wait_s in waits:
        step = pace.due(now_s)
        if step is not None:
            assert start_s + step * step_s <= now_s + 1e-6
            done.append(step)
            assert pace.due(now_s) is None
        now_s += wait_s
    assert done == sorted(set(done))
    assert pace.skipped <= done[-1] + 1


def test_a_late_step_is_skipped_and_the_next_one_is_in_time() -> None:
    """No burst, and no drift: after 3.7 s the third step is done late and the fourth at 4 s."""
    pace = StepTimer(1.0, 100.0)
    assert pace.due(100.0) == 0
    assert pace.due(100.5) is None
    assert pace.wait_s(100.5) == pytest.approx(0.5)
    assert pace.due(103.7) == 3
    assert pace.skipped == 2
    assert pace.wait_s(103.7) == pytest.approx(0.3)
    assert pace.due(104.0) == 4


def test_delays_do_not_add_up() -> None:
    """A thousand steps that each begin a little late end when they should."""
    pace, now_s = StepTimer(0.1, 0.0), 0.0
    for step in range(1000):
        now_s += pace.wait_s(now_s) + 0.01
        assert pace.due(now_s) == step
    assert now_s == pytest.approx(99.9 + 0.01)


def frame(counter: int = 1) -> bytes:
    return encode_sample(Sample(counter, b"here"))


def at(sent_s: float, x_m: float = 0.0) -> bytes:
    return encode_sent(Sent(sent_s, x_m, 0.0))


HERE = (0.0, 0.0)


def test_of_each_neighbour_the_newest_frame_is_heard_once() -> None:
    inbox = RadioInbox(1, 3.0)
    for sender, counter in ((2, 5), (2, 7), (2, 6), (3, 1)):
        assert inbox.accept(sender, frame(counter), None, 0.0) == ""
    assert inbox.empty(0.5, HERE) == ((2, frame(7)), (3, frame(1)))
    assert inbox.empty(1.0, HERE) == ()
    assert inbox.heard == 2
    assert not +inbox.dropped


@pytest.mark.parametrize(
    ("sender", "data", "sent", "reason"),
    [
        (2, b"\xc1", None, "malformed"),
        (2, frame(), b"\xc0", "malformed"),
        (2, frame(), at(1.0) * 9, "malformed"),
        (2, bytes(9000), None, "oversized"),
        (None, frame(), None, "on no agent's key"),
        (1, frame(), None, "from another agent with this number"),
    ],
)
def test_what_no_neighbour_would_send_is_counted_and_dropped(
    sender: int | None, data: bytes, sent: bytes | None, reason: str
) -> None:
    inbox = RadioInbox(1, 3.0)
    assert inbox.accept(sender, data, sent, 0.0) == reason
    assert inbox.dropped == {reason: 1}
    assert inbox.empty(0.0, HERE) == ()


def test_a_crowd_takes_no_more_memory_than_allowed() -> None:
    inbox = RadioInbox(0, 3.0)
    for sender in range(1, MAX_NEIGHBOURS + 11):
        inbox.accept(sender, frame(), None, 0.0)
    assert inbox.dropped == {"frame_full": 10}
    assert len(inbox.empty(0.0, HERE)) == MAX_NEIGHBOURS


def test_who_says_to_be_far_is_not_heard_where_that_is_asked_for() -> None:
    """By the senders' positions; whoever has no place itself hears nobody."""
    gated, free = RadioInbox(1, 3.0, range_m=9.0), RadioInbox(1, 3.0)
    for inbox in (gated, free):
        inbox.accept(2, frame(), at(0.0, 8.9), 0.0)
        inbox.accept(3, frame(), at(0.0, 9.1), 0.0)
    assert gated.empty(0.0, HERE) == ((2, frame()),)
    assert len(free.empty(0.0, HERE)) == 2
    gated.accept(2, frame(), at(0.0), 0.0)
    assert gated.empty(0.0, (math.nan, math.nan)) == ()
    assert gated.dropped == {"out of range": 2}


def test_frames_that_lie_here_too_long_are_stale() -> None:
    """When the agent itself did no steps."""
    inbox = RadioInbox(1, 3.0)
    inbox.accept(2, frame(), None, 0.0)
    assert inbox.empty(3.1, HERE) == ()
    assert inbox.dropped == {"stale": 1}
    slow = RadioInbox(1, 3.0, step_s=10.0)  # a frame waits for the agent's next step as a matter of course
    slow.accept(2, frame(), None, 0.0)
    assert slow.empty(9.9, HERE) == ((2, frame()),)


@given(st.floats(0, 1e6), st.lists(st.floats(0, 0.5), min_size=1, max_size=30), st.floats(3.1, 60))
def test_a_late_frame_is_stale_whatever_the_senders_clock_says(
    offset_s: float, jitter: list[float], late_s: float
) -> None:
    """Clocks may differ by days: frames with the usual delays are heard, those from a dead link are not."""
    inbox = RadioInbox(1, 3.0)
    for second, delay_s in enumerate(jitter):
        sent = at(second + offset_s)
        assert inbox.accept(2, frame(second), sent, second + delay_s) == ""
    second = len(jitter)
    assert inbox.accept(2, frame(second), at(second + offset_s), second + 0.5 + late_s) == "stale"


def test_a_drifting_clock_is_followed() -> None:
    """A sender whose clock loses half a second in a thousand is heard after a day as well."""
    lateness = Lateness()
    for second in range(0, 86_400, 10):
        assert lateness.of(2, second * 0.9995, float(second)) < 0.1


@given(st.floats(-500, 500), st.lists(st.floats(0, 0.5), min_size=40, max_size=40))
def test_a_clock_that_jumps_is_believed_after_a_while(jump_s: float, jitter: list[float]) -> None:
    """The sender or this board was suspended, and its clock with it: they are not deaf to each other for a day."""
    inbox = RadioInbox(1, 3.0)
    reasons = []
    for second, delay_s in enumerate(jitter):
        sent = at(1000.0 + second + (jump_s if second >= 20 else 0.0))
        reasons.append(inbox.accept(2, frame(second), sent, second + delay_s))
    assert set(reasons[:20]) == {""}
    assert set(reasons[20 + math.ceil(SETTLES_S) + 2 :]) == {""}


@pytest.mark.parametrize("per_s", [2.0, 5.0, 50.0])
def test_what_a_dead_link_gives_back_slowly_is_stale_to_its_end(per_s: float) -> None:
    """Two minutes of frames that come a few a second, over longer than a clock takes to be believed."""
    inbox = RadioInbox(1, 3.0)
    for second in range(10):
        assert inbox.accept(2, frame(second), at(float(second)), float(second)) == ""
    now_s = 130.0
    for second in range(10, 1000):
        now_s = max(now_s + 1.0 / per_s, second)
        reason = inbox.accept(2, frame(second), at(float(second)), now_s)
        assert reason == ("stale" if now_s - second > 3.1 else "") or now_s - second > 2.9


def test_a_sender_that_begins_anew_is_believed() -> None:
    """Its clock goes back, and with it the offset; else it would be stale for ever."""
    lateness = Lateness()
    assert lateness.of(2, 1000.0, 50.0) == 0.0
    assert lateness.of(2, 1001.0, 56.0) == pytest.approx(5.0, abs=0.01)
    assert lateness.of(2, 0.5, 60.0) == 0.0
    assert lateness.of(2, 1.5, 61.0) == pytest.approx(0.0)


@given(st.floats(0, 1e9))
def test_the_time_of_sending_comes_back(sent_s: float) -> None:
    assert decode_sent(at(sent_s, 3.0)) == Sent(sent_s, 3.0, 0.0)
    with pytest.raises(WireError):
        decode_sent(at(-1.0))


def test_near_enough_to_where_it_was_sent_is_there() -> None:
    point = SetPoint(0.2)
    assert point.settled(1.0, 1.0) == (1.0, 1.0)
    point.advance((1.0, 1.0), 0.5, 0.0, 2.0)
    assert point.settled(1.9, 1.1) == (2.0, 1.0)
    assert point.settled(1.5, 1.0) == (1.5, 1.0)


class Puppet:
    def __init__(self) -> None:
        self.says = Sensed(5.0, 5.0, 0.1)
        self.told: list[tuple[float, float, tuple[int, ...]]] = []

    def sense(self, time_s: float) -> Sensed:
        return self.says

    def move(self, vx_mps: float, vy_mps: float, observed: tuple[int, ...]) -> None:
        self.told.append((vx_mps, vy_mps, observed))

    def close(self) -> None:
        """Nothing to let go."""


def a_driver() -> tuple[Driver, Puppet]:
    puppet = Puppet()
    core = Core(1, agent_settings(width_m=20.0, height_m=20.0)).core
    return Driver(core, puppet, step_s=1.0, arrive_m=0.2, max_std_m=1.0), puppet  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("sensed", "fault"),
    [
        (NOWHERE, "no position yet"),
        (Sensed(5.0, 5.0, 2.0), "deviation of 2 m"),
        (Sensed(5.0, 5.0, math.nan), "deviation"),
        (Sensed(math.nan, 5.0, 0.1), "not a number"),
        (Sensed(1e9, 5.0, 0.1), "Earth"),
        (Sensed(5.0, 5.0, 0.1, fault="battery"), "battery"),
    ],
)
def test_on_a_body_that_is_not_well_an_agent_stands_and_is_silent(sensed: Sensed, fault: str) -> None:
    """It decides nothing, hears nothing, and goes on when the body is well again."""
    driver, puppet = a_driver()
    assert driver.step(0, 0.0, lambda at: ()) is not None
    puppet.says = sensed
    assert driver.step(1, 1.0, lambda at: ()) is None
    assert fault in driver.fault
    assert puppet.told[-1] == (0.0, 0.0, ())
    puppet.says = Sensed(5.0, 5.0, 0.1)
    assert driver.step(2, 2.0, lambda at: ()) is not None
    assert (driver.fault, driver.faulty_steps) == ("", 1)


def test_an_agent_reaches_an_event_with_a_place_that_is_never_certain() -> None:
    """A robot's place trembles by centimetres; the agent arrives all the same, and then stands still."""
    driver, puppet = a_driver()
    rng, at = Random(3), (5.0, 5.0)
    places = set()
    for step in range(40):
        trembling = (at[0] + rng.uniform(-0.1, 0.1), at[1] + rng.uniform(-0.1, 0.1))
        puppet.says = Sensed(*trembling, 0.1, (event(4, 8.0, 7.0),))
        driver.step(step, float(step), lambda place: ())
        at = (at[0] + puppet.told[-1][0], at[1] + puppet.told[-1][1])
        if step > 20:
            places.add(driver.place_m)
    assert driver.role == "attending"
    assert puppet.told[-1] == (0.0, 0.0, (4,))
    assert places == {(8.0, 7.0)}
    assert math.dist(at, (8.0, 7.0)) < 0.3


def test_a_recording_of_yesterday_is_not_heard_while_its_sender_is() -> None:
    """Played with the board's own certificate. The board stays heard; once it has been silent, the recording passes."""
    inbox, receiver = RadioInbox(1, 3.0), Receiver(1, 1.0)

    def heard(step: int, *frames: tuple[int, float]) -> list[bytes]:
        for counter, sent_s in frames:
            data = encode_sample(Sample(counter, str(counter).encode()))
            assert inbox.accept(7, data, encode_sent(Sent(sent_s, 0.0, 0.0)), float(step)) == ""
        return [payload for _, payload in receiver.newest_of(inbox.empty(float(step), (0.0, 0.0)), step)[0]]

    for step in range(20):
        live, played = (1000 + step, 90.0 + step), (500 + step, 4000.0 + step)
        frames = (live, played) if step % 2 else (played, live)
        assert heard(step, *frames) == [b"%d" % (1000 + step)]
        assert heard(step, played) == []
    assert heard(21 + round(FORGET_SENDER_S), (600, 5000.0)) == [b"600"]


def test_a_sender_has_an_allowance() -> None:
    """A burst, then so many per second; others have their own, and a reason is news once for each of them."""
    inbox = RadioInbox(1, 3.0)
    refused = [inbox.refuse(7, 0.0) for _ in range(int(MAX_BURST) + 5)]
    assert [bool(reason) for reason in refused] == [False] * int(MAX_BURST) + [True] * 5
    assert inbox.refuse(8, 0.0) == ""
    again = [inbox.refuse(7, 0.5) for _ in range(int(MAX_RATE_HZ))]
    assert again.count("") == MAX_RATE_HZ / 2
    assert inbox.dropped.total() == 5 + MAX_RATE_HZ / 2
    assert [inbox.is_news(7, "x"), inbox.is_news(7, "x"), inbox.is_news(8, "x"), inbox.is_news(7, "y")].count(True) == 3
    assert sum(inbox.is_news(agent, "z") for agent in range(1000)) == MAX_TOLD - 3


def test_an_allowance_forgets_whoever_was_heard_least_recently() -> None:
    """Strangers with many numbers take no more memory than this, and one that is heard stays known."""
    allowance = Allowance()
    for _ in range(int(MAX_BURST)):
        allowance.spend(7, 0.0)
    for agent in range(10, MAX_KNOWN + 500):
        allowance.spend(agent, 0.0)
        assert not allowance.spend(7, 0.0)
    assert len(allowance.left) == MAX_KNOWN
