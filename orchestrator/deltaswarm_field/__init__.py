"""Boards and ROS 2 from the experimenter's machine: bundles, certificates, and a live view for ROS tools."""
