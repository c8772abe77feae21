"""The quiet sleep: whom the world asks, when, and what it tells them of the time between."""

from typing import Any

from deltaswarm_wire.messages import MAX_POSES
from tests.support.tiers import in_one_test
from tests.support.worlds import Stage


def test_an_agent_whose_act_holds_is_left_alone() -> None:
    """It goes on as it said, and its next frame tells it where it has been."""
    stage = Stage(2)
    stage.begin()
    stage.act(0, vx_mps=1.0, until=4, role="walker")
    record = stage.end()
    for step in (1, 2, 3):
        assert list(stage.begin()) == [1]
        record = stage.end()
        assert (record.agents_asked, record.agents_late) == (1, 0)
        body = stage.core.truth(record).bodies[0]
        assert (body.x_m, body.role) == (50.0 + step, "walker")
    frame = stage.begin()[0]
    assert (frame.x_m, frame.poses) == (54.0, ((51.0, 50.0), (52.0, 50.0), (53.0, 50.0)))
    assert stage.end().agents_asked == 2
    assert stage.begin()[0].poses == ()


@in_one_test("what", ["senses", "hears", "fault", "board", "last", "asks all"])
def test_an_agent_is_asked_earlier_when_something_happens(what: str) -> None:
    """It senses an event, hears a frame, is hit by a fault; boards are asked always, and all in the last step."""
    tables: dict[str, Any] = {"run": {"ask_every_step": what == "asks all"}}
    if what == "fault":
        tables["fault"] = [{"kind": "actuator-slow", "at_s": 2, "duration_s": 2, "factor": 0.5, "agents": [0]}]
    stage = Stage(2, boards=[0] if what == "board" else [], **tables)
    stage.begin()
    stage.act(0, until=50)
    stage.end()
    assert list(stage.begin()) == ([0, 1] if what in ("board", "asks all") else [1])
    if what == "hears":
        stage.say(1)
    if what == "board" or what == "asks all":
        stage.act(0, until=50)
    stage.end()
    if what == "senses":
        stage.event(50, 50)
    stage.core.inject(2)
    assert list(stage.begin(last=what == "last")) == [0, 1]


def test_an_act_holds_no_longer_than_a_frame_has_places_for() -> None:
    stage = Stage(1)
    stage.begin()
    stage.act(0, until=10_000)
    stage.end()
    for _ in range(MAX_POSES - 1):
        assert stage.begin() == {}
        stage.end()
    assert len(stage.begin()[0].poses) == MAX_POSES - 1


def test_an_agent_that_gets_no_frame_senses_nothing() -> None:
    stage = Stage(1)
    stage.begin()
    stage.end(0)
    stage.event(50, 50)
    stage.begin()
    stage.end()
    assert stage.core.environment.states()[0].sensed_s is None


def test_an_agent_that_went_and_came_back_within_a_step_is_asked() -> None:
    """It may be another process, which knows nothing of the act that holds."""
    stage = Stage()
    stage.begin()
    for agent in range(3):
        stage.act(agent, until=50)
    stage.core.end()
    stage.core.participants.token_gone(1)
    stage.core.participants.token_back(1)
    assert list(stage.begin()) == [1]


def test_an_agent_is_asked_once_more_when_its_event_is_gone() -> None:
    """Else it would stand and observe nothing until its act runs out."""
    stage = Stage(1)
    event = stage.event(50, 50)
    stage.core.environment.active[0].work_agent_s = 198.0
    for _ in range(2):
        stage.begin()
        stage.act(0, event, until=stage.step + 50)
        stage.end()
    assert stage.core.environment.states()[0].completed_s == 1.0
    assert stage.begin()[0].events == ()
    stage.act(0, until=stage.step + 50)
    stage.end()
    assert stage.begin() == {}
