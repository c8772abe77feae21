"""The argument parser of every command, and the arguments shared by all parts: run, router, credentials."""

import argparse
import os
import stat
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeVar

from deltaswarm_wire.access import TLS, revoked_beside, user_name
from deltaswarm_wire.checked import MAX_NUMBER, did_you_mean, shown_limit
from deltaswarm_wire.commands import BASE_ID
from deltaswarm_wire.keys import Keys
from deltaswarm_wire.reading import paths_that_are_not_utf8, read_text, working_folder_problem
from deltaswarm_wire.session import PASSWORD_VARIABLE, RouterLink, Tls, endpoint_problem, protocol_of

N = TypeVar("N", int, float)

MAX_WHOLE = 10**9
"""The most that an option takes as a whole number, unless it has a limit of its own."""


class Parser(argparse.ArgumentParser):
    """Takes options by their full names only; unknown names are refused before anything else is checked."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.allow_abbrev = False

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Parse arguments; end with a usage error at the first unknown option or command."""
        args = sys.argv[1:] if args is None else args
        self._refuse_unknown(args)
        found = super().parse_known_args(args, namespace)
        if problem := working_folder_problem():
            self.error(problem)
        for what, path in paths_that_are_not_utf8(args):
            self.error(f"{what} must be UTF-8, also where it leads (got {path.encode(errors='surrogateescape')!r})")
        return found

    def _refuse_unknown(self, args: Sequence[str]) -> None:
        commands = next((a.choices for a in self._actions if isinstance(a, argparse._SubParsersAction)), None)
        before_command = args if commands is None else takewhile(lambda word: word.startswith("-"), args)
        for name in _long_options(before_command):
            if name not in self._option_string_actions:
                self._refuse("option", name, self._option_string_actions)
        command = next((word for word in args if not word.startswith("-")), None)
        if commands is not None and command is not None and command not in commands:
            self._refuse("command", command, commands)

    def _refuse(self, kind: str, name: str, known: Iterable[str]) -> None:
        hint = did_you_mean(name, [other for other in known if kind == "command" or other.startswith("--")])
        self.error(f"there is no {kind} {name!r}; {hint}see {self.prog} --help")


def _long_options(words: Iterable[str]) -> Iterator[str]:
    """Yield the names of the long options among the words of a command line."""
    for word in takewhile(lambda word: word not in ("--", "-h", "--help"), words):
        name = word.partition("=")[0]
        if word.startswith("--") and " " not in name:
            yield name


def whole(least: int, most: int = MAX_WHOLE) -> Callable[[str], int]:
    """Return a parser of a whole number within limits, for `type=`."""
    return _within(int, "an integer", least, most)


def number(least: float, most: float = MAX_NUMBER) -> Callable[[str], float]:
    """Return a parser of a number within limits, which is neither infinite nor NaN, for `type=`."""
    return _within(float, "a number", least, most)


def _within(kind: Callable[[str], N], noun: str, least: N, most: N) -> Callable[[str], N]:
    def parsed(text: str) -> N:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not least <= value <= most:
            limits = f"from {shown_limit(least)} to {shown_limit(most)}"
            raise argparse.ArgumentTypeError(f"must be {noun} {limits} (got {text!r:.80})")
        return value

    return parsed


def program(part: str) -> str:
    """The name under which a part was started: its own script or `deltaswarm PART`."""
    script = f"deltaswarm-{part}"
    return script if Path(sys.argv[0]).name == script else f"deltaswarm {part}"


def add_link_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--run", required=True, type=run_name, help="name of the run, as given to the world")
    parser.add_argument(
        "--connect",
        required=True,
        type=connects_to,
        metavar="ENDPOINT",
        help="the world, e.g. tcp/192.168.1.10:7447",
    )
    parser.add_argument(
        "--password-file", type=Path, metavar="FILE", help=f"password; default: from {PASSWORD_VARIABLE}"
    )
    add_tls_arguments(parser)
    add_zenoh_argument(parser)


def add_tls_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ca", metavar="FILE", help="for tls/ endpoints: certificate of the authority")
    parser.add_argument("--certificate", metavar="FILE", help="for tls/ endpoints: own certificate")
    parser.add_argument("--key", metavar="FILE", help="for tls/ endpoints: own private key, of mode 0600")


def add_zenoh_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--zenoh", action="append", default=[], type=override, metavar="KEY=VALUE", help="any Zenoh setting (JSON5)"
    )


def run_name(text: str) -> str:
    try:
        return Keys(text).run
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def connects_to(text: str) -> str:
    return _endpoint(text, connects=True)


def listens_on(text: str) -> str:
    """Check an endpoint to listen on; port 0 means any free port."""
    return _endpoint(text, connects=False)


def _endpoint(text: str, connects: bool) -> str:
    if problem := endpoint_problem(text, connects=connects):
        raise argparse.ArgumentTypeError(f"{problem} (got {text!r})")
    return text


def agent_numbers(text: str) -> list[int]:
    """Parse numbers and ranges, separated by commas, into agents' numbers in ascending order."""
    numbers: set[int] = set()
    for part in text.split(","):
        first, sign, last = part.partition("-")
        try:
            low, high = int(first), int(last if sign else first)
        except ValueError:
            raise argparse.ArgumentTypeError(f"must be numbers such as 3,7 or 20-24 (got {text!r})") from None
        if not 0 <= low <= high < BASE_ID:
            raise argparse.ArgumentTypeError(f"must be from 0 to {BASE_ID - 1}, the lower first (got {part!r})")
        numbers.update(range(low, high + 1))
    return sorted(numbers)


def add_boards_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--boards`: the agents that run on machines of their own."""
    parser.add_argument(
        "--boards",
        type=agent_numbers,
        default=[],
        metavar="N-M,...",
        help="agents that may leave and come back, such as 20-24",
    )


def override(text: str) -> tuple[str, str]:
    """Parse KEY=VALUE into a pair."""
    key, sign, value = text.partition("=")
    if not key or not sign:
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE (got {text!r})")
    return key, value


def link_of(arguments: argparse.Namespace, role: str, number: int = 0, low_latency: bool = False) -> RouterLink:
    """Build the link that the arguments and the environment describe.

    Raises:
        OSError: the password file cannot be read.
        ValueError: the password file is not private; or as `tls_of`.
    """
    file: Path | None = arguments.password_file
    if file and (problem := secret_problem(file)):
        raise ValueError(f"--password-file {file} {problem}")
    password = read_text(file).strip() if file else os.environ.get(PASSWORD_VARIABLE, "")
    user = user_name(role, number) if password else ""
    tls = tls_of([arguments.connect], arguments.ca, arguments.certificate, arguments.key)
    return RouterLink(arguments.connect, user, password, low_latency, tuple(arguments.zenoh), tls)


def secret_problem(file: Path) -> str:
    """What a secret file must be (with the command that mends it), or "" if only its owner has access.

    Raises:
        OSError: the file does not exist.
    """
    mode = stat.S_IMODE(file.stat().st_mode)
    return f"must have mode 0600, not {mode:04o}: chmod 600 {file}" if mode & 0o077 else ""


def password_in(file: Path, user: str) -> str:
    """Read a user's password from a file of `user:password` lines, as the world writes it.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no such user, or the file is not private.
    """
    if problem := secret_problem(file):
        raise ValueError(problem)
    for line in read_text(file).splitlines():
        name, sign, password = line.strip().partition(":")
        if sign and name == user:
            return password
    raise ValueError(f"must have a line {user}:PASSWORD")


def tls_of(endpoints: Iterable[str], ca: str | None, certificate: str | None, key: str | None) -> Tls | None:
    """Collect the certificates for the endpoints; None if no endpoint begins with `tls/`.

    Raises:
        ValueError: a file is missing, unreadable or not needed, the key is not private, or the list of revoked
            certificates beside `ca` is unreadable.
    """
    files = {"ca": ca, "certificate": certificate, "key": key}
    over_tls = [endpoint for endpoint in endpoints if protocol_of(endpoint) == TLS]
    if not over_tls:
        if given := [name for name, file in files.items() if file]:
            raise ValueError(f"{', '.join(given)} must be left out unless an endpoint begins with {TLS}/")
        return None
    if missing := [name for name, file in files.items() if not file]:
        raise ValueError(f"{over_tls[0]} needs ca, certificate and key (missing: {', '.join(missing)})")
    for name, file in files.items():
        try:
            with open(file or "", encoding="utf-8"):
                problem = secret_problem(Path(file or "")) if name == "key" else ""
        except OSError as error:
            raise ValueError(f"{name}: {error}") from None
        if problem:
            raise ValueError(f"key: {file} {problem}")
    tls = Tls(ca or "", certificate or "", key or "")
    revoked_beside(tls.ca)
    return tls
