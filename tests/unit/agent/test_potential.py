"""Virtual forces: agents spread by what their neighbours broadcast, and tell of what they sense."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controller import ControllerContext, Percept, agent_rng
from deltaswarm_agent.controllers.potential import PotentialController, PotentialSettings
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.messages import NOBODY, Event, Pose
from deltaswarm_wire.settings import AgentSettings


def an_agent(agent: int = 1, **options: float) -> PotentialController:
    settings = PotentialSettings(**options)
    return PotentialController(ControllerContext(agent, "potential", settings, AgentSettings(), agent_rng(1, agent)))


def percept(step: int, pose: Pose, heard: list[tuple[int, bytes]], events: tuple[Event, ...] = ()) -> Percept:
    return Percept(step, float(step), pose, (), events, heard)


def beacon_of(pose: Pose) -> bytes:
    sender = an_agent(2, beacon_s=1.0)
    return next(filter(None, (sender.step(percept(step, pose, [])).payload for step in range(3))))


@given(st.floats(0, math.tau), st.floats(0.1, 8.9))
def test_a_neighbour_pushes_straight_away(direction: float, distance_m: float) -> None:
    """From wherever it is within the spacing; farther off it does not."""
    other = (50 + distance_m * math.cos(direction), 50 + distance_m * math.sin(direction))
    decision = an_agent().step(percept(0, (50.0, 50.0), [(2, beacon_of(other))]))
    speed_mps = math.hypot(*decision.velocity)
    if speed_mps:
        away = (-math.cos(direction), -math.sin(direction))
        assert np.dot(decision.velocity, away) == pytest.approx(speed_mps, rel=0.01)
    assert speed_mps <= 1.0 + 1e-9
    assert an_agent().step(percept(0, (50.0, 50.0), [(2, beacon_of((60.0, 50.0)))])).velocity == (0.0, 0.0)


def test_a_neighbour_unheard_is_forgotten() -> None:
    agent = an_agent(memory_s=3.0)
    assert agent.step(percept(0, (50.0, 50.0), [(2, beacon_of((52.0, 50.0)))])).velocity != (0.0, 0.0)
    assert agent.step(percept(4, (50.0, 50.0), [])).velocity == (0.0, 0.0)


@given(st.binary(max_size=40))
def test_rubbish_on_the_air_moves_nobody(data: bytes) -> None:
    decision = an_agent().step(percept(0, (50.0, 50.0), [(2, data)]))
    assert all(map(math.isfinite, decision.velocity))


def test_an_agent_that_senses_an_event_stands_and_reports_it() -> None:
    near, far = Event(7, 51.0, 50.0), Event(8, 54.0, 50.0)
    decision = an_agent().step(percept(0, (50.0, 50.0), [(2, beacon_of((52.0, 50.0)))], (far, near)))
    assert (decision.velocity, decision.observed, decision.role) == ((0.0, 0.0), (7,), "attending")
    assert decision.report is not None
    assert decision.report.events == (near,)


def test_a_swarm_spreads() -> None:
    """Neighbours end up farther apart, in no tree, each with the role that it gives itself."""
    swarm = InProcess(load_scenario("paper-25", ["control.mode=potential", "events.rate_hz=0", "record=off"], 1))

    def nearest_m() -> float:
        places = swarm.world.environment.positions_m
        gaps = np.hypot(*(places[:, None] - places).T) + 1e9 * np.eye(len(places))
        return float(gaps.min(axis=0).mean())

    swarm.step(0, last=False)
    before = nearest_m()
    for step in range(1, 200):
        record = swarm.step(step, last=False)
    assert nearest_m() > 1.15 * before
    bodies = swarm.world.truth(record).bodies
    assert {(body.role, body.root) for body in bodies} == {("spreading", NOBODY)}
