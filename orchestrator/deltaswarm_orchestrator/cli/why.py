"""The command `deltaswarm why`."""

import argparse
from dataclasses import asdict
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, OK, complain
from deltaswarm_orchestrator.cli.arguments import A_RUN, add_json, must_exist, show
from deltaswarm_wire.keys import OPERATOR


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm why`."""
    command.description = "Repeats the run in one process up to a time, and says whether B could hear A then."
    command.add_argument("folder", type=Path, metavar="RUN")
    command.add_argument("sender", type=int, metavar="A", help="the agent that sends")
    command.add_argument("receiver", type=_receiver, metavar="B", help="the receiving agent, or 'operator'")
    command.add_argument("--at", type=float, required=True, metavar="T", help="time in the run [s]")
    add_json(command)
    command.set_defaults(func=why)


def _receiver(text: str) -> int | str:
    try:
        return text if text == OPERATOR else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be an agent's number or {OPERATOR!r} (got {text!r})") from None


def why(arguments: argparse.Namespace) -> int:
    """Say whether one agent could hear another, and why not."""
    from deltaswarm_orchestrator.inspect import link_report

    must_exist(arguments.folder, "RUN", A_RUN)
    answer = link_report.why(arguments.folder, arguments.sender, arguments.receiver, arguments.at)
    show(arguments, asdict(answer), link_report.text(answer))
    if answer.differs_from_step is not None:
        complain(f"the run was disturbed: this repetition differs from it from step {answer.differs_from_step} on")
        return FAILED
    return OK
