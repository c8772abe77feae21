"""Central control with perfect communication: an upper reference for what decentralised and tree control achieve.

`planner.py` decides where each agent goes, `maps.py` says where events are expected, `posts.py` where to wait for them,
and `controller.py` carries the plan to the agents by radio.
"""
