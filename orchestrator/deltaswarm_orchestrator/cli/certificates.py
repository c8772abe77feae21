"""`deltaswarm certificates`."""

import argparse
import sys
from pathlib import Path

from deltaswarm_orchestrator.cli.arguments import whole
from deltaswarm_orchestrator.exits import OK, CommandError
from deltaswarm_wire.arguments import agent_numbers


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm certificates`."""
    command.description = (
        "Make an authority and certificates signed by it, for the world, the operator, the recorder and each agent. "
        "In an existing folder, only missing certificates are made."
    )
    command.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="for NAME.pem and NAME.key")
    command.add_argument("--agents", type=agent_numbers, required=True, metavar="N-M,...", help="such as 20-24 or 3,7")
    command.add_argument(
        "--host", action="append", default=[], metavar="HOST", help="name or address of the world's machine; repeatable"
    )
    command.add_argument(
        "--days", type=whole(1, 36_500), default=365, metavar="N", help="how long they are valid (default: 365)"
    )
    command.set_defaults(func=certificates)


def certificates(arguments: argparse.Namespace) -> int:
    """Make what is missing."""
    from deltaswarm_orchestrator.boards.certificates import make

    try:
        files = make(arguments.out, arguments.agents, arguments.host, arguments.days)
    except (ValueError, OSError) as error:
        raise CommandError(str(error)) from None
    print("\n".join(map(str, files)) if files else f"{arguments.out}: all certificates exist")
    print(
        f"{arguments.out / 'ca.key'} signs every certificate; keep it on this machine. "
        "A board gets ca.pem, its own .pem and its own .key",
        file=sys.stderr,
    )
    return OK
