"""`deltaswarm report`."""

from deltaswarm_orchestrator.cli.reports import add_report as add

__all__ = ["add"]
