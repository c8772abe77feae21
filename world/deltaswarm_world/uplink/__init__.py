"""The way of reports to the operator: `uplink.py` is the whole, `relay.py` carries reports through a tree."""
