"""The uplink of reports to the operator: `uplink.py` composes it, `relay.py` relays reports through a tree."""
