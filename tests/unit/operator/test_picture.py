"""The operator's picture: it holds what was reported and nothing else, and late news make nothing older or younger."""

from collections.abc import Sequence
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.picture import EVENT_MEMORY_S, LEFT, Picture
from deltaswarm_operator.inbox.item import item_row
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Report, ReportedMember
from tests.support.commanding import reloaded

AGENTS = 6


def root(agent: int, step: int, *members: int, events: Sequence[int] = (1,), followers: int | None = None) -> Report:
    """A root's report, with members in a chain; places say who told them, and when."""
    named = tuple([ReportedMember(member, agent, 100 * step, 100 * agent) for member in members])
    seen = tuple([Event(event, float(event), 0.0) for event in events])
    count = len(members) if followers is None else followers
    return Report(agent, step, step, "root", float(step), float(agent), count, seen, named)


def attending(agent: int, step: int, event: int = 1) -> Report:
    return Report(agent, step, step, "attending", float(step), float(agent), 0, (Event(event, float(event), 0.0),))


@st.composite
def lives(draw: st.DrawFn) -> list[list[Report]]:
    """Reports by the step in which they arrive: at most one of an agent and step, some late."""
    rng = Random(draw(st.integers(0, 10**6)))
    arriving: list[list[Report]] = [[] for _ in range(30)]
    for step in range(20):
        for agent in range(AGENTS):
            if rng.random() < 0.5:
                continue
            events = rng.sample(range(1, 5), rng.randint(0, 3))
            members = rng.sample(range(AGENTS), rng.randint(0, 3))
            report = root(agent, step, *members, events=events)
            if rng.random() < 0.5:
                report = attending(agent, step, rng.randint(1, 4))
            arriving[step + rng.choice([0, 0, 0, 1, 9])].append(report)
    return [sorted(reports, key=lambda report: (report.agent, report.sequence)) for reports in arriving]


@given(lives())
def test_nothing_is_in_it_that_no_report_told(life: list[list[Report]]) -> None:
    """Each place was told, by the agent or by the root that is named; each event too; and time never goes back."""
    picture = Picture(1.0)
    told: set[tuple[int, float, float, float, bool]] = set()
    places: set[tuple[float, float]] = set()
    before: dict[int, float] = {}
    seen_before: dict[int, float] = {}
    for now, reports in enumerate(life):
        picture.update(reports, float(now))
        for report in reports:
            told.add((report.agent, report.x_m, report.y_m, report.step, True))
            told |= {(m.agent, m.x_cm / 100, m.y_cm / 100, report.step, False) for m in report.members}
            places |= {(event.x_m, event.y_m) for event in report.events}
        for agent, known in picture.agents.items():
            assert (agent, known.x_m, known.y_m, known.said_s, known.is_own) in told
            assert known.said_s >= before.get(agent, -1)
            assert known.parent != agent
        for event, seen in picture.events.items():
            assert (seen.x_m, seen.y_m) in places
            assert seen.first_s <= seen.last_s <= now
            assert seen.last_s >= seen_before.get(event, -1) or seen_before[event] < seen.first_s
        assert before.keys() <= picture.agents.keys()
        before = {agent: known.said_s for agent, known in picture.agents.items()}
        seen_before = {event: seen.last_s for event, seen in picture.events.items()}


def test_a_late_report_puts_nobody_back() -> None:
    """Neither its sender, named by a root since, nor the event that it tells of."""
    picture = Picture(1.0)
    picture.update([root(0, 10, 5)], 10.0)
    picture.update([attending(5, 3)], 11.0)
    assert picture.agents[5].said_s == 10
    assert picture.agents[5].root == 0
    assert picture.events[1].last_s == 10
    picture.update([attending(5, 12)], 12.0)
    picture.update([attending(5, 11)], 13.0)
    assert picture.agents[5].said_s == 12
    assert picture.agents[5].role == "attending"
    picture.update([root(0, 11, 5)], 14.0)
    assert picture.agents[5].role == "attending"


def test_an_event_names_who_says_that_it_attends_it() -> None:
    """All of them, until they report something else or a root names them as members of its tree."""
    picture = Picture(1.0)
    picture.update([root(0, 1, events=(1,)), attending(3, 1), attending(5, 1), attending(6, 1, event=2)], 1.0)
    assert [row[6] for row in picture.rows()["events"]] == [[3, 5], [6]]
    picture.update([root(0, 2, 5, events=(1,)), attending(3, 2, event=2)], 2.0)
    assert [row[6] for row in picture.rows()["events"]] == [[], [3, 6]]


def test_an_event_leaves_a_trail_of_the_places_that_were_reported_before() -> None:
    """The newest six, oldest first; a place that is reported again is none."""
    picture = Picture(1.0)
    for step, x_m in enumerate((1.0, 1.0, 2.0, 3.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)):
        picture.update([Report(5, step, step, "attending", 0.0, 0.0, 0, (Event(9, x_m, 2.0),))], float(step))
        if step == 1:
            assert picture.rows()["events"][0][7] == []
    assert picture.rows()["events"][0][7] == [[x_m, 2.0] for x_m in (2.0, 3.0, 4.0, 5.0, 6.0, 7.0)]


def test_a_late_report_puts_nobody_back_after_a_restart() -> None:
    """A picture that goes on from another's state drops what that would have dropped."""
    before = Picture(1.0)
    before.update([attending(1, 5, event=2)], 5.0)
    after = reloaded(before)
    late = [attending(1, 3, event=1)]
    assert after.update(late, 6.0) == before.update(late, 6.0) == []
    assert after.rows() == before.rows()


def test_what_an_agent_says_of_itself_counts_more_than_its_root() -> None:
    for own, other in ((1, 2), (2, 1)):
        picture = Picture(1.0)
        picture.update(sorted([attending(own, 4), root(other, 4, own)]), 4.0)
        assert picture.agents[own].role == "attending"


def test_members_that_are_named_no_more_have_left() -> None:
    """One, or the last; a root that names nobody, though it has followers, tells nothing of them."""
    picture = Picture(1.0)
    picture.update([root(0, 1, 1, 2, 3)], 1.0)
    assert {agent: known.root for agent, known in picture.agents.items()} == {0: 0, 1: 0, 2: 0, 3: 0}
    picture.update([root(0, 2, 1, 2)], 2.0)
    assert picture.agents[3].role == LEFT
    assert picture.agents[3].said_s == 1
    picture.update([root(0, 3, followers=2)], 3.0)
    assert picture.agents[1].root == 0
    picture.update([root(0, 4)], 4.0)
    assert {picture.agents[agent].role for agent in (1, 2, 3)} == {LEFT}
    picture.update([root(4, 5, 1, 2)], 5.0)
    assert {picture.agents[agent].root for agent in (1, 2)} == {4}
    picture.update([attending(4, 6)], 6.0)
    assert {picture.agents[agent].role for agent in (1, 2)} == {LEFT}


def test_events_that_nobody_reports_any_more_are_closed() -> None:
    """With the times of their first and last report; one that is reported again is open since its first report."""
    picture = Picture(1.0)
    picture.update([attending(1, 1, event=7), attending(2, 1, event=8)], 1.0)
    assert picture.closed_after_s is None
    picture.update([attending(1, 5, event=7), attending(2, 9, event=8)], 9.0)
    picture.update([attending(1, 10, event=9), attending(2, 10, event=10)], 10.0)
    assert picture.closed == {1: (1.0, 5.0), 2: (1.0, 9.0)}
    assert picture.closed_after_s == (4.0 + 8.0) / 2
    again = reloaded(picture)
    again.update([attending(2, 12, event=8)], 12.0)
    assert again.closed == {1: (1.0, 5.0), 4: (10.0, 10.0)}
    assert again.events[2].first_s == 1.0
    again.update([attending(2, 20, event=5)], 20.0)
    assert again.closed[2] == (1.0, 12.0)


def test_a_root_that_names_itself_stays_a_root() -> None:
    picture = Picture(1.0)
    picture.update([root(3, 1, 3)], 1.0)
    assert picture.agents[3].role == "root"


def test_an_event_goes_when_its_reporter_is_silent_of_it_or_nobody_tells_for_long() -> None:
    picture = Picture(1.0)
    picture.update([root(0, 1, events=[77, 78]), root(1, 1, events=[78])], 1.0)
    assert set(picture.events) == {1, 2}
    picture.update([root(0, 2, events=[])], 2.0)
    assert set(picture.events) == {2}
    picture.update([], 1 + EVENT_MEMORY_S)
    assert set(picture.events) == {2}
    picture.update([], 2 + EVENT_MEMORY_S)
    assert not picture.events
    picture.update([root(0, 400, events=[78])], 400.0)
    assert set(picture.events) == {2}


def test_the_inbox_has_what_is_new_of_each_sender() -> None:
    picture = Picture(1.0)
    first = picture.update([root(0, 1, events=[5]), attending(1, 1, 5)], 1.0)
    assert [item.is_new for item in first] == [True, False]
    assert picture.update([root(0, 2, events=[5])], 2.0) == []
    assert [item.events for item in picture.update([root(0, 3, events=[5, 6])], 70.0)] == [(1, 2)]
    assert item_row(first[0], 7)[:3] == [0, 1.0, 0]
    assert item_row(first[0], 7)[7:] == ["alert", 0, 7]
