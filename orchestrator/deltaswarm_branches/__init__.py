"""Branches of runs: what would have come of a run without an order, with another, or with other settings."""
