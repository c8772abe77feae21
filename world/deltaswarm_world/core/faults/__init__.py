"""Faults of a run: `timeline.py` has times and targets, the other files the kinds."""
