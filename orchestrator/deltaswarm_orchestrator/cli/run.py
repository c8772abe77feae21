"""`deltaswarm run`."""

import argparse
import json
import sys
from datetime import datetime
from pathlib import Path

from deltaswarm_orchestrator.cli import boards as cli_boards
from deltaswarm_orchestrator.exits import FAILED, OK, USAGE, complain
from deltaswarm_orchestrator.run.scenario import BUILT_IN, commented_toml, load_scenario
from deltaswarm_wire.arguments import listens_on, override
from deltaswarm_wire.settings import RECORDS, Scenario

DEFAULT_SCENARIO = "paper-25"
LOOPBACK = "127.0.0.1:0"

LIVE_PORT = 8765
"""The one that Foxglove suggests."""

ANYWHERE = "tcp/127.0.0.1:0"
"""On this machine, any free port."""


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm run`."""
    command.add_argument(
        "scenario",
        nargs="?",
        metavar="SCENARIO",
        help=f"TOML file or {', '.join(BUILT_IN)} (default: {DEFAULT_SCENARIO})",
    )
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any scenario key, dotted")
    command.add_argument("--seed", type=int, help="seed for all randomness")
    command.add_argument("--out", type=Path, metavar="FOLDER", help="the run folder (default: runs/NAME-TIME)")
    command.add_argument("--force", action="store_true", help="replace the run folder if it exists")
    command.add_argument("--in-process", action="store_true", help="all cores in one process, same digest")
    command.add_argument(
        "--record", choices=RECORDS, help="what to record: nothing, what viewers show, or also every raw frame"
    )
    command.add_argument(
        "--live",
        choices=("foxglove",),
        help="show the truth of the run under way to viewers that speak the subprotocol foxglove.sdk.v1: Foxglove, "
        "Lichtblick from 1.22 on",
    )
    command.add_argument(
        "--live-port",
        type=_port,
        metavar="PORT",
        help=f"where --live listens on this machine (default: {LIVE_PORT}; 0: any free port)",
    )
    command.add_argument(
        "--listen",
        default=ANYWHERE,
        type=listens_on,
        metavar="ENDPOINT",
        help=f"where the router listens (default: {ANYWHERE})",
    )
    cli_boards.add_hardware_in_the_loop(command)
    command.add_argument(
        "--zenoh", action="append", default=[], type=override, metavar="KEY=VALUE", help="any Zenoh setting (JSON5)"
    )
    command.add_argument(
        "--checkpoint",
        type=_steps,
        default=0,
        metavar="STEPS",
        help="save the whole run after every STEPS steps",
    )
    command.add_argument(
        "--resume", type=Path, metavar="RUN", help="resume an interrupted run from its newest checkpoint"
    )
    command.add_argument("--station", action="store_true", help="open a page on which a person watches and commands")
    command.add_argument(
        "--speed",
        type=_speed,
        default=1.0,
        metavar="N",
        help="with --station: simulated per wall second to begin with; 0: as fast as possible (default: 1)",
    )
    command.add_argument(
        "--station-listen",
        default=LOOPBACK,
        metavar="HOST:PORT",
        help="where the station's page is served, without encryption (default: this machine alone, any free port)",
    )
    command.add_argument(
        "--commands", type=Path, metavar="FILE", help="commands of a scripted operator, such as commands.toml of a run"
    )
    command.add_argument(
        "--dry-run", action="store_true", help="only check the scenario, and print it with the meaning of every key"
    )
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(func=run)


def _steps(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r}: a number of steps, at least 1, is expected")
    return int(text)


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65_535:
        raise argparse.ArgumentTypeError(f"{text!r}: a port from 0 to 65535 is expected")
    return int(text)


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = -1.0
    if not 0.0 <= speed <= 1000.0:
        raise argparse.ArgumentTypeError(f"must be from 0 to 1000 (got {text})")
    return speed


def run(arguments: argparse.Namespace) -> int:
    """`deltaswarm run`."""
    if problem := _live_problem(arguments) or _resume_problem(arguments):
        complain(problem)
        return USAGE
    scenario = _scenario_of(arguments)
    if arguments.dry_run:
        print(commented_toml(scenario), end="")
        return OK
    from deltaswarm_orchestrator.bench.doctor import can_start_parts

    if not arguments.in_process and not can_start_parts():
        return FAILED
    from rich.console import Console

    from deltaswarm_orchestrator.run.conduct import RunOptions
    from deltaswarm_orchestrator.run.conduct import run as run_scenario
    from deltaswarm_orchestrator.run.folder import FolderError, FolderTakenError
    from deltaswarm_orchestrator.run.foxglove_server import LiveError
    from deltaswarm_orchestrator.run.progress import Display, result_table
    from deltaswarm_orchestrator.run.station import Station

    out = arguments.resume or arguments.out or _default_folder(scenario)
    boards = cli_boards.boards_of(arguments, out)
    listen = ANYWHERE if boards else arguments.listen
    options = RunOptions(
        out,
        arguments.in_process,
        arguments.force,
        listen,
        tuple(arguments.zenoh),
        boards,
        arguments.checkpoint,
        Station(arguments.speed, arguments.station_listen) if arguments.station else None,
        resume=arguments.resume is not None,
        live_port=(LIVE_PORT if arguments.live_port is None else arguments.live_port) if arguments.live else None,
    )
    try:
        with Display(scenario.run.step_s, scenario.agents.count) as display:
            result = run_scenario(scenario, options, display)
    except LiveError as error:
        complain(str(error))
        return USAGE
    except FolderError as error:
        complain(str(error))
        return FAILED if isinstance(error, FolderTakenError) else USAGE
    for message in result.messages:
        complain(message)
    if arguments.json:
        print(json.dumps({"folder": str(result.folder), "exit_reason": result.exit_reason, **result.summary}))
    elif not result.summary["steps"]:
        complain(f"{result.exit_reason}: no step was made; see {result.folder}")
        return FAILED
    else:
        Console().print(result_table(result.summary))
        print(result.folder)
        if sys.stderr.isatty():
            recording = "" if scenario.record == "off" else f"; open {result.folder / 'recording.mcap'} in a viewer"
            print(f"next: deltaswarm info {result.folder}{recording}", file=sys.stderr)
    if overruns := result.summary["realtime_overruns"]:
        complain(f"{overruns} steps took longer than real time")
    for reason in result.summary["invalid_because"]:
        complain(f"not valid: {reason}")
    return OK if result.summary["valid"] else FAILED


def _live_problem(arguments: argparse.Namespace) -> str | None:
    """What does not go together with --live, if anything."""
    if arguments.live and arguments.dry_run:
        return "--live shows a run under way; --dry-run makes none"
    if arguments.live_port is not None and not arguments.live:
        return "--live-port is for --live foxglove, which was not given"
    return None


def _resume_problem(arguments: argparse.Namespace) -> str | None:
    """What does not go together with --resume or --checkpoint, if anything."""
    if arguments.resume is None:
        elsewhere = {"--in-process": arguments.in_process, "--boards": arguments.boards}
        given = [name for name, value in elsewhere.items() if arguments.checkpoint and value]
        return f"--checkpoint saves processes of this machine; {given[0]} is not allowed with it" if given else None
    names = (
        "scenario",
        "set",
        "seed",
        "out",
        "force",
        "in_process",
        "record",
        "boards",
        "checkpoint",
        "dry_run",
        "commands",
        "station",
    )
    given = [name for name in names if getattr(arguments, name) not in (None, False, 0, [])]
    if given:
        shown = ", ".join(name.upper() if name == "scenario" else f"--{name.replace('_', '-')}" for name in given)
        return f"--resume goes on with the run as it was begun; {shown} is not allowed with it"
    if not (arguments.resume / "scenario.toml").is_file():
        return f"--resume {arguments.resume}: the folder of a run that was begun is expected"
    return None


def _scenario_of(arguments: argparse.Namespace) -> Scenario:
    overrides = list(arguments.set)
    if arguments.record is not None:
        overrides.append(f"record={arguments.record}")
    if arguments.resume:
        return load_scenario(str(arguments.resume / "scenario.toml"))
    return load_scenario(arguments.scenario or DEFAULT_SCENARIO, overrides, arguments.seed, arguments.commands)


def _default_folder(scenario: Scenario) -> Path:
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    mode = scenario.control.mode.replace(":", "-")
    base = Path("runs") / f"{scenario.name}-{mode}-seed{scenario.seed}-{stamp}"
    numbered = (base.with_name(f"{base.name}-{number}") for number in range(2, 10_000))
    free = (p for p in (base, *numbered) if not p.exists() and not p.with_name(p.name + ".part").exists())
    return next(free)
