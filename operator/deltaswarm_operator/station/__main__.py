"""`python -m deltaswarm_operator.station`: the station of one feed, which started it and holds its channel.

The feed is the process at the other end of the socket pair: the operator, a replay or the researcher's observer.
"""

import argparse
import asyncio
import logging
import os
import secrets
import signal
import socket
import sys
from collections.abc import Sequence

from deltaswarm_operator.station.rules import is_loopback
from deltaswarm_operator.station.server import Station

PASSWORD_VARIABLE = "DELTASWARM_PASSWORD"
"""Same name as for all parts of a run, repeated here because a station does not import the wire."""

TOKEN_BYTES = 24
"""32 characters in a URL."""


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        allow_abbrev=False,
        prog="python -m deltaswarm_operator.station",
        description="Serve the operator's page. Prints its URL; whoever knows the URL can watch and give orders.",
        epilog=f"{PASSWORD_VARIABLE} in the environment is the secret part of the URL, else it is random.",
    )
    parser.add_argument(
        "--channel-fd",
        type=int,
        required=True,
        metavar="N",
        help="file descriptor of this end of the feed's socket pair (AF_UNIX, SOCK_SEQPACKET)",
    )
    parser.add_argument(
        "--listen",
        type=host_and_port,
        default=("127.0.0.1", 0),
        metavar="HOST:PORT",
        help="where browsers connect (default: 127.0.0.1:0, this machine alone, any free port); not encrypted",
    )
    parser.add_argument(
        "--watchers", action="store_true", help="print a second URL, at which one can watch but do nothing"
    )
    return parser


def host_and_port(text: str) -> tuple[str, int]:
    """Parse HOST:PORT, with an IPv6 address in brackets."""
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise argparse.ArgumentTypeError(f"must be HOST:PORT with a port from 0 to 65535 (got {text!r})")
    return host, int(port)


def main(argv: Sequence[str] | None = None) -> int:
    """Serve until the feed closes or a signal. Exit code: 0, 1 if it cannot listen, 2 for bad arguments."""
    arguments = parser().parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    log = logging.getLogger("deltaswarm.station")
    host, port = arguments.listen
    try:
        feed = socket.socket(fileno=arguments.channel_fd)
        if feed.family != socket.AF_UNIX or feed.type != socket.SOCK_SEQPACKET:
            raise OSError("it must be an AF_UNIX socket of type SOCK_SEQPACKET")
    except OSError as error:
        print(f"deltaswarm station: --channel-fd {arguments.channel_fd}: {error}", file=sys.stderr)
        return 2
    if not is_loopback(host):
        log.warning("listening on %s: pages travel unencrypted, use a trusted network or a tunnel", host)
    try:
        asyncio.run(_serve(feed, host, port, has_watchers=arguments.watchers))
    except OSError as error:
        log.error("the station cannot listen on %s:%d: %s", host, port, error)
        return 1
    return 0


async def _serve(feed: socket.socket, host: str, port: int, *, has_watchers: bool) -> None:
    token = os.environ.get(PASSWORD_VARIABLE) or secrets.token_urlsafe(TOKEN_BYTES)
    station = Station(feed, token, has_watchers=has_watchers)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, station.stop)
    await station.run(host, port)


if __name__ == "__main__":
    sys.exit(main())
