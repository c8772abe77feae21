"""The command `deltaswarm verify`: its options. What it does is imported when it is done."""

import argparse
from pathlib import Path

from deltaswarm_cli.arguments import add_json


def add_verify(command: argparse.ArgumentParser) -> None:
    """Check sessions against the published hash of their plan, and repeat their runs."""
    command.description = (
        "Check that plan and code of all sessions in a folder are those of a hash that was published before the study "
        "(deltaswarm session FILE --freeze), that no planned run is missing, and that each complete run repeats to its "
        "digest."
    )
    command.add_argument("data", type=Path, metavar="DATA", help="folder of all sessions, with the commitment")
    command.add_argument("--against", required=True, metavar="HASH", help="the hash that was published")
    add_json(command)
    command.set_defaults(func=verify)


def verify(arguments: argparse.Namespace) -> int:
    """Do what the options say."""
    from deltaswarm_sessions import verifying

    return verifying.verify(arguments)
