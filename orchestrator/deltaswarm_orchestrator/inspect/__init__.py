"""Inspect a run that has ended or was interrupted."""
