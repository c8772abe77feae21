"""The command `deltaswarm bundle`."""

import argparse
from pathlib import Path

from deltaswarm_orchestrator.base.exits import OK
from deltaswarm_orchestrator.cli.arguments import add_json, show
from deltaswarm_wire import __version__


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm bundle`."""
    from deltaswarm_orchestrator.boards.bundle import PLATFORMS, PYTHONS

    command.description = "Make a folder from which an agent is installed on a board without internet."
    command.add_argument("--platform", required=True, choices=PLATFORMS, help="platform of the board")
    command.add_argument(
        "--python",
        action="append",
        choices=PYTHONS,
        help="Python version of the board; may be repeated (default: all of these)",
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: deltaswarm-agent-VERSION-PLATFORM")
    command.add_argument(
        "--operator-key",
        type=_public_key,
        metavar="HEX",
        help="public key of the operator: into the example of a board's file; adds cryptography",
    )
    add_json(command)
    command.set_defaults(func=bundle)


def _public_key(text: str) -> str:
    from deltaswarm_wire.signing import PUBLIC_KEY_RULE, is_public_key

    if not is_public_key(text):
        raise argparse.ArgumentTypeError(f"{PUBLIC_KEY_RULE} (got {text!r:.80})")
    return text


def bundle(arguments: argparse.Namespace) -> int:
    """Make the folder, and print its files and its name."""
    from deltaswarm_orchestrator.boards import bundle as bundles

    out = arguments.out or Path(f"deltaswarm-agent-{__version__}-{arguments.platform}")
    pythons = sorted(set(arguments.python or bundles.PYTHONS), key=bundles.PYTHONS.index)
    names = bundles.bundle(out, arguments.platform, pythons, arguments.operator_key or "")
    found = {"folder": str(out), "wheels": names}
    show(arguments, found, "\n".join([*(f"  {name}" for name in names), str(out)]))
    return OK
