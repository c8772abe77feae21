"""The command `deltaswarm certificates`."""

import argparse
import sys
from pathlib import Path

from deltaswarm_orchestrator.base.exits import OK, CommandError
from deltaswarm_orchestrator.cli.arguments import whole
from deltaswarm_wire.arguments import agent_numbers


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm certificates`."""
    command.description = (
        "Make an authority and certificates signed by it, for the world, the operator, the recorder and each agent. "
        "In an existing folder, only missing certificates are made. With --operator-key, make the key that signs the "
        "operator's commands in open air, and print its public part."
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="for NAME.pem and NAME.key")
    command.add_argument("--agents", type=agent_numbers, metavar="N-M,...", help="such as 20-24 or 3,7")
    command.add_argument(
        "--operator-key",
        type=Path,
        metavar="FILE",
        help="private key that signs commands, made if missing; prints its public part, air.operator_key of boards",
    )
    command.add_argument(
        "--host", action="append", default=[], metavar="HOST", help="name or address of the world's machine; repeatable"
    )
    command.add_argument(
        "--days", type=whole(1, 36_500), default=365, metavar="N", help="how long they are valid (default: 365)"
    )
    command.set_defaults(func=certificates)


def certificates(arguments: argparse.Namespace) -> int:
    """Make the certificates and the key that are missing."""
    from deltaswarm_orchestrator.boards.certificates import make

    has_certificates = arguments.out is not None and arguments.agents is not None
    if not has_certificates and (arguments.out or arguments.agents or not arguments.operator_key):
        raise CommandError("certificates need --out and --agents; a key for commands needs --operator-key")
    if arguments.operator_key:
        _operator_key(arguments.operator_key)
    if not has_certificates:
        return OK
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


def _operator_key(file: Path) -> None:
    """Make the key if it is missing, and print its public part."""
    from deltaswarm_wire.signing import make_key, public_key

    try:
        if file.exists():
            public = public_key(file)
        else:
            file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            public = make_key(file)
    except (ValueError, OSError) as error:
        raise CommandError(str(error)) from None
    print(f'operator_key = "{public}"')
    print(f"{file} signs the operator's commands; keep it on the operator's machine", file=sys.stderr)
