"""The command `deltaswarm run`."""

import argparse
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_cli.arguments import add_dry_run, add_engine, add_json, add_markers, add_quiet, host_and_port, show
from deltaswarm_orchestrator.base.advice import options_given
from deltaswarm_orchestrator.base.exits import OK, CommandError, notice
from deltaswarm_orchestrator.base.paths import free_folder, must_exist
from deltaswarm_orchestrator.processes.elsewhere import IN_ONE_PROCESS, LOCAL, engine_of
from deltaswarm_orchestrator.scenarios import BUILT_IN, DEFAULT_SCENARIO
from deltaswarm_wire import checked
from deltaswarm_wire.arguments import agent_numbers, connects_to, listens_on, number, override, whole

if TYPE_CHECKING:
    from deltaswarm_orchestrator.run.options import RunOptions
    from deltaswarm_scenario.scenario import Scenario

RECORDS = ("off", "views", "wire")
"""Values of the scenario's key `record`."""

LIVE_PORT = 8765
"""Foxglove's default port."""

ANYWHERE = "tcp/127.0.0.1:0"
"""Any free port, reachable from this machine only."""

FOXGLOVE, IN_PROCESS = "foxglove", "in-process"

NEEDS = {
    "debug": "in_process",
    "speed": "station",
    "station_listen": "station",
    "markers": "station",
    "live_port": "live",
    "live_connect": "live",
    "boards_folder": "boards",
    "engine": "scheduler",
    "scheduler": "engine",
}
"""Options, and the option without which they have no effect."""

EXCLUDES = {
    "in_process": (("station", "researcher", "boards", "checkpoint", "listen", "zenoh"), "there is one process"),
    "checkpoint": (("boards", "engine"), "it saves processes of this machine"),
    "engine": (("in_process", "boards"), "the agents are processes on the workers of a cluster"),
    "resume": (
        (
            *("scenario", "set", "seed", "out", "force", "in_process", "record", "boards", "engine", "checkpoint"),
            *("dry_run", "commands", "station"),
        ),
        "the run goes on as it began",
    ),
}
"""Options, the others that must not be given with them, and why."""

KEPT = ("listen", "zenoh", "live", "live_port", "live_connect", "researcher", "quiet", "json")
"""Options that count when a run is resumed."""


def add_run(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("what to run")
    group.add_argument(
        "scenario",
        nargs="?",
        metavar="SCENARIO",
        help=f"TOML file or {', '.join(BUILT_IN)} (default: {DEFAULT_SCENARIO})",
    )
    group.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any scenario key, dotted")
    group.add_argument("--seed", type=int, help="seed for all randomness")
    group.add_argument(
        "--commands", type=Path, metavar="FILE", help="commands of a scripted operator, such as commands.toml of a run"
    )
    add_dry_run(group, "the scenario with the meaning of every key")
    group = command.add_argument_group("output")
    group.add_argument("--out", type=Path, metavar="FOLDER", help="the run folder (default: runs/NAME-TIME)")
    group.add_argument("--force", action="store_true", help="replace the run folder if it exists")
    group.add_argument(
        "--record", choices=RECORDS, help="what to record: nothing, what viewers show, or also every raw frame"
    )
    add_json(group)
    add_quiet(group)
    group = command.add_argument_group("processes and network")
    group.add_argument("--in-process", action="store_true", help="all cores in one process, same digest")
    group.add_argument(
        "--debug",
        action="store_true",
        help="with --in-process: stop in Python's debugger where a controller, radio model or fault raises",
    )
    add_engine(group, "address of the scheduler, on whose workers the agents run")
    group.add_argument(
        "--listen",
        type=listens_on,
        metavar="ENDPOINT",
        help=f"where the router listens (default: {ANYWHERE}; with --engine dask: tls/ at this machine's address)",
    )
    group.add_argument(
        "--zenoh", action="append", default=[], type=override, metavar="KEY=VALUE", help="any Zenoh setting (JSON5)"
    )
    group = command.add_argument_group("live view")
    group.add_argument(
        "--live",
        metavar="foxglove|ros2",
        help="show the truth of the run under way to viewers that speak the subprotocol foxglove.sdk.v1 (Foxglove, "
        "Lichtblick from 1.22 on), or as messages of ROS 2 on rmw_zenoh; other packages can add observers",
    )
    group.add_argument(
        "--live-port",
        type=whole(0, 65_535),
        metavar="PORT",
        help=f"where --live foxglove listens on this machine (default: {LIVE_PORT}; 0: any free port)",
    )
    group.add_argument(
        "--live-connect",
        type=connects_to,
        metavar="ENDPOINT",
        help="endpoint of the observer; with --live ros2, of the Zenoh router of ROS (default: tcp/127.0.0.1:7447)",
    )
    group = command.add_argument_group("station")
    group.add_argument("--station", action="store_true", help="open a page on which a person watches and commands")
    group.add_argument(
        "--speed",
        type=number(0, 1000),
        metavar="N",
        help="with --station: initial speed, in simulated seconds per second; 0: as fast as possible (default: 1)",
    )
    group.add_argument(
        "--station-listen",
        type=host_and_port,
        metavar="HOST:PORT",
        help="where the station's page is served, without encryption (default: this machine alone, any free port)",
    )
    add_markers(group)
    group.add_argument(
        "--researcher",
        action="store_true",
        help="also serve the conductor's page, which shows the truth, at another address",
    )
    group = command.add_argument_group("boards")
    group.add_argument(
        "--boards",
        type=agent_numbers,
        metavar="N-M,...",
        help="agents that run on boards: wait for them instead of starting them",
    )
    group.add_argument(
        "--boards-folder",
        type=Path,
        metavar="FOLDER",
        help="where to put the files for each board (default: RUN.boards)",
    )
    group = command.add_argument_group("saving and resuming")
    group.add_argument(
        "--checkpoint", type=whole(1), metavar="STEPS", help="save the whole run after every STEPS steps"
    )
    group.add_argument(
        "--resume", type=Path, metavar="RUN", help="resume an interrupted run from its newest checkpoint"
    )
    command.set_defaults(func=run, makes_files=True, handles_signals=True)


def run(arguments: argparse.Namespace) -> int:
    from deltaswarm import runs
    from deltaswarm_cli import report
    from deltaswarm_orchestrator.run.operating import question_warning
    from deltaswarm_orchestrator.scenarios.load import commented_toml

    if problem := _problem(arguments):
        raise CommandError(problem)
    scenario = _scenario_of(arguments)
    options = _options_of(arguments, scenario)
    runs.check(scenario, options)
    if arguments.dry_run:
        show(arguments, checked.plain(scenario), commented_toml(scenario).rstrip())
        return OK
    if options.station and (warning := question_warning(scenario, options.station.speed)):
        notice(warning)
    return report.run_and_report(scenario, options, quiet=arguments.quiet, as_json=arguments.json)


def _problem(arguments: argparse.Namespace) -> str | None:
    """Return what is wrong with the combination of options; None if nothing is."""
    given = {name for name, value in vars(arguments).items() if not (value is None or value is False or value == [])}
    if arguments.engine in IN_ONE_PROCESS and not arguments.in_process:
        return f"--engine {arguments.engine} must be given with --in-process, without which it has no effect"
    if arguments.engine in (LOCAL, *IN_ONE_PROCESS):
        given.discard("engine")
    for name, (others, why) in EXCLUDES.items():
        if name in given and (refused := [_shown(other) for other in others if other in given]):
            return f"{_shown(name)} must be given without {', '.join(refused)}: {why}"
    for name, needed in NEEDS.items():
        if name in given and needed not in given:
            lacks = "there are no workers" if name == "engine" else "it has no effect"
            return f"{_shown(name)} must be given with {_shown(needed)}, without which {lacks}"
    if "live_port" in given and arguments.live != FOXGLOVE:
        return f"--live-port must be given with --live {FOXGLOVE}, without which it has no effect"
    if "live_connect" in given and arguments.live == FOXGLOVE:
        return f"--live-connect must be given without --live {FOXGLOVE}, which listens at --live-port"
    if arguments.resume is not None:
        must_exist(arguments.resume, "--resume", "the folder of an interrupted run")
        if not (arguments.resume / "scenario.toml").is_file():
            return f"--resume must be the folder of an interrupted run (got {arguments.resume})"
    return None


def _shown(name: str) -> str:
    return {"scenario": "SCENARIO"}.get(name, f"--{name.replace('_', '-')}")


def _scenario_of(arguments: argparse.Namespace) -> "Scenario":
    from deltaswarm_orchestrator.scenarios.load import load_scenario

    overrides = list(arguments.set)
    if arguments.record is not None:
        overrides.append(f"record={arguments.record}")
    if arguments.resume:
        return load_scenario(str(arguments.resume / "scenario.toml"))
    return load_scenario(arguments.scenario or DEFAULT_SCENARIO, overrides, arguments.seed, arguments.commands)


def _default_folder(scenario: "Scenario") -> Path:
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    mode = scenario.control.mode.replace(":", "-")
    return free_folder(Path("runs") / f"{scenario.name}-{mode}-seed{scenario.seed}-{stamp}")


def _began_in_process(folder: Path) -> bool:
    """Whether a run to resume has all its cores in one process, as a branch may."""
    from deltaswarm_orchestrator.base import seal

    return bool(seal.read_sealed(folder / seal.MANIFEST).get("engine") == IN_PROCESS)


def _options_of(arguments: argparse.Namespace, scenario: "Scenario") -> "RunOptions":
    from deltaswarm_orchestrator.processes.boards import Boards
    from deltaswarm_orchestrator.processes.station import LOOPBACK, StationChannel
    from deltaswarm_orchestrator.run.options import RunOptions

    out = arguments.resume or arguments.out or _default_folder(scenario)
    listen, boards, station, live_port = arguments.listen or ANYWHERE, None, None, None
    if engine := engine_of(arguments.engine, arguments.scheduler, arguments.listen or ""):
        listen = ANYWHERE
    if arguments.boards:  # which connect at `listen`; the processes of this machine need no fixed address
        folder = arguments.boards_folder or out.with_name(f"{out.name}.boards")
        boards, listen = Boards(tuple(arguments.boards), listen, folder), ANYWHERE
    if arguments.station:
        speed = 1.0 if arguments.speed is None else arguments.speed  # 0 is a speed
        station = StationChannel(speed, arguments.station_listen or LOOPBACK, markers=arguments.markers or "")
    if arguments.live == FOXGLOVE:
        live_port = LIVE_PORT if arguments.live_port is None else arguments.live_port
    return RunOptions(
        out=out,
        in_process_engine=arguments.engine if arguments.engine in IN_ONE_PROCESS else "",
        in_process=arguments.in_process or (arguments.resume and _began_in_process(arguments.resume)),
        debug=arguments.debug,
        force=arguments.force,
        listen=listen,
        zenoh=tuple(arguments.zenoh),
        boards=boards,
        engine=engine,
        checkpoint_steps=arguments.checkpoint or 0,
        station=station,
        researcher=arguments.researcher,
        resume=arguments.resume is not None,
        live_port=live_port,
        observer="" if arguments.live in (None, FOXGLOVE) else arguments.live,
        live_connect=arguments.live_connect or "",
        kept=tuple(options_given(arguments, KEPT)),
    )
