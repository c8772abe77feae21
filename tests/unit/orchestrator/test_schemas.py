"""The messages of a recording: complete, and under the names by which viewers know them."""

from deltaswarm_orchestrator.recording.schemas import AGENT_FIELDS, NET_FIELDS, OURS, STATE_FIELDS, TOPICS
from deltaswarm_scenario.truth import BODY_FIELDS, COLUMNS, AgentState, EventState
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Report, Workload


def names(message: str) -> set[str]:
    return set(OURS[message].DESCRIPTOR.fields_by_name)


def test_two_topics_hold_every_field_of_a_tally() -> None:
    """A field that is added to the record is recorded without a word here."""
    assert sorted([*NET_FIELDS, *STATE_FIELDS, "step", "time_s"]) == sorted(COLUMNS)
    assert {"step", "time_s", *NET_FIELDS, "other_drops"} == names("NetStats")
    assert {"step", "time_s", *STATE_FIELDS, "wall_s"} == names("SwarmState")


def test_a_message_holds_every_field_of_its_row() -> None:
    """Of events, reports, workload; and of bodies, whose places are in the frames."""
    for message, row in (("Event", EventState), ("Sighting", Event), ("Report", Report), ("Workload", Workload)):
        assert names(message) == set(row._fields)
    assert {*AGENT_FIELDS, *BODY_FIELDS, "x_m", "y_m"} == set(AgentState._fields)


def test_schemas_have_official_names_or_ours() -> None:
    """A viewer draws a topic by the name of its schema."""
    official = {
        "/tf": "FrameTransforms",
        "/log": "Log",
        **dict.fromkeys(("/scene/agents", "/scene/tree", "/scene/links", "/scene/events"), "SceneUpdate"),
        **dict.fromkeys(("/points/agents", "/points/events"), "PointCloud"),
    }
    for topic, kind in TOPICS.items():
        name = kind.DESCRIPTOR.full_name
        assert name == f"foxglove.{official[topic]}" if topic in official else name.startswith("deltaswarm.")
