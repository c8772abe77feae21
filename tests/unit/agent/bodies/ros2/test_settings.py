"""Settings of a ROS 2 robot: their limits."""

from typing import Any

import pytest

from deltaswarm_ros2.settings import Ros2Settings
from deltaswarm_wire.checked import SettingsError, load
from tests.support.tiers import in_one_test


def test_all_keys_have_defaults_and_texts() -> None:
    assert load(Ros2Settings, {}).namespace_of(7) == "/robot7"
    assert all(spec.metadata["doc"] for spec in Ros2Settings.__dataclass_fields__.values())


@in_one_test(
    ("table", "message"),
    [
        ({"layout": "dds"}, "layout must be one of rmw_zenoh, ros2dds"),
        ({"odometry": "odom/"}, "odometry must be words"),
        ({"command": ""}, "command must be words"),
        ({"detections": "2d"}, "detections must be words"),
        ({"namespace": "robot7"}, "namespace must begin with / and be words"),
        ({"namespace": "/{name}"}, "namespace must begin with /"),
        ({"connect": ["127.0.0.1:7447"]}, "connect must be PROTOCOL/ADDRESS"),
        ({"connect": []}, "mode must be peer"),
        ({"listen": ["tcp/0.0.0.0:7448"]}, "mode must be peer"),
        ({"zenoh": {"id": 3}}, "zenoh.id must be a string"),
        ({"domain": 233}, "domain must be an integer from 0 to 232"),
        ({"command_type": "geometry_msgs/Twist"}, "command_type must be one of geometry_msgs/msg/Twist,"),
        ({"fence_m": [[0, 0], [1, 1]]}, "fence_m must have at least 3 corners"),
    ],
)
def test_mistakes_are_named(table: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message.replace("(", "[(]")):
        load(Ros2Settings, table)


@pytest.mark.parametrize("namespace", ["", "/fleet/robot{id}", "/robot"])
def test_namespaces_may_be_deep_or_missing(namespace: str) -> None:
    load(Ros2Settings, {"namespace": namespace})


def test_detections_and_a_file_of_events_exclude_each_other(tmp_path: Any) -> None:
    """Their numbers could be the same."""
    (tmp_path / "events.csv").write_text("event,x_m,y_m\n1,2,3\n")
    with pytest.raises(SettingsError, match="events must be left out with detections"):
        load(Ros2Settings, {"detections": "found", "events": str(tmp_path / "events.csv")})
