"""The command `deltaswarm serve`: its options. What it does is imported when it is done."""

import argparse
from pathlib import Path

from deltaswarm_cli.arguments import add_dry_run, add_json, host_and_port
from deltaswarm_sessions import AGENTS, IN_PROCESS
from deltaswarm_wire.arguments import whole

LISTEN = "127.0.0.1:8420"


def add_session(command: argparse.ArgumentParser) -> None:
    """Do all runs of one participant, in a balanced order."""
    from deltaswarm_sessions.command import add_session as add

    add(command)
    command.set_defaults(func=session)


def session(arguments: argparse.Namespace) -> int:
    from deltaswarm_serving import alone

    return alone.session(arguments)


def add_serve(command: argparse.ArgumentParser) -> None:
    """Serve a study by link: many participants at once, each at a page of their own."""
    from deltaswarm_orchestrator.scenarios import LANGUAGES

    command.description = (
        "Serve the sessions of a study at one address, to many participants at once. Each comes by a link of "
        "their own, or by the open link, which gives each new person the next number. What was under way goes on when "
        "the command is given again. See docs/BY_LINK.md."
    )
    command.add_argument("session", type=Path, metavar="FILE", help="a TOML file with a table [session]")
    command.add_argument(
        "--links", type=whole(1, 10_000), metavar="N", help="serve nothing; make N links of their own, and print them"
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="folder of all sessions (default: sessions/NAME)")
    command.add_argument(
        "--listen", type=host_and_port, default=LISTEN, metavar="HOST:PORT", help=f"where to listen (default: {LISTEN})"
    )
    command.add_argument(
        "--public", default="", metavar="URL", help="address by which participants reach it, such as that of a proxy"
    )
    command.add_argument(
        "--embed", default="", metavar="ORIGIN", help="origin whose pages may show it in a frame and get the code"
    )
    command.add_argument("--certificate", type=Path, metavar="FILE", help="speak TLS itself, by this certificate (PEM)")
    command.add_argument("--key", type=Path, metavar="FILE", help="with --certificate: its private key (PEM)")
    command.add_argument("--pilot", action="store_true", help="work on the pilot's sessions, in the folder 'pilot'")
    command.add_argument(
        "--robots",
        type=whole(1, 1000),
        metavar="N",
        help="with --pilot: N scripted participants come by the open link, for a rehearsal that ends with them",
    )
    command.add_argument(
        "--agents",
        choices=AGENTS,
        default=IN_PROCESS,
        help="where agents run, as in `deltaswarm session`; with processes a machine carries few sessions, and a run "
        "that is killed is done again",
    )
    command.add_argument(
        "--share",
        type=_share,
        default=(1, 1),
        metavar="K/N",
        help="give numbers of share K of N, where several machines serve one study (default: 1/1)",
    )
    command.add_argument(
        "--restart-runs",
        action="store_true",
        help="after a change of deltaswarm or a file: do runs again that were begun before it",
    )
    command.add_argument(
        "--language", default="", metavar="LANGUAGE", help=f"language of all pages: {', '.join(LANGUAGES)}, or a file"
    )
    add_dry_run(command, "what a session asks, and how many this machine carries")
    add_json(command)
    command.set_defaults(func=serve, makes_files=True, handles_signals=True)


def _share(text: str) -> tuple[int, int]:
    mine, _, of = text.partition("/")
    if not (mine.isdecimal() and of.isdecimal() and 1 <= int(mine) <= int(of)):
        raise argparse.ArgumentTypeError(f"must be K/N with K from 1 to N, such as 2/3 (got {text!r})")
    return int(mine), int(of)


def serve(arguments: argparse.Namespace) -> int:
    from deltaswarm_serving import doing

    return doing.serve(arguments)
