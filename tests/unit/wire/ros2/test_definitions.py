"""The definitions of topics have the type hashes that ROS publishes."""

from rosbags.typesys import Stores, get_typestore

from deltaswarm_ros2.definitions import HASHES
from tests.support.tiers import in_one_test


@in_one_test("store", [Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL])
def test_hashes_are_those_of_every_ros_that_has_them(store: Stores) -> None:
    """As the package rosbags computes them; `test_cdr.py` compares the definitions with rosbags'."""
    types = get_typestore(store)
    assert {name: types.hash_rihs01(name) for name in HASHES} == HASHES
