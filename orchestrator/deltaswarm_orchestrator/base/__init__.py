"""Shared by all of the orchestrator: exit codes, messages, provenance, and access to the operating system."""
