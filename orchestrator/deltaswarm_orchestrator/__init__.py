"""The orchestrator: launches runs, records them, and shows their results."""
