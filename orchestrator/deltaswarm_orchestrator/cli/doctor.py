"""The command `deltaswarm doctor`."""

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from deltaswarm_orchestrator.base.exits import FAILED, OK
from deltaswarm_orchestrator.base.text import aligned
from deltaswarm_orchestrator.cli.arguments import add_json, show

if TYPE_CHECKING:
    from deltaswarm_orchestrator.bench.doctor import Finding


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm doctor`."""
    add_json(command, "the findings")
    command.set_defaults(func=doctor)


def doctor(arguments: argparse.Namespace) -> int:
    """Examine this machine; fail if anything that runs need is missing."""
    from deltaswarm_orchestrator.bench import doctor

    findings = doctor.examine()
    show(arguments, [asdict(finding) for finding in findings], aligned(_row(finding) for finding in findings))
    return OK if all(finding.is_well for finding in findings) else FAILED


def _row(finding: "Finding") -> tuple[str, str, str]:
    """Return a finding's row, with advice if something is missing."""
    found = finding.found if finding.is_well else f"{finding.found}  ->  {finding.advice}"
    return "ok" if finding.is_well else "MISSING", finding.name, found
