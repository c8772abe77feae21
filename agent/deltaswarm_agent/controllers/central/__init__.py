"""Central control with perfect communication: an upper reference for what decentralised and tree control achieve.

`planner.py` decides where each agent goes or waits, `maps.py` says where events are expected, and `controller.py`
carries the plan to the agents by radio.
"""
