"""The command-line arguments that every part shares: which run, which router, which credentials."""

import argparse
import os
from pathlib import Path

from deltaswarm_wire.keys import Keys
from deltaswarm_wire.session import PASSWORD_VARIABLE, Link, user_name

LOG_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


def add_link_arguments(parser: argparse.ArgumentParser) -> None:
    """How a part reaches its world."""
    parser.add_argument("--run", required=True, type=run_name, help="name of the run, as the world was given it")
    parser.add_argument("--connect", required=True, metavar="ENDPOINT", help="the world, e.g. tcp/192.168.1.10:7447")
    parser.add_argument(
        "--password-file", type=Path, metavar="FILE", help=f"its password; else the environment's {PASSWORD_VARIABLE}"
    )
    add_zenoh_argument(parser)


def add_zenoh_argument(parser: argparse.ArgumentParser) -> None:
    """The user's own Zenoh settings."""
    parser.add_argument(
        "--zenoh", action="append", default=[], type=override, metavar="KEY=VALUE", help="any Zenoh setting (JSON5)"
    )


def run_name(text: str) -> str:
    """A run's name, checked."""
    try:
        return Keys(text).run
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def override(text: str) -> tuple[str, str]:
    """KEY=VALUE as a pair."""
    key, sign, value = text.partition("=")
    if not key or not sign:
        raise argparse.ArgumentTypeError(f"{text!r}: KEY=VALUE is expected")
    return key, value


def link_of(arguments: argparse.Namespace, role: str, number: int = 0, low_latency: bool = False) -> Link:
    """The link that the arguments and the environment describe.

    Raises:
        OSError: the password file cannot be read.
    """
    file: Path | None = arguments.password_file
    password = file.read_text().strip() if file else os.environ.get(PASSWORD_VARIABLE, "")
    user = user_name(role, number) if password else ""
    return Link(arguments.connect, user, password, low_latency, tuple(arguments.zenoh))
