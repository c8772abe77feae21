"""What the ROS graph says of a robot's topics."""

from deltaswarm_ros2.definitions import TWIST, TWIST_STAMPED
from deltaswarm_ros2.keys import PUBLISHER, SUBSCRIPTION, Graph, Node, endpoint_token, node_token

ROBOT, AGENT = Node(0, "1", "/robot7", "driver"), Node(0, "2", "/robot7", "agent")
TOPIC = "/robot7/cmd_vel"


def test_a_topic_nobody_is_at_is_told() -> None:
    """Nodes, publishers, one's own endpoints and other topics are no subscription."""
    graph = Graph(TOPIC)
    graph.add(node_token(ROBOT))
    graph.add(endpoint_token(ROBOT, 1, PUBLISHER, TOPIC, TWIST))
    graph.add(endpoint_token(AGENT, 1, SUBSCRIPTION, TOPIC, TWIST))
    graph.add(endpoint_token(ROBOT, 2, SUBSCRIPTION, "/robot8/cmd_vel", TWIST))
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == "/robot7/cmd_vel is not subscribed to"


def test_another_type_is_told_until_one_with_this_type_is_there() -> None:
    """Keys contain types, so that the two never meet."""
    graph = Graph(TOPIC)
    other, same = (endpoint_token(ROBOT, 2, SUBSCRIPTION, TOPIC, name) for name in (TWIST_STAMPED, TWIST))
    graph.add(other)
    expected = (
        "/robot7/cmd_vel is subscribed to as geometry_msgs::msg::dds_::TwistStamped_ and not as geometry_msgs/msg/Twist"
    )
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == expected
    graph.add(same)
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == ""
    graph.remove(same)
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == expected


def test_other_publishers_are_named() -> None:
    """With their namespaces, each once; oneself is not among them."""
    graph = Graph(TOPIC)
    pilot = Node(0, "3", "", "teleop")
    for node in (AGENT, ROBOT, pilot):
        for number in (1, 2):
            graph.add(endpoint_token(node, number, PUBLISHER, TOPIC, TWIST))
    assert graph.nodes("2", PUBLISHER, TOPIC) == ["/robot7/driver", "/teleop"]
    assert graph.nodes("2", SUBSCRIPTION, TOPIC) == []
