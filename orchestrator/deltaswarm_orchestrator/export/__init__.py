"""Export a recording to other formats: tables, ROS 2, Rerun, video. Each format has its own module."""
