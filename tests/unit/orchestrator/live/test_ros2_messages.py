"""What ROS tools show of a run: markers and diagnostics."""

from deltaswarm_field.ros2_messages import LINE_LIST, OK, SPHERE_LIST, WARN, diagnostics, markers
from deltaswarm_ros2.cdr import decode, encode
from deltaswarm_ros2.definitions import DIAGNOSTIC_ARRAY, MARKER_ARRAY
from tests.support.looking import BODIES, WORKLOAD, a_truth
from tests.support.ros2_types import bag_encoded

STAMP = {"sec": 3, "nanosec": 4}


def test_agents_trees_and_events_are_three_markers() -> None:
    """Points in the arena's frame with a colour each; a completed event is not shown."""
    message = decode(MARKER_ARRAY, encode(MARKER_ARRAY, markers(a_truth(), 100.0, STAMP)))
    agents, tree, events = message["markers"]
    assert [marker["ns"] for marker in message["markers"]] == ["agents", "tree", "events"]
    assert [marker["type"] for marker in message["markers"]] == [SPHERE_LIST, LINE_LIST, SPHERE_LIST]
    assert all(marker["header"] == {"stamp": STAMP, "frame_id": "arena"} for marker in message["markers"])
    assert [(point["x"], point["y"]) for point in agents["points"]] == [body[1:3] for body in BODIES]
    assert [(point["x"], point["y"]) for point in tree["points"]] == [BODIES[1][1:3], BODIES[0][1:3]]
    assert [(point["x"], point["y"]) for point in events["points"]] == [(92.0, 70.0)]
    assert all(len(marker["colors"]) == len(marker["points"]) for marker in message["markers"])
    assert len({tuple(colour.values()) for colour in agents["colors"]}) == len({body.role for body in BODIES})


def test_rosbags_agrees_on_the_bytes() -> None:
    """Of both messages."""
    for kind, message in (
        (MARKER_ARRAY, markers(a_truth(), 100.0, STAMP)),
        (DIAGNOSTIC_ARRAY, diagnostics(a_truth(), WORKLOAD, 5.0, STAMP)),
    ):
        data = encode(kind, message)
        assert data == bag_encoded(kind, decode(kind, data))


def test_a_workload_above_its_threshold_is_a_warning() -> None:
    """Below it, and before the operator has counted, nothing is."""
    for threshold_hz, level in ((0.4, WARN), (0.5, OK)):
        swarm, workload = diagnostics(a_truth(), WORKLOAD, threshold_hz, STAMP)["status"]
        assert (swarm["level"], workload["level"]) == (OK, level)
        assert {"key": "rate_60s_hz", "value": "0.5"} in workload["values"]
        assert {"key": "step", "value": "7"} in swarm["values"]
    [swarm] = diagnostics(a_truth(), None, 5.0, STAMP)["status"]
    assert swarm["name"] == "deltaswarm: swarm"
