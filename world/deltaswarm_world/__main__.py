"""`python -m deltaswarm_world`: the world of one run, which is also its router."""

import argparse
import logging
import secrets
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_wire import checked
from deltaswarm_wire.access import TLS, user_name
from deltaswarm_wire.arguments import (
    Parser,
    add_boards_argument,
    add_tls_arguments,
    add_zenoh_argument,
    listens_on,
    run_name,
    tls_of,
    whole,
)
from deltaswarm_wire.child import FAILED, exit_code_of, say_ready
from deltaswarm_wire.codec import MAX_STEP
from deltaswarm_wire.files import naming, write_whole
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER
from deltaswarm_wire.logs import log_to_standard_error
from deltaswarm_wire.plugin_errors import blamed, described
from deltaswarm_wire.reading import read_toml
from deltaswarm_wire.session import CERTIFIED, RouterLink, protocol_of

if TYPE_CHECKING:
    from deltaswarm_scenario.scenario import Scenario

log = logging.getLogger("deltaswarm.world")

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

LOOPBACK = ("127.", "localhost:", "[::1]:")

AGENT_SETTINGS = "agents"
"""Folder with one settings file per agent, beside the world's tables."""


def parser() -> argparse.ArgumentParser:
    parser = Parser(prog="deltaswarm world", description="Run the world and its router.")
    parser.add_argument("--scenario", type=Path, required=True, metavar="FILE", help="the whole scenario (TOML)")
    parser.add_argument("--run", required=True, type=run_name, help="name of the run")
    parser.add_argument(
        "--listen",
        action="append",
        type=listens_on,
        metavar="ENDPOINT",
        help=f"may be repeated; port 0: any free port (default: {DEFAULT_ENDPOINT})",
    )
    add_tls_arguments(parser)
    parser.add_argument(
        "--credentials",
        type=Path,
        required=True,
        metavar="FILE",
        help="user:password lines of all participants; created with random passwords if it does not exist",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="for its tables, and for the agents' settings, agents/N.toml",
    )
    parser.add_argument(
        "--expect",
        action="append",
        choices=(OPERATOR, RECORDER),
        help="part that must be ready before the first step, besides the agents (default: operator)",
    )
    parser.add_argument(
        "--checkpoint", type=whole(0), default=0, metavar="STEPS", help="save world and agents every STEPS steps"
    )
    parser.add_argument(
        "--resume", type=whole(0, MAX_STEP), metavar="STEP", help="resume from the checkpoint after this step"
    )
    parser.add_argument("--station", action="store_true", help="accept commands and pace from a person at the station")
    add_boards_argument(parser)
    parser.add_argument(
        "--time-phases", action="store_true", help="add to world.json where the steps' wall time goes, by phase"
    )
    parser.add_argument(
        "--metric", action="append", default=[], metavar="NAME", help="a number of the controller's own, for its tables"
    )
    parser.add_argument("--truth", action="store_true", help="publish the truth for a recorder")
    parser.add_argument("--wire", action="store_true", help="publish every raw radio frame and report for a recorder")
    add_zenoh_argument(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the world. Exit code: 0 after a complete run, 2 for bad arguments, else one of `deltaswarm_wire.child`.

    The first line of standard output has the endpoints on which it listens.
    """
    arguments = parser().parse_args(argv)
    from deltaswarm_scenario.scenario import Scenario  # none of these is needed for --help
    from deltaswarm_world.io.files import TABLES, has_steps
    from deltaswarm_world.io.process import run_world
    from deltaswarm_world.io.saving import WorldConfig, load

    log_to_standard_error()
    try:
        scenario = checked.load(Scenario, read_toml(arguments.scenario))
        kinds = sorted({f"fault.kind = {fault.kind!r}" for fault in scenario.fault if fault.to_process})
        if scenario.world.to_process:
            kinds.append(f"world.dynamics = {scenario.world.dynamics!r}")
        if RECORDER not in (arguments.expect or ()) and kinds:
            raise ValueError(f"{', '.join(kinds)} needs `deltaswarm run`, which controls the processes")
        if arguments.boards and arguments.boards[-1] >= scenario.agents.count:
            raise ValueError(f"--boards must be from 0 to {scenario.agents.count - 1} (got {arguments.boards[-1]})")
        listen = tuple(arguments.listen or (DEFAULT_ENDPOINT,))
        tls = tls_of(listen, arguments.ca, arguments.certificate, arguments.key)
        if arguments.credentials.is_dir():
            raise ValueError(f"--credentials must be a file (got the folder {arguments.credentials})")
        if arguments.resume is None and has_steps(arguments.out):
            must = f"--out must be a folder without steps in {TABLES[0]}, which is never overwritten"
            raise FileExistsError(f"{must} (got {arguments.out})")
        if not arguments.credentials.exists():
            write_credentials(arguments.credentials, scenario.agents.count)
        if tls:
            admit_certified(listen, arguments.credentials)
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_agent_settings(arguments.out / AGENT_SETTINGS, scenario)
        config = WorldConfig(
            run=arguments.run,
            scenario=scenario,
            link=RouterLink(listen[0], overrides=tuple(arguments.zenoh), tls=tls),
            credentials=arguments.credentials,
            out=arguments.out,
            expect=tuple(arguments.expect or (OPERATOR,)),
            publish_truth=arguments.truth,
            publish_wire=arguments.wire,
            listen=listen,
            boards=tuple(arguments.boards),
            checkpoint_steps=arguments.checkpoint,
            has_station=arguments.station,
            time_phases=arguments.time_phases,
            metrics=tuple(arguments.metric),
        )
        saved = None if arguments.resume is None else load(arguments.out, arguments.resume)
    except (ValueError, OSError) as error:
        print(f"deltaswarm world: {error}", file=sys.stderr)
        return 2
    try:
        return run_world(config, say_ready, saved)
    except ConnectionError as error:
        log.critical("%s", error)
        return FAILED
    except BaseException as error:
        if plugin := blamed(error):
            log.critical("%s", plugin.report)
            return FAILED
        if not isinstance(error, Exception):
            raise
        code = exit_code_of(error)
        log.critical("%s", described(error), exc_info=code == FAILED and not isinstance(error, OSError))
        return code


def write_agent_settings(folder: Path, scenario: "Scenario") -> None:
    """Write one settings file per agent, each with the agent's own seed."""
    import tomli_w

    folder.mkdir(exist_ok=True)
    for agent in range(scenario.agents.count):
        with naming(file := folder / f"{agent}.toml"):
            file.write_text(tomli_w.dumps(checked.plain(scenario.for_agent(agent))), encoding="utf-8")


def write_credentials(file: Path, agents: int) -> None:
    """Write a random password per process, readable only by this user."""
    users = [user_name(AGENT, agent) for agent in range(agents)] + [OPERATOR, RECORDER]
    write_whole(file, "".join(f"{user}:{secrets.token_urlsafe(24)}\n" for user in users).encode(), 0o600)


def admit_certified(listen: Sequence[str], credentials: Path) -> None:
    """Admit clients with a certificate."""
    for endpoint in listen:
        address = endpoint.partition("/")[2]
        if protocol_of(endpoint) != TLS and not address.startswith(LOOPBACK):
            raise ValueError(f"--listen must be {TLS}/ or on loopback if one endpoint is {TLS}/ (got {endpoint})")
    line = f"{CERTIFIED}:{CERTIFIED}"
    lines = credentials.read_text(encoding="utf-8").splitlines()
    if line not in lines:
        write_whole(credentials, "\n".join([*lines, line, ""]).encode(), 0o600)


if __name__ == "__main__":
    sys.exit(main())
