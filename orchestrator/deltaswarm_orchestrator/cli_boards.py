"""The commands that get agents onto boards: `deltaswarm bundle` and `deltaswarm certificates`."""

import argparse
from pathlib import Path

from deltaswarm_orchestrator.exits import FAILED, OK, USAGE, complain
from deltaswarm_wire import __version__
from deltaswarm_wire.codec import MAX_AGENT_ID

MAX_DAYS = 36_500


def add_bundle(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm bundle`."""
    from deltaswarm_orchestrator.bundle import PLATFORMS, PYTHONS

    command.description = "Make a folder from which an agent is installed on a board without internet."
    command.add_argument("--platform", required=True, choices=PLATFORMS, help="the board's")
    command.add_argument(
        "--python", action="append", choices=PYTHONS, help="the board's; may be repeated (default: all of these)"
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: deltaswarm-agent-VERSION-PLATFORM")


def add_certificates(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm certificates`."""
    command.description = (
        "Make an authority and certificates signed by it, for the world, the operator, the recorder and each agent. "
        "A folder that holds some already is added to."
    )
    command.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="for NAME.pem and NAME.key")
    command.add_argument("--agents", type=_agents, required=True, metavar="N-M,...", help="such as 20-24 or 3,7")
    command.add_argument(
        "--host", action="append", default=[], metavar="HOST", help="name or address of the world's machine; repeatable"
    )
    command.add_argument("--days", type=_days, default=365, metavar="N", help="how long they are valid (default: 365)")


def bundle(arguments: argparse.Namespace) -> int:
    """`deltaswarm bundle`."""
    from deltaswarm_orchestrator import bundle as bundles

    out = arguments.out or Path(f"deltaswarm-agent-{__version__}-{arguments.platform}")
    pythons = sorted(set(arguments.python or bundles.PYTHONS), key=bundles.PYTHONS.index)
    try:
        names = bundles.bundle(out, arguments.platform, pythons)
    except bundles.BundleError as error:
        complain(str(error))
        return FAILED
    print("\n".join([*(f"  {name}" for name in names), str(out)]))
    return OK


def certificates(arguments: argparse.Namespace) -> int:
    """`deltaswarm certificates`."""
    from deltaswarm_orchestrator.certificates import make

    try:
        files = make(arguments.out, arguments.agents, arguments.host, arguments.days)
    except (ValueError, OSError) as error:
        complain(str(error))
        return USAGE
    print("\n".join(map(str, files)) if files else f"{arguments.out}: all of them are there")
    return OK


def _agents(text: str) -> list[int]:
    """Numbers and ranges with commas between them."""
    found: set[int] = set()
    for part in text.split(","):
        first, sign, last = part.partition("-")
        try:
            low, high = int(first), int(last if sign else first)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r}: numbers such as 3,7 or 20-24 are expected") from None
        if not 0 <= low <= high <= MAX_AGENT_ID:
            raise argparse.ArgumentTypeError(f"{part!r}: 0 to {MAX_AGENT_ID}, the lower first, is allowed")
        found.update(range(low, high + 1))
    return sorted(found)


def _days(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= MAX_DAYS:
        raise argparse.ArgumentTypeError(f"{text!r}: 1 to {MAX_DAYS} days are allowed")
    return int(text)
