"""The command `deltaswarm`."""

import argparse
import importlib
import json
import os
import select
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator import cli_boards, cli_limits, cli_reports, cli_run, cli_sweeps
from deltaswarm_orchestrator.exits import FAILED, OK, USAGE, complain
from deltaswarm_orchestrator.stopping import raise_on_signals
from deltaswarm_wire import __version__
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.keys import OPERATOR

PARTS = ("agent", "world", "operator")
"""Commands that start one part by hand; the part's own module reads their arguments."""


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    made = argparse.ArgumentParser(
        prog="deltaswarm",
        description="A human-swarm testbed: agents as processes, coordination by messages, workload measured.",
        epilog="Exit codes: 0 well, 1 a run failed, 2 usage or scenario, 3 a claim missed its tolerance.",
    )
    made.add_argument("--version", action="version", version=f"deltaswarm {__version__}")
    commands = made.add_subparsers(dest="command", required=True, metavar="COMMAND")
    cli_run.add_run(commands.add_parser("run", help="run a scenario with real processes"))
    cli_sweeps.add_sweep(commands.add_parser("sweep", help="many runs that differ in some keys, in one table"))
    cli_reports.add_report(commands.add_parser("report", help="a sweep's tables, tests and figures as one page"))
    cli_reports.add_reproduce(commands.add_parser("reproduce", help="the paper's figures and claims, from own runs"))
    cli_limits.add_limits(commands.add_parser("limits", help="how the modes fare when communication is limited"))
    _add_bench(commands.add_parser("bench", help="measure this machine: the swarm beside the floors under it"))
    doctor = commands.add_parser("doctor", help="what this machine has and lacks")
    _add_json(doctor)
    info = commands.add_parser("info", help="a finished or interrupted run, from its folder")
    info.add_argument("folder", type=Path, metavar="RUN")
    _add_json(info)
    _add_why(commands.add_parser("why", help="whether an agent could hear another at a time of a run, and why not"))
    cli_boards.add_bundle(commands.add_parser("bundle", help="a folder that installs an agent on a board, offline"))
    cli_boards.add_certificates(commands.add_parser("certificates", help="for agents that reach the world over TLS"))
    for part in PARTS:
        commands.add_parser(part, help=f"run one {part} by hand (see: deltaswarm {part} --help)", add_help=False)
    return made


def _add_json(command: argparse.ArgumentParser) -> None:
    command.add_argument("--json", action="store_true", help="print the result as JSON")


def _add_why(command: argparse.ArgumentParser) -> None:
    command.description = "Does the run again in one process up to a time, and says whether B could hear A then."
    command.add_argument("folder", type=Path, metavar="RUN")
    command.add_argument("sender", type=int, metavar="A", help="the agent that speaks")
    command.add_argument(
        "receiver", type=_receiver, metavar="B", help="the agent that hears, or does not; or the operator: 'operator'"
    )
    command.add_argument("--at", type=float, required=True, metavar="T", help="when [s]")
    _add_json(command)


def _receiver(text: str) -> int | str:
    try:
        return text if text == OPERATOR else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: an agent's number or {OPERATOR!r} is expected") from None


def _add_bench(command: argparse.ArgumentParser) -> None:
    command.add_argument("--agents", type=int, default=25, metavar="N", help="size of the swarm (default: 25)")
    command.add_argument("--steps", type=int, default=1000, metavar="N", help="steps per measurement (default: 1000)")
    command.add_argument("--scale", action="store_true", help="how cost grows with the swarm, in one process, instead")
    command.add_argument("--radio", action="store_true", help="what the radio models cost, in one process, instead")
    command.add_argument("--sizes", type=_sizes, metavar="N,N,...", help="with --scale (default: 25,50,100,200,400)")
    command.add_argument("--rounds", type=int, default=3, metavar="N", help="with --scale or --radio (default: 3)")
    command.add_argument("--plot", type=Path, metavar="NAME", help="with --scale: draw NAME.png and NAME.svg")
    _add_json(command)


def _sizes(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: numbers with commas between them are expected") from None


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; its exit code."""
    argv = list(sys.argv[1:] if argv is None else argv)
    if argv and argv[0] in PARTS:
        raise_on_signals()
        module = importlib.import_module(f"deltaswarm_{argv[0]}.__main__")
        return int(module.main(argv[1:]))
    arguments = parser().parse_args(argv)
    if arguments.command != "run":  # which has its own way with signals
        raise_on_signals()
    command: Callable[[argparse.Namespace], int] = {
        "run": cli_run.run,
        "sweep": cli_sweeps.sweep,
        "report": cli_reports.report,
        "reproduce": cli_reports.reproduce,
        "limits": cli_limits.limits,
        "bench": _bench,
        "doctor": _doctor,
        "info": _info,
        "why": _why,
        "bundle": cli_boards.bundle,
        "certificates": cli_boards.certificates,
    }[arguments.command]
    try:
        code = command(arguments)
        sys.stdout.flush()
        return code
    except SettingsError as error:
        for problem in error.problems:
            complain(str(problem))
        return USAGE
    except BrokenPipeError:
        if not _reader_is_gone():
            raise
        return FAILED
    except KeyboardInterrupt:
        return FAILED


def _reader_is_gone() -> bool:
    """Whether nobody reads standard output any more, as `head` does not; what is left of it then goes nowhere."""
    output = select.poll()
    output.register(sys.stdout.fileno(), 0)
    if not output.poll(0):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return True


def _bench(arguments: argparse.Namespace) -> int:
    if not (arguments.scale or arguments.radio or cli_run.can_start_parts()):
        return FAILED
    try:
        found, text = _benched(arguments)
    except ValueError as error:
        complain(str(error))
        return USAGE
    print(json.dumps(found) if arguments.json else text)
    return OK


def _benched(arguments: argparse.Namespace) -> tuple[dict[str, Any], str]:
    from deltaswarm_orchestrator import bench, radio_cost

    if arguments.scale:
        return _scaled(arguments)
    if arguments.radio:
        found = radio_cost.measure_radio(arguments.agents, arguments.steps, arguments.rounds)
        return found, radio_cost.text(found)
    found = bench.measure(arguments.agents, arguments.steps)
    return found, bench.text(found)


def _scaled(arguments: argparse.Namespace) -> tuple[dict[str, Any], str]:
    from deltaswarm_orchestrator import scale
    from deltaswarm_orchestrator.figures import scale as drawn
    from deltaswarm_orchestrator.figures.style import save

    found = scale.measure_scale(arguments.sizes or scale.SIZES, arguments.steps, arguments.rounds)
    if arguments.plot:
        rows = [{**row, "rss_mb": row["peak_memory_mb"]} for row in found["sizes"]]
        save(drawn.scale(rows), arguments.plot)
    return found, scale.text(found)


def _doctor(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator import doctor

    findings = doctor.examine()
    print(doctor.to_json(findings) if arguments.json else doctor.text(findings))
    return OK if all(finding.is_well for finding in findings) else FAILED


def _info(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator import info

    if not arguments.folder.is_dir():
        unfinished = arguments.folder.with_name(f"{arguments.folder.name}.part")
        allowed = f"{unfinished} has what was left of a run" if unfinished.is_dir() else "a run folder is expected"
        complain(f"{arguments.folder} is no folder; {allowed}")
        return USAGE
    try:
        found = info.describe(arguments.folder)
    except info.NotARunError as error:
        complain(str(error))
        return USAGE
    print(json.dumps(found) if arguments.json else info.text(found))
    return OK


def _why(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator import info, why

    try:
        answer = why.why(arguments.folder, arguments.sender, arguments.receiver, arguments.at)
    except info.NotARunError as error:
        complain(str(error))
        return USAGE
    print(json.dumps(asdict(answer)) if arguments.json else why.text(answer))
    if answer.differs_from_step is not None:
        complain(f"the run was disturbed: from step {answer.differs_from_step} on this is another one than it was")
        return FAILED
    return OK
