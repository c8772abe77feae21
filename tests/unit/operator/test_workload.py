"""The workload meter: what it counts, when, and that nothing is lost."""

from collections import Counter
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.workload import SlidingRate, WorkloadMeter
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire import digest
from deltaswarm_wire.digest import Digest
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import (
    Clock,
    Forwarded,
    Report,
    Workload,
    decode_workload,
    encode_forwarded,
    encode_report,
    encode_workload,
)
from tests.support.strategies import REPORT, strange
from tests.support.tiers import in_one_test

STEP_S = 1.0


def report(agent: int, sequence: int, step: int) -> Report:
    return Report(agent, sequence, step, "attending", 1.0, 2.0, 0, (Event(agent, 1.0, 2.0),))


def a_meter(threshold_hz: float = 5.0, step_s: float = STEP_S) -> WorkloadMeter:
    return WorkloadMeter(OperatorSettings(threshold_hz), step_s)


def close(meter: WorkloadMeter, step: int, backlog: int = 0) -> Workload:
    return meter.close_step(Clock(step, step * STEP_S, False), backlog)


def feed(meter: WorkloadMeter, *reports: Report) -> None:
    for one in reports:
        meter.count(one, encode_report(one))


def hand_on(meter: WorkloadMeter, sequence: int, data: bytes, step: int = 0) -> str | None:
    return meter.receive_forwarded(encode_forwarded(Forwarded(sequence, step, data)))


def test_the_operator_is_told_when_the_first_report_has_arrived() -> None:
    """Whenever it was sent, and whoever sent it; a later report of the same event changes nothing."""
    meter = a_meter(step_s=0.5)
    sighted = [
        report(agent, 0, 0)._replace(events=(Event(event, 1.0, 2.0),)) for agent, event in ((3, 7), (4, 7), (4, 8))
    ]
    feed(meter, sighted[0])
    for step, arriving in ((4, []), (6, sighted[1:]), (9, sighted)):
        meter.close_step(Clock(step, step * 0.5, False), 0)
        feed(meter, *arriving)
    meter.close_step(Clock(12, 6.0, True), 0)
    assert meter.told_s == {7: 2.0, 8: 4.5}


def test_the_recorder_gets_a_closed_steps_reports_in_agent_order() -> None:
    """Whatever their order of arrival; those of one agent by sequence."""
    meter = a_meter()
    close(meter, 0)
    first, second, other = report(5, 0, 0), report(5, 1, 1), report(2, 0, 1)
    feed(meter, first, second, other)
    close(meter, 1)
    assert meter.reports_of_closed_step == (other, first, second)
    close(meter, 2)
    assert meter.reports_of_closed_step == ()


def test_a_step_closes_once() -> None:
    """A clock that does not advance is an error of the caller, and changes nothing."""
    meter = a_meter()
    close(meter, 5)
    for step in (5, 4, 0):
        with pytest.raises(ValueError, match=r"clock\.step must"):
            close(meter, step)
    assert (meter.step, meter.totals["steps"]) == (5, 1)


def test_steps_whose_clock_never_came_pass_without_messages() -> None:
    """Their reports are counted with the next clock, and the gap is told."""
    meter = a_meter(threshold_hz=0.0)
    close(meter, 0)
    feed(meter, report(1, 0, 1), report(1, 1, 3))
    workload = close(meter, 4)
    assert (workload.messages, workload.rate_1s_hz) == (2, 2.0)
    assert workload.rate_60s_hz == pytest.approx(2 / 5)
    assert (meter.totals["steps"], meter.totals["steps_missed"], meter.totals["held"]) == (5, 3, 0)


def test_an_operator_that_comes_late_begins_with_its_first_clock() -> None:
    meter = a_meter()
    feed(meter, report(1, 0, 5000))
    assert close(meter, 5000).messages == 1
    assert (meter.totals["steps"], meter.totals["steps_missed"]) == (1, 0)


def test_the_largest_gap_fits_on_the_wire() -> None:
    meter = a_meter()
    for sequence in (2**32 - 1, 0, 2**32 - 1):
        hand_on(meter, sequence, encode_report(report(1, 0, 0)))
    workload = close(meter, 0)
    assert decode_workload(encode_workload(workload)) == workload
    assert meter.totals["lost"] == 2 * 2**32 - 3


@in_one_test(
    ("data", "said"),
    [
        (b"", "sample must"),
        (b"\xc1", "sample must"),
        (encode_report(report(1, 0, 0))[:-1], "sample must"),
        (encode_report(report(1, 0, 0)._replace(x_m=float("nan"))), "report.x_m must"),
    ],
)
def test_what_breaks_the_protocol_is_dropped_with_a_reason(data: bytes, said: str) -> None:
    """Counted as the world's, in the step closed next; nothing is raised."""
    meter = a_meter()
    reason = hand_on(meter, 0, data)
    assert reason is not None
    assert reason.startswith(said)
    workload = close(meter, 0)
    assert (workload.messages, workload.rejected) == (0, 1)
    assert close(meter, 1).rejected == 0
    assert meter.totals["per_sender"] == {"world": {"messages": 0, "lost": 0, "rejected": 1}}


def test_a_report_counts_when_it_arrives() -> None:
    """Not in the step that it names; gaps and disorder of its agent are the uplink's, and no loss."""
    meter = a_meter()
    told = [report(1, 5, 0), report(2, 0, 3), report(1, 2, 1)]
    counts = []
    for step, those in ((6, ()), (7, (0, 1)), (8, (2,))):
        for number in those:
            assert hand_on(meter, number, encode_report(told[number]), step) is None
        counts.append((close(meter, step).messages, meter.reports_of_closed_step))
    assert counts == [(0, ()), (2, (told[0], told[1])), (1, (told[2],))]
    assert (meter.totals["lost"], meter.totals["rejected"]) == (0, 0)


def test_what_the_fabric_loses_behind_the_uplink_is_found() -> None:
    """By the world's own sequence; and an envelope that holds no report is the world's fault."""
    meter = a_meter()
    data = encode_report(report(1, 0, 0))
    for sequence in (0, 3):
        assert meter.receive_forwarded(encode_forwarded(Forwarded(sequence, 0, data))) is None
    reason = meter.receive_forwarded(encode_forwarded(Forwarded(4, 0, data[:-1])))
    assert reason is not None
    assert meter.receive_forwarded(b"") is not None
    workload = close(meter, 0)
    assert (workload.messages, workload.lost, workload.rejected) == (2, 2, 2)
    assert meter.totals["per_sender"]["world"] == {"messages": 0, "lost": 2, "rejected": 2}


@in_one_test(
    ("window_s", "step_s", "steps"), [(1.0, 0.6, 2), (60.0, 0.7, 86), (60.0, 0.9, 67), (1.0, 0.3, 3), (1.0, 4.0, 1)]
)
def test_a_window_is_the_nearest_whole_number_of_steps(window_s: float, step_s: float, steps: int) -> None:
    assert SlidingRate(window_s, step_s).steps == steps


@in_one_test(("sequences", "lost"), [((0, 1, 2), 0), ((0, 2), 1), ((1,), 1), ((0, 2, 1), 1), ((0, 5), 4)])
def test_a_gap_in_the_worlds_sequence_is_a_loss(sequences: tuple[int, ...], lost: int) -> None:
    meter = a_meter()
    for sequence in sequences:
        hand_on(meter, sequence, encode_report(report(1, sequence, 0)))
    assert (close(meter, 0).lost, meter.totals["lost"]) == (lost, lost)


def test_a_step_never_has_fewer_than_no_losses() -> None:
    """If more arrived late than was lost in it; the sum over the run is right nonetheless."""
    meter = a_meter()
    meter.lose(1, 5)
    assert close(meter, 0).lost == 5
    meter.lose(1, -3)
    assert (close(meter, 1).lost, meter.totals["lost"]) == (0, 2)


@given(strange(REPORT))
def test_no_bytes_break_the_meter(data: bytes) -> None:
    meter = a_meter()
    hand_on(meter, 0, data)
    workload = close(meter, 0)
    assert workload.messages + workload.rejected == 1


@given(
    st.lists(st.integers(0, 9), min_size=1, max_size=90),
    st.sampled_from([0.25, 0.5, 1.0, 2.0, 45.0, 60.0]),
    st.sampled_from([1.0, 60.0]),
)
def test_a_rate_is_that_of_the_window(counts: list[int], step_s: float, window_s: float) -> None:
    """Messages of the last steps within the window by the time that these took; of one step at least."""
    rate = SlidingRate(window_s, step_s)
    width = max(1, round(window_s / step_s))
    assert rate.steps == width
    for index, count in enumerate(counts):
        seen = counts[max(0, index + 1 - width) : index + 1]
        assert rate.add(count) == pytest.approx(sum(seen) / (len(seen) * step_s))


@pytest.mark.parametrize("step_s", [0.5, 1.0, 2.0])
def test_a_burst_is_in_the_long_rate_for_a_minute(step_s: float) -> None:
    """And in the short one for a second, or a step if that is longer; then no rate has any of it."""
    meter = a_meter(threshold_hz=0.0, step_s=step_s)
    rates = []
    for step in range(round(130 / step_s)):
        feed(meter, *(report(agent, 0, 0) for agent in range(30 if step == round(10 / step_s) else 0)))
        rates.append(meter.close_step(Clock(step, step * step_s, False), 0))
    long_s, short_s = (
        [one.time_s for one in rates if getattr(one, name) > 0] for name in ("rate_60s_hz", "rate_1s_hz")
    )
    assert (long_s[0], long_s[-1]) == (10.0, 70.0 - step_s)
    assert (short_s[0], short_s[-1]) == (10.0, 10.0 + max(0.0, 1.0 - step_s))
    assert rates[round(65 / step_s)].rate_60s_hz == 0.5
    assert rates[-1].time_above_s == 60.0


def test_time_above_the_threshold_is_that_of_the_long_rate() -> None:
    """Strictly above, over simulated time, from the start of the run."""
    meter = a_meter(threshold_hz=2.0)
    above = []
    for step, count in enumerate([2, 3, 0, 0, 9]):
        feed(meter, *(report(agent, step, step) for agent in range(count)))
        above.append(close(meter, step).time_above_s)
    # Rates over the whole start: 2, 2.5, 1.67, 1.25, 2.8
    assert above == [0.0, 1.0, 1.0, 1.0, 2.0]
    assert meter.totals["time_above_s"] == 2.0


@st.composite
def traffic(draw: st.DrawFn) -> list[tuple[int, list[Report]]]:
    """Per closed step what arrives before its clock, of this step or an earlier one."""
    steps: list[tuple[int, list[Report]]] = []
    sequences: Counter[int] = Counter()
    for step in range(draw(st.integers(1, 12))):
        arriving = []
        for agent in draw(st.lists(st.integers(0, 4), max_size=5)):
            sequences[agent] += draw(st.sampled_from([0, 0, 0, 1, 3]))
            of_step = max(0, step + draw(st.sampled_from([0, 0, 0, -2])))
            arriving.append(report(agent, sequences[agent], of_step))
            sequences[agent] += 1
        steps.append((step, arriving))
    return steps


@given(traffic())
def test_the_counts_are_those_of_a_plain_account(steps: list[tuple[int, list[Report]]]) -> None:
    """Every message that arrived is counted once, with the next clock."""
    meter = a_meter()
    for step, arriving in steps:
        feed(meter, *arriving)
        workload = close(meter, step)
        assert workload.messages == len(arriving)
        assert workload.senders == len({one.agent for one in arriving})
        assert sorted(meter.reports_of_closed_step) == sorted(arriving)
    totals = meter.totals
    assert totals["messages"] == sum(len(arriving) for _, arriving in steps)
    assert totals["messages"] == sum(sender["messages"] for sender in totals["per_sender"].values())


@given(traffic(), st.randoms(use_true_random=False))
def test_the_digest_does_not_depend_on_the_order_of_arrival(steps: list[Any], rng: Any) -> None:
    """Agents may be heard in any order within a step; each one's own messages stay in order."""
    straight, shuffled = a_meter(), a_meter()
    by_hand = Digest()
    for step, arriving in steps:
        own = [one._replace(step=step) for one in arriving]
        feed(straight, *own)
        turns = [one.agent for one in own]
        rng.shuffle(turns)
        queues = {agent: iter([one for one in own if one.agent == agent]) for agent in set(turns)}
        feed(shuffled, *(next(queues[agent]) for agent in turns))
        for one in sorted(own):
            by_hand.add(step, one.agent, digest.REPORT, encode_report(one))
        by_hand.end_step()
        assert close(straight, step) == close(shuffled, step)
    assert straight.digest_hex == shuffled.digest_hex == by_hand.hex()


def test_a_new_meter_has_counted_nothing() -> None:
    """It is before its first step; and reports without a gap make the world no sender."""
    meter = a_meter(threshold_hz=0.5, step_s=0.5)
    assert (meter.is_over, meter.totals["messages_per_s"], meter.totals["per_sender"]) == (False, 0.0, {})
    for sequence in (0, 1):
        assert hand_on(meter, sequence, encode_report(report(4, sequence, 0))) is None
    close(meter, 0)
    assert list(meter.totals["per_sender"]) == ["4"]
    assert meter.totals["messages_per_s"] == 4.0
    assert meter.totals["time_above_s"] == 0.5


def test_what_was_missing_in_a_step_that_is_done_again_is_not_counted_twice() -> None:
    meter = a_meter()
    close(meter, 0)
    hand_on(meter, 3, b"broken")
    meter.resume()
    workload = close(meter, 1)
    assert (workload.lost, workload.rejected, workload.messages) == (0, 0, 0)
