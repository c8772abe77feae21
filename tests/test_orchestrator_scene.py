"""The views: what a viewer shows of agents, trees, links and events."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.recording.foxglove import VIEW_TOPICS
from deltaswarm_orchestrator.recording.scene import ROLE_COLOURS, colour
from deltaswarm_wire.checked import load
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.truth import Body, EventState
from tests.truths import ROLES, messages, on, recorded, shown, truth

SCENARIO = load(Scenario, {"agents": {"count": 12}})


def shapes(topic: str, found: Iterable[tuple[str, int, Any]]) -> Any:
    """The one entity of the newest message on a topic."""
    (entity,) = on(topic, found)[-1]["entities"]
    return entity


def test_frames_of_every_step(tmp_path: Path) -> None:
    """One message a step has the arena's place in the world and every agent's place in the arena."""
    for message in on("/tf", messages(recorded(tmp_path, SCENARIO, 10))):
        arena, *agents = message["transforms"]
        assert (arena["parent_frame_id"], arena["child_frame_id"]) == ("world", "arena")
        assert arena["translation"] == {"x": -50.0, "y": -50.0, "z": 0.0}
        assert [agent["child_frame_id"] for agent in agents] == [f"agent/{i}" for i in range(12)]
        assert {agent["parent_frame_id"] for agent in agents} == {"arena"}


def test_the_arenas_centre_is_the_origin(tmp_path: Path) -> None:
    """Where a viewer's camera looks first."""
    arena, agent = on("/tf", shown(tmp_path, truth(Body(0, 50.0, 50.0, "free", 0, -1))))[0]["transforms"]
    assert arena["translation"]["x"] + agent["translation"]["x"] == 0
    assert arena["translation"]["y"] + agent["translation"]["y"] == 0


def test_obstacles_are_drawn_with_the_arenas_edge(tmp_path: Path) -> None:
    """A closed line around each."""
    obstacle = {"corners_m": [[10, 10], [30, 10], [20, 40]]}
    scenario = load(Scenario, {"agents": {"count": 12}, "arena": {"obstacles": [obstacle]}})
    edge, drawn = shapes("/scene/agents", messages(recorded(tmp_path, scenario, 1)))["lines"]
    assert len(edge["points"]) == 4
    assert [[point["x"], point["y"]] for point in drawn["points"]] == obstacle["corners_m"]
    assert drawn["type"] == edge["type"]


def test_roles_have_colours_of_their_own(tmp_path: Path) -> None:
    """Each role is drawn in its own colour, and none in the events' black."""
    assert set(ROLE_COLOURS) == set(ROLES)
    assert len(set(ROLE_COLOURS.values()) | {"#000000"}) == len(ROLES) + 1
    bodies = [Body(i, float(i), 1.0, role, 0, -1) for i, role in enumerate(ROLES)]
    for role, sphere in zip(ROLES, shapes("/scene/agents", shown(tmp_path, truth(*bodies)))["spheres"], strict=True):
        assert sphere["color"] == colour(ROLE_COLOURS[role], 0.4 if role == "dead" else 1.0)


def test_a_tree_is_drawn_from_child_to_parent(tmp_path: Path) -> None:
    """A line for each agent with a parent; a parent that is not there is hearsay and has none."""
    bodies = [
        Body(3, 1.0, 1.0, "root", 0, -1),
        Body(7, 2.0, 2.0, "member", 1, 3),
        Body(9, 3.0, 3.0, "member", 2, 60_000),
    ]
    (line,) = shapes("/scene/tree", shown(tmp_path, truth(*bodies)))["lines"]
    ends = [(line["points"][i]["x"], line["points"][i]["y"]) for i in line["indices"]]
    assert ends == [(2.0, 2.0), (1.0, 1.0)]


def test_links_are_drawn_from_sender_to_receiver(tmp_path: Path) -> None:
    """One list of lines has all deliveries of the step; without any there is no line."""
    bodies = [Body(0, 1.0, 1.0, "free", 0, -1), Body(1, 2.0, 2.0, "free", 0, -1)]
    found = shown(tmp_path, truth(*bodies, links=((0, 1), (1, 0))))
    (line,) = shapes("/scene/links", found)["lines"]
    assert (line["type"], line["indices"]) == (2, [0, 1, 1, 0])
    assert shapes("/scene/tree", found)["lines"] == []


def test_events_shrink_and_go(tmp_path: Path) -> None:
    """A disc shrinks as work is done, is paler once sensed, and is gone when the event is complete."""
    waiting = EventState(1, 10.0, 20.0, 0.0, None, None, 0.0)
    worked_on = EventState(2, 30.0, 40.0, 0.0, 0.0, None, 150.0)
    complete = EventState(3, 50.0, 60.0, 0.0, 0.0, 0.0, 200.0)
    first, second = shapes("/scene/events", shown(tmp_path, truth(events=(waiting, worked_on, complete))))["cylinders"]
    assert (first["pose"]["position"]["x"], second["pose"]["position"]["x"]) == (10.0, 30.0)
    assert first["size"]["x"] > second["size"]["x"] > 0
    assert first["color"]["a"] > second["color"]["a"]
    assert {*first["color"].values()} == {0.0, 1.0}


def test_a_view_replaces_the_one_before(tmp_path: Path) -> None:
    """One entity a topic, always the same id, that lives until it is replaced."""
    found = messages(recorded(tmp_path, SCENARIO, 5))
    for topic in VIEW_TOPICS.keys() - {"/tf"}:
        entities = [entity for message in on(topic, found) for entity in message["entities"]]
        assert len(entities) == 5
        assert len({entity["id"] for entity in entities}) == 1
        assert all(entity["lifetime"] == {"sec": 0, "nsec": 0} for entity in entities)
