"""What the world is told: in order, and with a bound on what an agent may tell."""

from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_wire.keys import AGENT, OPERATOR
from deltaswarm_world.core.participants import MAX_RETURNS, Participants
from deltaswarm_world.io.wakeup import ControlInput, ControlQueue, Persisted, Token

TOKENS = st.builds(Token, st.sampled_from([AGENT, OPERATOR]), st.integers(0, 2), st.booleans())


@given(st.lists(TOKENS | st.builds(Persisted, st.just(OPERATOR), st.integers(0, 9))))
def test_what_is_no_agents_comes_in_order_and_of_an_agents_the_newest_two(told: list[ControlInput]) -> None:
    queue = ControlQueue()
    for news in told:
        queue.put(news)
    taken = list(queue.drain())
    assert not list(queue.drain())

    def of(agent: int, found: list[ControlInput]) -> list[ControlInput]:
        return [news for news in found if isinstance(news, Token) and (news.role, news.number) == (AGENT, agent)]

    agents = [news for agent in range(3) for news in of(agent, told)]
    assert [news for news in taken if news not in agents] == [news for news in told if news not in agents]
    for agent in range(3):
        assert of(agent, taken) == of(agent, told)[-2:]


def test_who_comes_and_goes_without_end_is_taken_back_only_so_often() -> None:
    """A board always is: its link may fail as often as it will."""
    participants = Participants([0, 1, 2], boards=[2])
    for step in range(10 * MAX_RETURNS):
        participants.begin(step, [0])
        for agent in (1, 2):
            participants.token_gone(agent)
            participants.token_back(agent)
    assert participants.present == {0, 2}
    assert participants.lost == [1] * (MAX_RETURNS + 1)
