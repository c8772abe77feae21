"""Learning: a swarm as an environment of PettingZoo, and controllers that decide by trained policies.

Only `environment.py` needs the extra `learn`; what a trained policy runs on does not.
"""
