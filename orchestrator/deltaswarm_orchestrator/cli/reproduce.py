"""`deltaswarm reproduce`."""

from deltaswarm_orchestrator.cli.reports import add_reproduce as add

__all__ = ["add"]
