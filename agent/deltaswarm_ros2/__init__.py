"""A body that is a ROS 2 robot, over Zenoh and without ROS."""
