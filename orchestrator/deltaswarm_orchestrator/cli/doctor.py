"""`deltaswarm doctor`."""

import argparse

from deltaswarm_orchestrator.exits import FAILED, OK


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm doctor`."""
    command.add_argument("--json", action="store_true", help="print the findings as JSON")
    command.set_defaults(func=doctor)


def doctor(arguments: argparse.Namespace) -> int:
    """Examine this machine; fails if anything that runs need is missing."""
    from deltaswarm_orchestrator.bench import doctor

    findings = doctor.examine()
    print(doctor.to_json(findings) if arguments.json else doctor.text(findings))
    return OK if all(finding.is_well for finding in findings) else FAILED
