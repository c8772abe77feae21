"""Central control: where agents wait, who goes to which event, and what everybody must hear. Bounds plan alike."""

import json
import math
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controller import ControllerContext, Percept, agent_rng
from deltaswarm_agent.controllers.central import frames
from deltaswarm_agent.controllers.central.controller import PLANNER, CentralController, CentralSettings
from deltaswarm_agent.controllers.central.frames import SensedFrame
from deltaswarm_agent.controllers.central.maps import Cells, KnownMap, LearntMap
from deltaswarm_agent.controllers.central.overview import Overview
from deltaswarm_agent.controllers.central.planner import AT_EVENT_SHARE, POST_SHARE, Planner, posts
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.messages import Event, Pose
from deltaswarm_wire.operator_messages import decode_report
from deltaswarm_wire.settings import AgentSettings
from tests.support.tiers import in_one_test

TASK = AgentSettings(range_m=150.0)
RANGE_M = TASK.sensing_range_m
places = st.tuples(st.floats(0, 100), st.floats(0, 100))


def a_planner(agents_per_event: int = 1, task: AgentSettings = TASK) -> Planner:
    cells = Cells(task)
    return Planner(task, LearntMap(cells), cells, Random(1), agents_per_event)


def spread(count: int) -> dict[int, Pose]:
    rng = Random(count)
    return {agent: (rng.uniform(0, 100), rng.uniform(0, 100)) for agent in range(count)}


def distance_m(a: Pose, b: Pose) -> float:
    return math.dist(a, b)


def moved(at_m: Pose, goal_m: Pose, step_s: float) -> Pose:
    """Where an agent is a step later, at 1 m/s."""
    share = min(1.0, step_s / max(distance_m(at_m, goal_m), 1e-9))
    return at_m[0] + share * (goal_m[0] - at_m[0]), at_m[1] + share * (goal_m[1] - at_m[1])


@given(st.dictionaries(st.integers(0, 9), places, min_size=1), st.dictionaries(st.integers(1, 99), places, max_size=12))
def test_every_agent_gets_a_goal_in_the_arena_and_no_event_two_agents(
    agents: dict[int, Pose], events: dict[int, Pose]
) -> None:
    """With one agent per event, as many events are served as there are agents."""
    goals = a_planner().plan(0.0, agents, events)
    assert goals.keys() == agents.keys()
    assert all(0 <= x_m <= 100 and 0 <= y_m <= 100 for x_m, y_m in goals.values())
    near = [[agent for agent in goals if distance_m(goals[agent], at_m) <= RANGE_M] for at_m in events.values()]
    assert sum(bool(one) for one in near) >= min(len(agents), len(events))


def test_the_nearest_free_agents_go_to_events() -> None:
    """The sum of ways is the shortest, and an agent stops as soon as it senses its event."""
    goals = a_planner().plan(0.0, {0: (0.0, 0.0), 1: (40.0, 0.0), 2: (90.0, 90.0)}, {7: (20.0, 0.0), 8: (60.0, 0.0)})
    assert goals[0] == pytest.approx((20.0 - AT_EVENT_SHARE * RANGE_M, 0.0))
    assert goals[1] == pytest.approx((60.0 - AT_EVENT_SHARE * RANGE_M, 0.0))


def test_an_event_where_somebody_stands_needs_nobody_else() -> None:
    planner, agents = a_planner(), {0: (0.0, 0.0), 1: (50.0, 50.0)}
    agents[0] = planner.plan(0.0, agents, {7: (10.0, 0.0)})[0]
    both = {7: (10.0, 0.0), 8: (12.0, 0.0), 9: (8.0, 4.0)}  # agent 0 senses the last one, too
    goals = planner.plan(1.0, agents, both)
    assert goals[0] == agents[0]
    assert distance_m(goals[1], both[8]) <= RANGE_M  # out of range from where agent 0 stands
    assert distance_m(planner.plan(2.0, {0: agents[0]}, {9: (90.0, 0.0)})[0], (90.0, 0.0)) <= RANGE_M


@pytest.mark.parametrize("agents_per_event", [1, 2, 4])
def test_patrols_help_nearby(agents_per_event: int) -> None:
    """As many as may work at an event; a new event takes helpers away again."""
    planner = a_planner(agents_per_event)
    agents = {agent: (50.0 + agent, 50.0) for agent in range(6)}
    goals = planner.plan(0.0, agents, {7: (45.0, 50.0)})
    assert sum(distance_m(goal, (45.0, 50.0)) <= RANGE_M for goal in goals.values()) == agents_per_event
    everywhere = {7: (45.0, 50.0)} | {10 + number: (40.0, 70.0 + 2 * number) for number in range(5)}
    goals = planner.plan(1.0, agents, everywhere)
    assert all(any(distance_m(goal, at_m) <= RANGE_M for goal in goals.values()) for at_m in everywhere.values())


@pytest.mark.parametrize("step_s", [0.5, 1.0, 4.0])
def test_agents_wait_where_many_events_occurred(step_s: float) -> None:
    """Most, but not all; the others look elsewhere."""
    planner, agents, rng = a_planner(), spread(20), Random(3)
    for step in range(round(1201 / step_s)):
        event = {step: (rng.gauss(50, 6), rng.gauss(50, 6))} if step % round(20 / step_s) == 0 else {}
        goals = planner.plan(step * step_s, agents, event)
        agents = {agent: moved(at_m, goals[agent], step_s) for agent, at_m in agents.items()}
    central = [agent for agent, at_m in agents.items() if distance_m(at_m, (50.0, 50.0)) < 20]
    assert 0.5 * POST_SHARE * 20 <= len(central) < 20


def test_patrols_pass_everywhere() -> None:
    planner, agents = a_planner(), spread(25)
    seen: set[tuple[int, int]] = set()
    for step in range(400):
        goals = planner.plan(float(step), agents, {})
        agents = {agent: moved(at_m, goals[agent], 1.0) for agent, at_m in agents.items()}
        seen |= {(int(x_m // 10), int(y_m // 10)) for x_m, y_m in agents.values()}
    assert len(seen) == 100


POST_M = (50.0, 50.0)


def a_planner_that_knows(rate_hz: float, agents_per_event: int = 1) -> Planner:
    """All events occur at `POST_M`, at a known rate."""
    cells = Cells(TASK)
    known = KnownMap(cells, rate_hz, lambda _: np.full((10, 2), POST_M[0]))
    return Planner(TASK, known, cells, Random(1), agents_per_event)


@pytest.mark.parametrize(("rate_hz", "is_post"), [(1 / 200, True), (1 / 400, False)])
def test_a_post_has_more_events_than_a_patrol_finds(rate_hz: float, is_post: bool) -> None:
    """At first a patrol is taken to find one event in 300 s."""
    goals = a_planner_that_knows(rate_hz).plan(0.0, {0: POST_M, 1: (90.0, 90.0)}, {})
    assert (goals[0] == POST_M) == is_post
    assert goals[1] != POST_M


@pytest.mark.parametrize(
    ("found_at_m", "count", "is_post"), [((53.0, 50.0), 20, True), ((90.0, 50.0), 2, True), ((90.0, 50.0), 4, False)]
)
def test_only_events_away_from_posts_are_found_by_patrols(found_at_m: Pose, count: int, is_post: bool) -> None:
    """One patrol that finds 4 events in 120 s (5 in 420 s with the first) beats a post with an event in 100 s."""
    planner, agents = a_planner_that_knows(1 / 100), {0: POST_M, 1: (90.0, 90.0)}
    assert planner.plan(0.0, agents, {})[0] == POST_M
    for step in range(1, count + 1):
        planner.plan(step * 5.0, agents, {step: found_at_m})
    assert (planner.plan(119.0, agents, {})[0], planner.plan(121.0, agents, {})[0] == POST_M) == (POST_M, is_post)


@pytest.mark.parametrize(("patrol_m", "sent"), [(29.0, 1), (31.0, 0)])
def test_an_agent_leaves_its_post_if_every_patrol_is_20_m_farther(patrol_m: float, sent: int) -> None:
    """The event is 10 m from the post."""
    planner, event_m = a_planner_that_knows(1 / 100), (50.0, 60.0)
    agents = {0: POST_M, 1: (50.0, 60.0 + patrol_m)}
    assert planner.plan(0.0, agents, {})[0] == POST_M
    goals = planner.plan(1.0, agents, {7: event_m})
    assert [agent for agent in goals if distance_m(goals[agent], event_m) <= RANGE_M] == [sent]


def test_an_agent_that_works_at_its_post_is_not_sent_elsewhere() -> None:
    planner, agents = a_planner_that_knows(1 / 100), {0: POST_M, 1: (5.0, 50.0)}
    assert planner.plan(0.0, agents, {})[0] == POST_M
    goals = planner.plan(1.0, agents, {7: (52.0, 50.0), 8: (70.0, 50.0)})
    assert goals[0] == POST_M
    assert distance_m(goals[1], (70.0, 50.0)) <= RANGE_M


@pytest.mark.parametrize(("away_m", "helps"), [(19.0, True), (21.0, False)])
def test_a_patrol_helps_within_20_m(away_m: float, helps: bool) -> None:
    agents = {0: (50.0, 50.0), 1: (50.0, 50.0 + away_m)}
    goals = a_planner(agents_per_event=2).plan(0.0, agents, {7: (50.0, 50.0)})
    assert (distance_m(goals[1], (50.0, 50.0)) <= RANGE_M) == helps


def test_patrols_keep_their_goals_for_20_s_and_apart() -> None:
    """Or until they are there. No patrol goes to within two sensing ranges of where another goes."""
    planner, agents = a_planner(), {0: (50.0, 50.0), 1: (50.0, 50.0)}
    first = planner.plan(0.0, agents, {})
    planner.plan(10.0, agents, {})
    goals = planner.plan(19.0, agents, {})
    assert goals == first
    later = planner.plan(20.0, agents, {})
    assert later[0] != first[0]
    assert distance_m(later[0], later[1]) >= 2 * RANGE_M
    assert planner.plan(21.0, agents | {0: later[0]}, {})[0] != later[0]


@given(st.lists(places, min_size=1, max_size=40), st.integers(0, 12))
def test_posts_are_among_their_places(around: list[Pose], count: int) -> None:
    at_m = np.array(around)
    found_m = posts(at_m, count, RANGE_M, Random(1))
    assert found_m.shape == (count, 2)
    assert (found_m >= at_m.min(axis=0) - 1e-9).all()
    assert (found_m <= at_m.max(axis=0) + 1e-9).all()


def test_two_clusters_get_posts_in_both() -> None:
    rng = np.random.default_rng(5)
    at_m = np.concatenate([rng.normal((30, 30), 3, (80, 2)), rng.normal((70, 70), 3, (20, 2))])
    found_m = posts(at_m, 4, RANGE_M, Random(1))
    assert {bool(x_m > 50) for x_m, _ in found_m} == {True, False}


def test_a_post_stands_between_places_that_it_can_serve_both() -> None:
    """12 m apart, with 8 m in reach: nearer to one of them, the other would not be served at once."""
    at_m = np.array([(0.0, 0.0)] * 10 + [(12.0, 0.0)] * 10)
    [(x_m, y_m)] = posts(at_m, 1, 10.0, Random(1))
    assert 4.0 <= x_m <= 8.0
    assert y_m == 0.0


def test_the_second_post_goes_to_what_the_first_cannot_reach() -> None:
    """Places within 8 m of the first are served at once, and need no post of their own, however many they are."""
    at_m = np.array([(-7.0, 0.0)] * 10 + [(0.0, 0.0)] + [(7.0, 0.0)] * 10 + [(0.0, 20.0)] * 2)
    found_m = posts(at_m, 2, 10.0, Random(1))
    assert found_m[found_m[:, 1].argsort()] == pytest.approx(np.array([(0.0, 0.0), (0.0, 20.0)]), abs=1.0)


def test_no_post_is_drawn_to_what_is_out_of_its_reach_anyway() -> None:
    """It is where most places are, and not where the sum of all distances is shortest."""
    at_m = np.array([(0.0, 0.0)] * 3 + [(200.0, 0.0)] * 2 + [(240.0, 0.0)] * 2)
    [(x_m, _)] = posts(at_m, 1, 10.0, Random(1))
    assert x_m < 100.0


def test_what_is_learnt_fades() -> None:
    learnt = LearntMap(Cells(TASK))
    learnt.learn(0.0, 20.0, 20.0)
    fresh = learnt.weights(0.0).max()
    assert learnt.weights(3000.0).max() < 0.5 * fresh
    assert len(learnt.places_m(2999.0)) == 1
    assert len(learnt.places_m(3001.0)) == 0


def test_a_known_density_that_moves_is_sampled_anew() -> None:
    """No more often than said."""
    drawn: list[float] = []

    def sample(time_s: float) -> np.ndarray:
        drawn.append(time_s)
        return np.full((10, 2), 10.0 + time_s)

    known = KnownMap(Cells(TASK), 0.05, sample, 60.0)
    for time_s in range(0, 121, 10):
        known.weights(float(time_s))
        known.places_m(float(time_s))
    assert drawn == [0.0, 60.0, 120.0]
    assert known.rate_near_hz(120.0, np.array([[130.0, 130.0], [0.0, 0.0]]), 5.0).tolist() == [0.05, 0.0]


sensed_frames = st.builds(
    SensedFrame,
    st.tuples(st.integers(0, 10_000), st.integers(0, 10_000)).map(lambda cm: (cm[0] / 100, cm[1] / 100)),
    st.lists(
        st.builds(Event, st.integers(0, 2**32 - 1), st.integers(0, 10_000).map(lambda cm: cm / 100), st.just(1.5)),
        max_size=20,
    ).map(tuple),
)


@given(sensed_frames, st.dictionaries(st.integers(0, 0xFFFF), st.just((12.34, 0.0)), max_size=20))
def test_frames_return_as_they_were(sensed: SensedFrame, goals: dict[int, Pose]) -> None:
    assert frames.decode_sensed(frames.encode_sensed(sensed)) == sensed
    assert frames.decode_plan(frames.encode_plan(goals)) == goals
    with pytest.raises(WireError):
        frames.decode_plan(frames.encode_sensed(sensed))
    with pytest.raises(WireError):
        frames.decode_sensed(frames.encode_plan(goals))


@given(st.binary(max_size=60))
def test_rubbish_on_the_air_is_counted(data: bytes) -> None:
    for agent in (PLANNER, 1):
        one = CentralController(ControllerContext(agent, "central", CentralSettings(), TASK, agent_rng(1, agent)))
        decision = one.step(Percept(0, 0.0, (50.0, 50.0), (), (), [(1 - agent, data)]))
        assert all(map(math.isfinite, decision.velocity))


def test_an_event_that_is_not_sensed_any_more_is_gone() -> None:
    """Only for an agent that is near enough to sense it."""
    overview = Overview(TASK, 15.0)
    overview.update(1, SensedFrame((10.0, 10.0), (Event(7, 12.0, 10.0),)), 0.0)
    overview.update(2, SensedFrame((40.0, 10.0), ()), 1.0)
    assert overview.events == {7: (12.0, 10.0)}
    overview.update(2, SensedFrame((14.0, 10.0), ()), 2.0)
    assert overview.events == {}


@pytest.mark.parametrize("step_s", [0.5, 2.0])
def test_agents_are_expected_where_they_were_sent(step_s: float) -> None:
    overview = Overview(AgentSettings(step_s=step_s), 15.0)
    overview.update(1, SensedFrame((10.0, 10.0), ()), 0.0)
    for step in range(1, round(10 / step_s) + 1):
        overview.advance({1: (90.0, 10.0)}, step * step_s)
    assert overview.agents == {1: pytest.approx((20.0, 10.0))}
    overview.advance({}, 16.0)
    assert overview.agents == {}


SHORT = ["run.duration_s=1500", "control.mode=central", "radio.range_m=150"]


def waiting_s(*overrides: str) -> float:
    scenario = load_scenario("paper-25", [*overrides], 3)
    outcome = run_in_process(scenario)
    found: float = summarise(outcome, scenario)["waiting_time_s"]["restricted_mean"]
    return found


def test_more_knowledge_means_less_waiting() -> None:
    shared = ["run.duration_s=600", "metrics.horizon_s=200", "events.rate_hz=0.1"]
    decentralised = waiting_s(*shared, "control.mode=decentralised")
    central = waiting_s(*shared, *SHORT[1:])
    everything = waiting_s(*shared, "run.bound=everything")
    density = waiting_s(*shared, "run.bound=density")
    assert everything < density < decentralised
    assert everything < central < 0.5 * decentralised


@in_one_test(
    ("overrides", "digest"),
    [
        (["run.duration_s=600"], "89ee56d45e302d10822512c34f0c9f0a"),
        (["run.duration_s=900", "run.step_s=2", "events.rate_hz=0.02"], "3640dbad8bddb621e7000df08b142953"),
    ],
)
def test_the_planner_decides_as_it_did_for_the_published_results(overrides: list[str], digest: str) -> None:
    """These digests were recorded; whatever moves them makes the published runs of central control another swarm's."""
    scenario = load_scenario("paper-25", [*SHORT[1:], "metrics.horizon_s=100", "record=off", *overrides], 1)
    assert run_in_process(scenario).digest == digest


def test_the_planner_alone_reports() -> None:
    """For everybody, once a second while an event is known, whatever the length of a step."""
    for step_s in (0.5, 1.0):
        scenario = load_scenario("paper-25", [*SHORT, f"run.step_s={step_s}", "events.rate_hz=0.2"], 3)
        swarm = InProcess(scenario)
        reports = 0
        for step in range(round(300 / step_s)):
            swarm.step(step, last=False)
            reports += len(swarm.world.forwarded)
            assert {decode_report(one.report).agent for one in swarm.world.forwarded} <= {PLANNER}
        assert 200 < reports <= 300


@in_one_test(
    ("overrides", "said"),
    [
        (["control.mode=central"], "141.4 m"),
        (["control.mode=central", "radio.range_m=141"], "141.4 m"),
        ([*SHORT, "arena.obstacles=[{corners_m=[[1,1],[2,1],[2,2]]}]"], "obstacles"),
        (["run.bound=density", "arena.obstacles=[{corners_m=[[1,1],[2,1],[2,2]]}]"], "run.bound"),
        (["run.bound=sometimes"], "run.bound"),
    ],
)
def test_what_central_control_and_bounds_need(overrides: list[str], said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        load_scenario("paper-25", overrides)


def test_processes_compute_no_bound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No agent can know what a bound knows; one process can, and says so in its folder."""
    arguments = ["run", "smoke", "--set", "run.bound=everything", "--record", "off"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 2
    assert "--in-process" in capsys.readouterr().err
    assert main([*arguments, "--in-process", "--out", str(tmp_path / "run")]) == 0
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["valid"]
    assert 'bound = "everything"' in (tmp_path / "run" / "scenario.toml").read_text()
