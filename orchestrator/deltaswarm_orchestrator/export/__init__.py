"""A recording in other formats: tables, ROS 2, Rerun, video. One file for each format."""
