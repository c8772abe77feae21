"""`python -m deltaswarm_operator`: the operator of one run, on any machine.

With `--no-world` it is the operator of boards in open air.
"""

import argparse
import logging
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_operator import ANY_PORT
from deltaswarm_wire import checked
from deltaswarm_wire.access import REVOKED, TLS, air_rules, revoked_beside
from deltaswarm_wire.arguments import (
    Parser,
    add_link_arguments,
    add_tls_arguments,
    add_zenoh_argument,
    agent_numbers,
    connects_to,
    link_of,
    listens_on,
    number,
    password_in,
    run_name,
    tls_of,
    whole,
)
from deltaswarm_wire.child import FAILED, PLUGIN_FAILED, exit_code_of
from deltaswarm_wire.codec import MAX_ABS_M
from deltaswarm_wire.keys import OPERATOR, Keys
from deltaswarm_wire.logs import log_to_standard_error
from deltaswarm_wire.plugin_errors import blamed, described
from deltaswarm_wire.reading import read_toml
from deltaswarm_wire.session import RouterLink, air_pairs, protocol_of, tls_pairs

if TYPE_CHECKING:
    from deltaswarm_operator.io.open_air_source import OpenAirSource
    from deltaswarm_operator.io.process import StepSource
    from deltaswarm_operator.io.world_source import WorldSource
    from deltaswarm_scenario.operator_settings import OperatorSettings

NO_WORLD = "--no-world"
MODES = ("peer", "router")


def parser() -> argparse.ArgumentParser:
    made = Parser(
        prog="deltaswarm operator",
        description="Run the operator.",
        epilog="For boards without a world: deltaswarm operator --no-world ...; see deltaswarm operator --no-world -h.",
    )
    _add_measuring(made, "length of the world's steps [s] (default: 1)")
    made.add_argument("--publish-all", action="store_true", help="publish the workload of every step, for a recorder")
    made.add_argument(
        "--go-on",
        action="store_true",
        help="resume the counts of a killed operator in the same folder",
    )
    made.add_argument(
        "--checkpoint", type=whole(0), default=0, metavar="STEPS", help="save the counts every STEPS steps"
    )
    made.add_argument(
        "--briefing", type=Path, metavar="FILE", help="run details for an operator with a station or script"
    )
    made.add_argument("--channel-fd", type=whole(0), metavar="N", help="its end of the socket pair to the station")
    made.add_argument("--markers", default="", metavar="HOST:PORT|lsl", help="tell the person's acts there")
    made.add_argument("--conductor-fd", type=whole(0), metavar="N", help="the same for the conductor's page")
    made.add_argument("--low-latency", action="store_true", help="for an operator on the world's own machine")
    add_link_arguments(made)
    return made


def _add_measuring(made: argparse.ArgumentParser, step: str) -> None:
    made.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="for operator.csv and operator.json")
    made.add_argument("--step-s", type=number(0.0), default=1.0, help=step)
    made.add_argument(
        "--threshold-hz", type=number(0.0), default=5.0, help="count the time above this message rate (default: 5)"
    )


def open_air_parser() -> argparse.ArgumentParser:
    made = Parser(
        prog="deltaswarm operator --no-world",
        description="Monitor boards in open air: which are alive, and how much they report. With a key that the boards "
        "know, command them. Interrupt it to stop.",
    )
    made.add_argument(NO_WORLD, action="store_true", help=argparse.SUPPRESS)
    _add_measuring(made, "length of a row's step [wall s] (default: 1)")
    made.add_argument("--run", required=True, type=run_name, help="name of the run, as in the boards' files")
    made.add_argument(
        "--mode",
        choices=MODES,
        default=MODES[0],
        help="peer: boards connect to each other; router: they connect through the operator",
    )
    for name, kind, what in (
        ("--listen", listens_on, "endpoint for boards to connect to"),
        ("--connect", connects_to, "endpoint of a board, or of a router that boards use"),
    ):
        made.add_argument(
            name, action="append", type=kind, default=[], metavar="ENDPOINT", help=f"{what}; may be repeated"
        )
    made.add_argument(
        "--credentials", type=Path, metavar="FILE", help="user:password lines of all participants, including operator"
    )
    made.add_argument(
        "--agents",
        type=agent_numbers,
        default=[],
        metavar="N-M,...",
        help="over TLS: admitted agents, such as 0-24, identified by certificate; default: any agent",
    )
    made.add_argument(
        "--status-every-s",
        type=number(1e-3),
        default=10.0,
        metavar="S",
        help="interval of status lines [s] (default: 10)",
    )
    _add_commanding(made)
    add_tls_arguments(made)
    add_zenoh_argument(made)
    return made


def _add_commanding(made: argparse.ArgumentParser) -> None:
    told = made.add_argument_group("commands and station")
    told.add_argument("--station", action="store_true", help="serve a page to watch and command; prints its address")
    told.add_argument(
        "--station-listen", metavar="HOST:PORT", help=f"address of the page (default: {ANY_PORT}, any free port)"
    )
    told.add_argument("--controller", metavar="MODE", help="the boards' controller, which accepts the commands")
    told.add_argument("--command-key", type=Path, metavar="FILE", help="private key that signs the commands")
    told.add_argument("--commands", type=Path, metavar="FILE", help="[[command]] tables; at_s since the start [s]")
    told.add_argument(
        "--task", type=Path, metavar="FILE", help="a board's file: its table [agent] has arena, step and controller"
    )
    told.add_argument("--base", type=_place, metavar="X,Y", help="where the base is, for boards with air.range_m [m]")


def _place(text: str) -> tuple[float, float]:
    x_m, sign, y_m = text.partition(",")
    try:
        place = (float(x_m), float(y_m))
    except ValueError:
        place = None
    if not sign or place is None or not all(abs(value) <= MAX_ABS_M for value in place):
        raise argparse.ArgumentTypeError(f"must be X,Y in metres (got {text!r})")
    return place


def main(argv: Sequence[str] | None = None) -> int:
    """Run the operator. Exit code: 0 after a complete run, 2 for bad arguments, else one of `deltaswarm_wire.child`."""
    argv = sys.argv[1:] if argv is None else argv
    log_to_standard_error()
    without_world = NO_WORLD in argv
    arguments = (open_air_parser() if without_world else parser()).parse_args(argv)
    from deltaswarm_operator.io.files import TABLE  # none of what is imported in functions is needed for --help
    from deltaswarm_operator.io.process import run_operator

    try:
        source: StepSource = _open_air(arguments) if without_world else _world(arguments)
        config = source.config
        if (config.out / TABLE).exists() and not config.go_on:
            raise FileExistsError(
                f"--out must be a folder without {TABLE}, which is never overwritten (got {config.out})"
            )
    except (ValueError, OSError) as error:
        print(f"deltaswarm operator: {error}", file=sys.stderr)
        return 2
    try:
        return run_operator(source)
    except Exception as error:
        log = logging.getLogger("deltaswarm.operator")
        if plugin := blamed(error):
            log.critical("%s", plugin.report)
            return PLUGIN_FAILED
        code = exit_code_of(error)
        log.critical("%s", described(error), exc_info=code == FAILED and not isinstance(error, OSError))
        return code


def _world(arguments: argparse.Namespace) -> "WorldSource":
    from deltaswarm_operator.io.world_source import WorldSource, WorldSourceConfig
    from deltaswarm_scenario.operator_settings import Briefing

    briefing = arguments.briefing and checked.load(Briefing, read_toml(arguments.briefing))
    config = WorldSourceConfig(
        briefing=briefing,
        station=_end(arguments.channel_fd),
        conductor=_end(arguments.conductor_fd),
        run=arguments.run,
        link=link_of(arguments, OPERATOR, low_latency=arguments.low_latency),
        settings=_settings(arguments),
        step_s=_step_s(arguments),
        out=arguments.out,
        publish_all=arguments.publish_all,
        go_on=arguments.go_on,
        checkpoint_steps=arguments.checkpoint,
        markers=arguments.markers,
    )
    return WorldSource(config)


def _end(descriptor: int | None) -> socket.socket | None:
    return None if descriptor is None else socket.socket(fileno=descriptor)


def _open_air(arguments: argparse.Namespace) -> "OpenAirSource":
    """Check the arguments. Raises ValueError, OSError."""
    from deltaswarm_operator.io.command_options import command_options_of
    from deltaswarm_operator.io.open_air_source import OpenAirConfig, OpenAirSource

    connect, listen = arguments.connect, arguments.listen
    if not connect and not listen:
        raise ValueError(f"{NO_WORLD} needs --listen or --connect")
    tls = tls_of([*connect, *listen], arguments.ca, arguments.certificate, arguments.key)
    if tls is not None:
        from deltaswarm_wire.certificate import certificate_problem  # no other operator needs ssl

        if problem := certificate_problem(tls, OPERATOR):
            raise ValueError(f"--certificate {tls.certificate}: {problem}")
    link = RouterLink((*connect, *listen)[0], overrides=tuple(arguments.zenoh), tls=tls)
    pairs = air_pairs(arguments.mode, connect, listen) + tls_pairs(tls, "connect", "listen")
    pairs += [("listen/timeout_ms", 0), ("listen/exit_on_failure", True)]  # the user can read the error
    revoked = revoked_beside(tls.ca) if tls else frozenset()
    if arguments.agents:
        if any(protocol_of(endpoint) != TLS for endpoint in (*connect, *listen)):
            raise ValueError("--agents must be left out unless every endpoint is tls/: certificates name the agents")
        pairs.append(("access_control", air_rules(Keys(arguments.run), arguments.agents, revoked)))
    elif revoked:
        raise ValueError(f"--agents must name the admitted agents, since there is a {REVOKED} beside {arguments.ca}")
    if arguments.credentials:
        try:
            password = password_in(arguments.credentials, OPERATOR)
        except ValueError as error:
            raise ValueError(f"--credentials {arguments.credentials} {error}") from None
        pairs += [("transport/auth/usrpwd/user", OPERATOR), ("transport/auth/usrpwd/password", password)]
        pairs.append(("transport/auth/usrpwd/dictionary_file", str(arguments.credentials)))
    settings, step_s = _settings(arguments), _step_s(arguments)
    options = command_options_of(arguments, settings, step_s)
    config = OpenAirConfig(
        command_options=options,
        listen=options.listen if options else None,
        run=arguments.run,
        link=link,
        pairs=pairs,
        settings=settings,
        step_s=step_s,
        out=arguments.out,
        status_every_s=arguments.status_every_s,
    )
    return OpenAirSource(config)


def _settings(arguments: argparse.Namespace) -> "OperatorSettings":
    from deltaswarm_scenario.operator_settings import OperatorSettings

    return checked.load(OperatorSettings, {"threshold_hz": arguments.threshold_hz}, "operator")


def _step_s(arguments: argparse.Namespace) -> float:
    from deltaswarm_scenario.scenario import RunSettings

    return checked.load(RunSettings, {"step_s": arguments.step_s}, "run").step_s


if __name__ == "__main__":
    sys.exit(main())
