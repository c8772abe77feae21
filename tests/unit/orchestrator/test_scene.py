"""The views: what a viewer shows of agents, trees, links and events."""

import math
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from deltaswarm_orchestrator.export.snapshots import read_film
from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_orchestrator.recording.scene import ROLE_COLOURS, colour, role_colour
from deltaswarm_orchestrator.recording.schemas import SCENE_TOPICS
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import AgentState, EventState
from deltaswarm_wire.checked import load
from tests.support.truths import ROLES, messages, on, recorded, shown, truth

SCENARIO = load(Scenario, {"agents": {"count": 12}})


def shapes(topic: str, found: Iterable[tuple[str, int, Any]]) -> Any:
    """The one entity of the newest message on a topic."""
    (entity,) = on(topic, found)[-1].entities
    return entity


def test_frames_of_every_step(tmp_path: Path) -> None:
    """One message a step has the arena's place in the world and every agent's place in the arena."""
    for message in on("/tf", messages(recorded(tmp_path, SCENARIO, 10))):
        arena, *agents = message.transforms
        assert (arena.parent_frame_id, arena.child_frame_id) == ("world", "arena")
        assert (arena.translation.x, arena.translation.y, arena.translation.z) == (-50.0, -50.0, 0.0)
        assert [agent.child_frame_id for agent in agents] == [f"agent/{i}" for i in range(12)]
        assert {agent.parent_frame_id for agent in agents} == {"arena"}


def test_bodies_are_drawn_in_their_size_with_their_headings(tmp_path: Path) -> None:
    """Each frame is turned, each sphere has the body's diameter, and a line leads from its centre beyond its edge."""
    world = {"dynamics": "physics", "radius_m": 0.5}
    bodies = [
        AgentState(0, 10.0, 10.0, "free", 0, -1, -1, 0, 2.0, 0.5, 0.25),
        AgentState(1, 20.0, 30.0, "root", 0, -1, 1, 0, -1.0, 0.0, 0.0),
    ]
    with Recorder(tmp_path, load(Scenario, {"world": world})) as recorder:
        recorder.step(truth(*bodies), ())
        recorder.complete({})
    found = messages(tmp_path / "recording.mcap")
    _, *frames = on("/tf", found)[-1].transforms
    assert [2 * math.atan2(frame.rotation.z, frame.rotation.w) for frame in frames] == pytest.approx([2.0, -1.0])
    told = on("/swarm/agents", found)[-1]
    assert [list(told.heading_rad), list(told.left_mps), list(told.right_mps)] == [[2.0, -1.0], [0.5, 0.0], [0.25, 0.0]]
    drawn = shapes("/scene/agents", found)
    assert [sphere.size.x for sphere in drawn.spheres] == [1.0, 1.0]
    ends = [(point.x, point.y) for point in drawn.lines[-1].points]
    for body, centre, tip in zip(bodies, ends[::2], ends[1::2], strict=True):
        assert centre == (body.x_m, body.y_m)
        assert math.atan2(tip[1] - centre[1], tip[0] - centre[0]) == pytest.approx(body.heading_rad)
        assert math.dist(centre, tip) > 0.5


def test_bodies_that_fly_are_drawn_at_their_height_and_lean(tmp_path: Path) -> None:
    """Frames have the whole pose: the nose is up by the pitch, the left side by the roll. Films read it again."""
    flying = AgentState(0, 10.0, 10.0, "free", 0, -1, -1, 0, 2.0, 0.0, 0.0, 12.5, 0.3, -0.2)
    crashed = AgentState(1, 20.0, 30.0, "dead", 0, -1, -1, 0, -1.0, 0.0, 0.0, 0.25, -1.5, 1.25)
    world = {"dynamics": "jsbsim", "radius_m": 0.5}
    with Recorder(tmp_path, load(Scenario, {"world": world})) as recorder:
        recorder.step(truth(flying, crashed), ())
        recorder.complete({})
    found = messages(tmp_path / "recording.mcap")
    _, frame, other = on("/tf", found)[-1].transforms
    assert [frame.translation.z, other.translation.z] == [12.5, 0.25]
    turn = Rotation.from_quat([getattr(frame.rotation, name) for name in "xyzw"])
    nose, left, _ = turn.apply([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert math.atan2(nose[1], nose[0]) == pytest.approx(2.0)
    assert math.asin(nose[2]) == pytest.approx(-0.2)
    assert left[2] == pytest.approx(math.sin(0.3) * math.cos(0.2))
    drawn = shapes("/scene/agents", found)
    assert [sphere.pose.position.z for sphere in drawn.spheres] == [12.5, 0.25]
    assert [point.z for point in drawn.lines[-1].points] == [13.0, 13.0, 0.75, 0.75]
    cloud = on("/points/agents", found)[-1]
    assert struct.unpack_from("<f", cloud.data, 8) == (12.5,)
    [view] = read_film(tmp_path / "recording.mcap").snapshots()
    for body, recorded_body in zip((flying, crashed), view.bodies, strict=True):
        assert recorded_body[8:] == pytest.approx(body[8:])


def test_obstacles_are_drawn_with_the_arenas_edge(tmp_path: Path) -> None:
    obstacle = {"corners_m": [[10, 10], [30, 10], [20, 40]]}
    scenario = load(Scenario, {"agents": {"count": 12}, "arena": {"obstacles": [obstacle]}})
    edge, drawn = shapes("/scene/agents", messages(recorded(tmp_path, scenario, 1))).lines
    assert len(edge.points) == 4
    assert [[point.x, point.y] for point in drawn.points] == obstacle["corners_m"]
    assert drawn.type == edge.type


def test_roles_have_colours_of_their_own(tmp_path: Path) -> None:
    """Each role is drawn in its own colour, and none in the events' black."""
    assert set(ROLE_COLOURS) == set(ROLES)
    assert len(set(ROLE_COLOURS.values()) | {"#000000"}) == len(ROLES) + 1
    bodies = [AgentState(i, float(i), 1.0, role, 0, -1) for i, role in enumerate(ROLES)]
    for role, sphere in zip(ROLES, shapes("/scene/agents", shown(tmp_path, truth(*bodies))).spheres, strict=True):
        assert str(sphere.color) == str(colour(ROLE_COLOURS[role], 0.4 if role == "dead" else 1.0))


def test_a_tree_is_drawn_from_child_to_parent(tmp_path: Path) -> None:
    """A line for each agent with a parent; a parent that is not there is hearsay and has none."""
    bodies = [
        AgentState(3, 1.0, 1.0, "root", 0, -1),
        AgentState(7, 2.0, 2.0, "member", 1, 3),
        AgentState(9, 3.0, 3.0, "member", 2, 60_000),
    ]
    (line,) = shapes("/scene/tree", shown(tmp_path, truth(*bodies))).lines
    ends = [(line.points[i].x, line.points[i].y) for i in line.indices]
    assert ends == [(2.0, 2.0), (1.0, 1.0)]


def test_links_are_drawn_from_sender_to_receiver(tmp_path: Path) -> None:
    """One list of lines has all deliveries of the step; without any there is no line."""
    bodies = [AgentState(0, 1.0, 1.0, "free", 0, -1), AgentState(1, 2.0, 2.0, "free", 0, -1)]
    found = shown(tmp_path, truth(*bodies, links=((0, 1), (1, 0))))
    (line,) = shapes("/scene/links", found).lines
    assert (line.type, list(line.indices)) == (line.LINE_LIST, [0, 1, 1, 0])
    assert not shapes("/scene/tree", found).lines


def test_events_shrink_and_go(tmp_path: Path) -> None:
    """A disc shrinks as work is done, is paler once sensed, and is gone when the event is complete."""
    waiting = EventState(1, 10.0, 20.0, 0.0, None, None, None, 0.0)
    worked_on = EventState(2, 30.0, 40.0, 0.0, 0.0, 0.0, None, 150.0)
    complete = EventState(3, 50.0, 60.0, 0.0, 0.0, 0.0, 0.0, 200.0)
    first, second = shapes("/scene/events", shown(tmp_path, truth(events=(waiting, worked_on, complete)))).cylinders
    assert (first.pose.position.x, second.pose.position.x) == (10.0, 30.0)
    assert first.size.x > second.size.x > 0
    assert first.color.a > second.color.a
    assert (first.color.r, first.color.g, first.color.b, first.color.a) == (0, 0, 0, 1)


def test_a_view_replaces_the_one_before(tmp_path: Path) -> None:
    """One entity a topic, always the same id, that lives until it is replaced."""
    found = messages(recorded(tmp_path, SCENARIO, 5))
    for topic in SCENE_TOPICS:
        entities = [entity for message in on(topic, found) for entity in message.entities]
        assert len(entities) == 5
        assert len({entity.id for entity in entities}) == 1
        assert all(entity.HasField("lifetime") and not entity.lifetime.ToNanoseconds() for entity in entities)


def points(topic: str, found: Iterable[tuple[str, int, Any]]) -> list[tuple[float, float, str]]:
    """Place and colour of each point of the newest message on a topic."""
    cloud = on(topic, found)[-1]
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "red", "green", "blue", "alpha"]
    return [(x, y, f"#{rgb.hex()}") for x, y, _, rgb, _ in struct.iter_unpack("<fff3sB", cloud.data)]


def test_agents_and_events_are_points(tmp_path: Path) -> None:
    """Agents in the colours of their roles, known or not; an event is none once it is complete."""
    bodies = [AgentState(0, 1.5, 2.0, "root", 0, -1), AgentState(1, 3.0, 4.0, "strange", 0, -1)]
    waiting = EventState(1, 10.0, 20.0, 0.0, None, None, None, 0.0)
    found = shown(tmp_path, truth(*bodies, events=(waiting, waiting._replace(event=2, completed_s=0.0))))
    assert points("/points/agents", found) == [(1.5, 2.0, ROLE_COLOURS["root"]), (3.0, 4.0, role_colour("strange"))]
    assert [(x, y) for x, y, _ in points("/points/events", found)] == [(10.0, 20.0)]


def test_a_swarm_that_changes_is_drawn_as_it_is_now(tmp_path: Path) -> None:
    """Agents come and go, roles change, events come and go: nothing is left of the step before."""
    bodies = [AgentState(i, float(i), 1.0, "free", 0, -1) for i in range(4)]
    events = tuple(EventState(i, float(i), 2.0, 0.0, None, None, None, 0.0) for i in range(3))
    now = truth(AgentState(2, 7.0, 1.0, "root", 0, -1), AgentState(3, 8.0, 1.0, "member", 1, 2), events=events[2:])
    (tmp_path / "alone").mkdir()
    after = shown(tmp_path, truth(*bodies, events=events, links=((0, 1),)), truth(*bodies), now)
    alone = shown(tmp_path / "alone", now)
    for topic in ("/tf", *SCENE_TOPICS, "/points/agents", "/points/events", "/swarm/agents"):
        assert str(on(topic, after)[-1]) == str(on(topic, alone)[-1]), topic


def test_standings_are_told_when_one_changes(tmp_path: Path) -> None:
    """Role, level, parent and root of all agents, in the order of the frames."""
    first = [AgentState(3, 1.0, 1.0, "root", 0, -1, 3), AgentState(7, 2.0, 2.0, "free", 0, -1)]
    moved = [body._replace(x_m=5.0) for body in first]
    joined = [moved[0], moved[1]._replace(role="member", level=1, parent=3, root=3)]
    told = on("/swarm/agents", shown(tmp_path, truth(*first), truth(*moved), truth(*joined)))
    assert [(list(message.agent), list(message.role), list(message.parent)) for message in told] == [
        ([3, 7], ["root", "free"], [-1, -1]),
        ([3, 7], ["root", "member"], [-1, 3]),
    ]
