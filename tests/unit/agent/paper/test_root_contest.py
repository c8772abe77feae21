"""Roots in range of one another: who is senior, with and without latency, and what becomes of the junior."""

from itertools import combinations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.frames import Leaving, Member, PaperFrame
from deltaswarm_agent.controllers.paper.root_contest import is_senior as senior
from deltaswarm_agent.controllers.paper.states import State
from tests.support.cores import ME, STEPS, Crowd, Lone, a_root, event, member

pulses = st.integers(0, 2**32 - 1)


def is_senior(rival: int, rival_pulse: int, agent: int, pulse: int) -> bool:
    """Whether a rival root stays and the agent yields."""
    return senior(member((rival,), (0, 0), pulse=rival_pulse), pulse, agent)


@given(st.dictionaries(st.integers(0, 50), st.integers(0, 6) | pulses, min_size=2, max_size=6))
@example({1: 2, 2: 8, 3: 14})
def test_of_any_roots_one_is_senior_to_all_others(roots: dict[int, int]) -> None:
    """The longest pulse, then the lowest id: all come to the same answer, and of two exactly one yields."""
    juniors = {agent for agent in roots for rival in roots if is_senior(rival, roots[rival], agent, roots[agent])}
    assert roots.keys() - juniors == {min(roots, key=lambda agent: (-roots[agent], agent))}
    for agent, rival in combinations(roots, 2):
        yields = is_senior(rival, roots[rival], agent, roots[agent])
        assert yields != is_senior(agent, roots[agent], rival, roots[rival])


@given(st.integers(0, 25), st.permutations([2, 5]), st.floats(1.0, 9.5), st.sampled_from([(), (2,), (5,)]))
def test_of_two_roots_that_meet_exactly_one_stays(
    older_by: int, ids: list[int], apart_m: float, silent: tuple[int, ...]
) -> None:
    """Though each hears the other's pulse one step late, and whether or not one of them is not heard at once."""
    elder, younger = ids
    one, other = a_root((50.0, 50.0), elder), Lone(younger, (80.0, 50.0), mode="hierarchical", rho=1)
    crowd = Crowd(one)
    for _ in range(older_by):
        crowd.step()
    other.step(skip=one.now, events=[event(2, 80, 50)])
    other.at = (50 + apart_m, 50)
    crowd.lones[younger] = other
    crowd.step(silent=silent)
    for _ in range(4):
        crowd.step()
    roots = [lone.core.agent for lone in crowd.lones.values() if lone.core.state is State.ROOT]
    assert roots == [elder if older_by else min(ids)]
    (junior,) = {elder, younger} - set(roots)
    assert (crowd.lones[junior].path == (*roots, junior)) == (apart_m >= 6)


@pytest.mark.parametrize(("distance_m", "state"), [(5.99, State.WALKING), (6.0, State.MEMBER)])
def test_the_junior_root_joins_or_leaves(distance_m: float, state: State) -> None:
    """It joins the senior if it is at least d_min away; else it is free, and says that it leaves."""
    root = a_root()
    decision = root.step(member((9,), (50 + distance_m, 50), pulse=100))
    assert root.core.state is state
    assert root.path == ((9, ME) if state is State.MEMBER else ())
    assert isinstance(decision.radio, Member if state is State.MEMBER else Leaving)


def test_of_several_seniors_the_longest_pulse_wins() -> None:
    """Then the lowest id: all juniors join the same one."""
    root = a_root()
    root.step(member((8,), (58, 50), pulse=50), member((9,), (42, 50), pulse=100), member((10,), (50, 58), pulse=100))
    assert root.path == (9, ME)


@given(
    st.lists(st.integers(0, 10), min_size=2, max_size=4),
    st.permutations([2, 4, 6, 8]),
    st.integers(0, 4),
    st.integers(0, 20),
)
def test_with_latency_one_of_several_roots_stays_too(ages: list[int], ids: list[int], late: int, apart: int) -> None:
    """None yields to a younger one that it hears late; of about equal ones the lowest id stays after 12 frames."""
    roots = [a_root((50.0, 50.0), agent) for agent in ids[: len(ages)]]
    for root, age in zip(roots, ages, strict=True):
        root.steps(age + apart)
    said: list[dict[int, PaperFrame | None]] = []
    for _ in range(STEPS.contested + late + 2):
        heard = said[-1 - late].values() if len(said) > late else ()
        decisions = {
            root.core.agent: root.step(*(frame for frame in heard if frame and frame.sender != root.core.agent))
            for root in roots
        }
        said.append({agent: decision.radio for agent, decision in decisions.items()})
        assert any(root.core.state is State.ROOT for root in roots)
    assert [root.core.state for root in roots].count(State.ROOT) == 1
