"""The command-line arguments that every part shares: which run, which router, which credentials."""

import argparse
import os
import stat
import sys
from collections.abc import Iterable
from pathlib import Path

from deltaswarm_wire.access import TLS, user_name
from deltaswarm_wire.codec import MAX_AGENT_ID
from deltaswarm_wire.endpoints import endpoint_problem, protocol_of
from deltaswarm_wire.keys import Keys
from deltaswarm_wire.session import PASSWORD_VARIABLE, RouterLink, Tls

LOG_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


def program(part: str) -> str:
    """What a part was called as: by a script of its own, or as `deltaswarm PART`."""
    script = f"deltaswarm-{part}"
    return script if Path(sys.argv[0]).name == script else f"deltaswarm {part}"


def add_link_arguments(parser: argparse.ArgumentParser) -> None:
    """How a part reaches its world."""
    parser.add_argument("--run", required=True, type=run_name, help="name of the run, as the world was given it")
    parser.add_argument(
        "--connect",
        required=True,
        type=connects_to,
        metavar="ENDPOINT",
        help="the world, e.g. tcp/192.168.1.10:7447",
    )
    parser.add_argument(
        "--password-file", type=Path, metavar="FILE", help=f"its password; else the environment's {PASSWORD_VARIABLE}"
    )
    add_tls_arguments(parser)
    add_zenoh_argument(parser)


def add_tls_arguments(parser: argparse.ArgumentParser) -> None:
    """Certificates, for endpoints that begin with `tls/`."""
    parser.add_argument("--ca", metavar="FILE", help="for tls/ endpoints: the certificate of who signs certificates")
    parser.add_argument("--certificate", metavar="FILE", help="for tls/ endpoints: its own certificate")
    parser.add_argument("--key", metavar="FILE", help="for tls/ endpoints: its private key, of mode 0600")


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


def connects_to(text: str) -> str:
    """An endpoint to connect to, checked."""
    return _endpoint(text, connects=True)


def listens_on(text: str) -> str:
    """An endpoint to listen on, checked; port 0 is any free one."""
    return _endpoint(text, connects=False)


def _endpoint(text: str, connects: bool) -> str:
    if problem := endpoint_problem(text, connects=connects):
        raise argparse.ArgumentTypeError(f"{text!r}: {problem}")
    return text


def agent_numbers(text: str) -> list[int]:
    """Agents' numbers, ascending, of numbers and ranges with commas between them."""
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


def add_boards_argument(parser: argparse.ArgumentParser) -> None:
    """`--boards`, for the parts that must know who is on a machine of its own."""
    parser.add_argument(
        "--boards",
        type=agent_numbers,
        default=[],
        metavar="N-M,...",
        help="agents that may leave and come back, such as 20-24",
    )


def override(text: str) -> tuple[str, str]:
    """KEY=VALUE as a pair."""
    key, sign, value = text.partition("=")
    if not key or not sign:
        raise argparse.ArgumentTypeError(f"{text!r}: KEY=VALUE is expected")
    return key, value


def link_of(arguments: argparse.Namespace, role: str, number: int = 0, low_latency: bool = False) -> RouterLink:
    """The link that the arguments and the environment describe.

    Raises:
        OSError: the password file cannot be read.
        ValueError: others than its owner may read it; or as `tls_of`.
    """
    file: Path | None = arguments.password_file
    if file and (problem := secret_problem(file)):
        raise ValueError(f"--password-file {file} {problem}")
    password = file.read_text().strip() if file else os.environ.get(PASSWORD_VARIABLE, "")
    user = user_name(role, number) if password else ""
    tls = tls_of([arguments.connect], arguments.ca, arguments.certificate, arguments.key)
    return RouterLink(arguments.connect, user, password, low_latency, tuple(arguments.zenoh), tls)


def secret_problem(file: Path) -> str:
    """What is wrong with a secret that others than its owner may read or write, and what to do; nothing if none may.

    Raises:
        OSError: the file is not there.
    """
    mode = stat.S_IMODE(file.stat().st_mode)
    return f"has mode {mode:04o}; 0600 is needed: chmod 600 {file}" if mode & 0o077 else ""


def password_in(file: Path, user: str) -> str:
    """A user's password from `user:password` lines, as the world's credentials file has them.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no such user, or others than its owner may read it.
    """
    if problem := secret_problem(file):
        raise ValueError(problem)
    for line in file.read_text().splitlines():
        name, sign, password = line.strip().partition(":")
        if sign and name == user:
            return password
    raise ValueError(f"has no line {user}:PASSWORD")


def tls_of(endpoints: Iterable[str], ca: str | None, certificate: str | None, key: str | None) -> Tls | None:
    """The certificates that the endpoints need, or None where none begins with `tls/`.

    Raises:
        ValueError: one is missing, not to be read, or not asked for; or others than the owner may read the key.
    """
    files = {"ca": ca, "certificate": certificate, "key": key}
    over_tls = [endpoint for endpoint in endpoints if protocol_of(endpoint) == TLS]
    if not over_tls:
        if given := [name for name, file in files.items() if file]:
            raise ValueError(f"{', '.join(given)}: only for an endpoint that begins with {TLS}/")
        return None
    if missing := [name for name, file in files.items() if not file]:
        raise ValueError(f"{over_tls[0]} needs ca, certificate and key; missing: {', '.join(missing)}")
    for name, file in files.items():
        try:
            with open(file or ""):
                problem = secret_problem(Path(file or "")) if name == "key" else ""
        except OSError as error:
            raise ValueError(f"{name}: {error}") from None
        if problem:
            raise ValueError(f"key: {file} {problem}")
    return Tls(ca or "", certificate or "", key or "")
