"""The operator's books in open air: who is alive, what came, what was lost, by its own clock."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.presence import INSISTS, MAX_AGENTS, MAX_STEP_BYTES, RESTART_S, RETURNS, OpenAirMeter
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire.codec import pack
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import MAX_REPORTED, Health, Report, encode_health, encode_report
from tests.support.tiers import in_one_test


def report(agent: int, sequence: int, step: int = 0) -> bytes:
    return encode_report(Report(agent, sequence, step, "root", 1.0, 2.0, 3, ()))


def meter(step_s: float = 1.0) -> OpenAirMeter:
    return OpenAirMeter(OperatorSettings(), step_s)


def hear(books: OpenAirMeter, agent: int, sequence: int, sent_s: float, now_s: float = 0.0) -> str | None:
    return books.hear(agent, report(agent, sequence), pack(sent_s), now_s)


def test_a_report_counts_when_it_comes_whatever_its_own_step() -> None:
    """Two boards are at step 7 and at step 90,000, and the operator is in its first one."""
    books = meter()
    assert books.hear(1, report(1, 0, 7), pack(100.0), 0.2) is None
    assert books.hear(2, report(2, 5, 90_000), None, 0.3) is None
    assert books.close_second(0.9, 0) is None
    workload = books.close_second(1.0, 0)
    assert workload is not None
    assert (workload.step, workload.messages, workload.senders, workload.rate_1s_hz) == (0, 2, 2, 2.0)
    assert books.totals["lost"] == 0, "what was sent before anybody listened is no loss"


def test_steps_are_the_wall_clocks() -> None:
    """An operator that was held up closes the newest step that has ended, and says how many it missed."""
    books = meter(0.5)
    assert books.wait_s(0.1) == pytest.approx(0.4)
    first = books.close_second(0.5, 0)
    hear(books, 1, 0, 10.0, 0.7)
    second = books.close_second(2.6, 3)
    assert first is not None
    assert second is not None
    assert (first.step, second.step, second.time_s, second.messages, second.backlog) == (0, 4, 2.0, 1, 3)
    assert books.totals["steps_missed"] == 3
    assert books.wait_s(2.6) == pytest.approx(0.4)
    assert books.close_second(2.9, 0) is None


def test_who_is_alive_follows_the_tokens() -> None:
    """Coming twice is being there once; who reports without a token is known and not alive."""
    books = meter()
    for agent in (3, 1, 3):
        books.came(agent)
    hear(books, 2, 0, 10.0, 4.5)
    assert books.alive == [1, 3]
    books.went(3)
    books.went(3)
    assert books.alive == [1]
    books.came(3)
    found = books.totals["agents"]
    assert (found["3"]["absences"], found["1"]["absences"]) == (1, 0)
    assert (found["2"]["alive"], found["2"]["last_heard_s"], found["2"]["reports"]) == (False, 4.5, 1)


def test_a_body_that_is_not_well_is_told_of_until_it_is_well_or_gone() -> None:
    """By its agent's own words, which are no workload."""
    books = meter()
    books.came(3)
    for agent, fault in ((3, "no battery"), (1, "no position"), (3, "no fuel"), (1, "")):
        assert books.on_health(agent, encode_health(Health(fault))) is None
    assert books.faulty == {3: "no fuel"}
    assert (books.fault_of(3), books.fault_of(1), books.fault_of(9), books.fault_of(None)) == ("no fuel", "", "", "")
    assert books.totals["agents"]["3"]["fault"] == "no fuel"
    books.went(3)
    assert books.faulty == {}
    assert [books.totals["agents"]["3"][name] for name in ("fault", "last_fault")] == ["", "no fuel"]
    workload = books.close_second(1.0, 0)
    assert workload is not None
    assert (workload.messages, workload.senders, workload.rejected) == (0, 0, 0)


@pytest.mark.parametrize(
    ("agent", "data", "reason"), [(None, encode_health(Health("x")), "no agent's key"), (1, b"\xc1", "sample")]
)
def test_health_that_is_forged_or_malformed_is_dropped(agent: int | None, data: bytes, reason: str) -> None:
    books = meter()
    books.on_health(1, encode_health(Health("no battery")))
    said = books.on_health(agent, data)
    assert said is not None
    assert reason in said
    assert books.faulty == {1: "no battery"}
    books.close_second(1.0, 0)
    assert books.totals["rejected"] == 1


def test_a_report_that_comes_again_is_not_counted_again() -> None:
    books = meter()
    assert hear(books, 1, 4, 100.0) is None
    assert hear(books, 1, 5, 101.0) is None
    assert hear(books, 1, 5, 101.0) is not None
    assert hear(books, 1, 4, 100.0) is not None
    books.close_second(1.0, 0)
    found = books.totals
    assert (found["messages"], found["lost"], found["agents"]["1"]["stale"]) == (2, 0, 2)


def test_an_agent_that_began_anew_is_heard_at_once() -> None:
    books = meter()
    for sequence, sent_s in ((7, 100.0), (8, 101.0), (0, 130.0), (1, 131.0)):
        assert hear(books, 1, sequence, sent_s) is None
    books.close_second(1.0, 0)
    found = books.totals
    assert (found["messages"], found["lost"], found["agents"]["1"]["restarts"]) == (4, 0, 1)


def test_so_is_one_that_had_reported_only_once() -> None:
    """The same number, sent later; the same one, sent at the same time, is a copy."""
    books = meter()
    assert [hear(books, 1, 0, sent_s) is None for sent_s in (100.0, 100.0, 130.0, 130.0)] == [True, False] * 2
    found = books.totals["agents"]["1"]
    assert (found["restarts"], found["stale"]) == (1, 2)


@in_one_test(
    ("agent", "data", "sent", "reason"),
    [
        (1, report(2, 0), None, "2 on the key of agent 1"),
        (None, report(2, 0), None, "2 on no agent's key"),
        (1, b"\xc1", None, ""),
        (1, report(1, 0), b"\xc1", ""),
        (1, report(1, 0), pack("noon"), "sent_s"),
        (1, report(1, 0), pack(float("nan")), "sent_s"),
    ],
)
def test_what_is_forged_or_malformed_is_dropped(
    agent: int | None, data: bytes, sent: bytes | None, reason: str
) -> None:
    books = meter()
    said = books.hear(agent, data, sent, 0.0)
    assert said is not None
    assert reason in said
    books.close_second(1.0, 0)
    assert (books.totals["rejected"], books.totals["messages"]) == (1, 0)


@given(st.lists(st.tuples(st.integers(0, 30), st.floats(0, 100)), max_size=40))
def test_every_report_is_counted_or_stale(arrivals: list[tuple[int, float]]) -> None:
    books = meter()
    taken = sum(hear(books, 1, sequence, sent_s) is None for sequence, sent_s in arrivals)
    books.close_second(1.0, 0)
    found = books.totals
    assert found["messages"] == taken
    assert sum(agent["stale"] for agent in found["agents"].values()) == len(arrivals) - taken


def test_a_board_whose_clock_was_set_back_is_believed_when_it_goes_on() -> None:
    """It began anew an hour in the past, as one without a battery-backed clock; nobody waits for that hour."""
    books = meter()
    for sequence in (50, 51):
        assert hear(books, 1, sequence, 7200.0 + sequence) is None
    answers = [hear(books, 1, sequence, 3600.0 + sequence, RESTART_S) for sequence in range(8)]
    assert [answer is None for answer in answers] == [False] * (INSISTS - 1) + [True] * (9 - INSISTS)
    found = books.totals["agents"]["1"]
    assert (found["restarts"], found["stale"], found["reports"]) == (1, INSISTS - 1, 2 + 9 - INSISTS)


def test_old_reports_are_not_believed_while_the_board_reports() -> None:
    """However many of a recording come in order between two of its own."""
    books = meter()
    for sequence in range(50, 60):
        assert hear(books, 1, sequence, 7200.0 + sequence, float(sequence)) is None
        assert all(hear(books, 1, old, 3600.0 + old, sequence + 0.9 * RESTART_S) for old in range(20))


def test_copies_of_old_reports_are_never_a_new_beginning() -> None:
    """Each report twice, the copies late: as many were taken as were sent."""
    books = meter()
    for sequence in range(40):
        assert hear(books, 1, sequence, 100.0 + sequence) is None
        if sequence >= 3:
            assert hear(books, 1, sequence - 3, 97.0 + sequence) is not None
    for _ in range(2 * INSISTS):
        assert hear(books, 1, 39, 139.0) is not None
    assert books.totals["agents"]["1"]["restarts"] == 0


@given(
    lives=st.lists(st.tuples(st.integers(0, 9), st.integers(1, 9), st.floats(2.0, 9.0)), max_size=40),
    step_s=st.sampled_from([0.05, 1.0]),
)
def test_a_board_that_crashes_again_and_again_is_one(lives: list[tuple[int, int, float]], step_s: float) -> None:
    """Whatever each of its lives begins with that is heard, and however short it is: it is away for 2 s between."""
    books, now_s = meter(), 0.0
    for first, count, pause_s in lives:
        now_s += pause_s
        for sequence in range(first, first + count):
            now_s += step_s
            assert hear(books, 1, sequence, 1000.0 + now_s, now_s) is None
    assert books.doubled == []
    if lives:
        assert not books.totals["agents"]["1"]["doubled"]


def test_one_that_begins_at_0_is_no_other_one_however_soon_it_is_back() -> None:
    books = meter()
    for report_number in range(60):
        hear(books, 1, report_number % 3, 100.0 + report_number, report_number / 10)
    assert books.doubled == []
    found = books.totals
    assert (found["agents"]["1"]["restarts"], found["lost"]) == (19, 0)


@given(
    starts=st.lists(st.integers(0, 200), min_size=2, max_size=5),
    skews_s=st.lists(st.floats(-5000, 5000), min_size=5, max_size=5),
    data=st.data(),
)
def test_boards_with_one_number_are_told_and_nothing_is_lost(
    starts: list[int], skews_s: list[float], data: st.DataObject
) -> None:
    """In whatever order they take turns, and whatever their clocks say."""
    books, numbers, now_s = meter(), list(starts), 0.0
    rounds = 2 * (RETURNS + len(starts))
    for _ in range(rounds):
        for board in data.draw(st.permutations(range(len(starts)))):
            now_s += 1 / len(starts)
            hear(books, 1, numbers[board], 10_000.0 + now_s + skews_s[board], now_s)
            numbers[board] += 1
    assert books.doubled == [1]
    found = books.totals
    assert found["lost"] == 0
    assert found["agents"]["1"]["restarts"] < len(starts)


def test_one_that_is_alone_again_is_told_of_no_more() -> None:
    books = meter()
    for sequence in range(RETURNS + 1):
        for start in (100, 0):
            hear(books, 1, start + sequence, 1000.0 + 2 * sequence + (start == 0), sequence)
    assert (books.doubled, books.is_doubled(1), books.is_doubled(2), books.is_doubled(None)) == (
        [1],
        True,
        False,
        False,
    )
    for sequence in range(200, 310):
        hear(books, 1, sequence, 1000.0 + sequence, sequence)
    assert books.doubled == []
    assert books.totals["agents"]["1"]["doubled"]


def test_what_was_thought_lost_and_comes_from_another_board_was_not() -> None:
    books = meter()
    for now_s, sequence in enumerate((62, 105, 63, 106)):
        assert hear(books, 1, sequence, 100.0 + now_s, now_s) is None
        books.close_second(now_s + 1.0, 0)
        assert books.totals["lost"] == (42 if sequence == 105 else 0)


def test_of_one_agent_a_step_takes_so_many_bytes_and_no_more() -> None:
    """The rest is counted as rejected, of that agent; the next step begins anew."""
    books = meter()
    events = tuple(Event(70_000, 1.0, 2.0) for _ in range(MAX_REPORTED))
    large = [encode_report(Report(1, 70_000 + n, 0, "root", 1.0, 2.0, 3, events)) for n in range(3000)]
    room = MAX_STEP_BYTES // len(large[0])
    for data in large[: room + 3]:
        books.hear(1, data, pack(10.0), 0.0)
    hear(books, 2, 0, 10.0)
    first = books.close_second(1.0, 0)
    assert first is not None
    assert (first.messages, first.rejected) == (room + 1, 3)
    assert {agent: row["rejected"] for agent, row in books.totals["per_sender"].items()} == {"1": 3, "2": 0}
    assert hear(books, 1, 80_000, 11.0, 1.5) is None


def test_strangers_are_known_up_to_a_number() -> None:
    """By report, health and token alike; whoever is known already stays so."""
    books = meter()
    books.came(3)
    for agent in range(MAX_AGENTS + 10):
        (books.came, books.went)[agent % 2](agent)
    assert hear(books, 60_000, 0, 10.0) is not None
    assert books.on_health(60_001, encode_health(Health("faulty"))) is not None
    assert len(books.agents) == MAX_AGENTS
    assert hear(books, 3, 0, 10.0) is None


def test_a_recording_of_yesterday_is_told_from_the_agent_that_goes_on() -> None:
    """Played with the board's own certificate while the board reports: none of it counts, and two are seen to speak."""
    books = meter()
    for second in range(40):
        assert hear(books, 1, 1000 + second, 90_000.0 + second, second) is None
        assert hear(books, 1, 500 + second, 3600.0 + second, second + 0.5) is not None
    assert books.is_doubled(1)
    assert books.agents[1].reports == 40
