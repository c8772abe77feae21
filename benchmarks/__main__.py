"""`python -m benchmarks`: measure what a swarm costs on this machine. Run it from the root of a clone."""

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from typing import Any

from deltaswarm_cli.main import carry_out
from deltaswarm_orchestrator.base.exits import OK
from deltaswarm_wire.arguments import Parser, whole


def _sizes(text: str) -> list[int]:
    return [whole(1)(part) for part in text.split(",")]


OPTIONS: dict[str, dict[str, Any]] = {
    "agents": {"type": whole(3), "default": 25, "help": "size of the swarm (default: 25)"},
    "sizes": {"type": _sizes, "default": "25,100,400,1000", "help": "sizes of the swarm (default: %(default)s)"},
    "steps": {"type": whole(1), "default": 1000, "help": "steps per measurement (default: 1000)"},
    "rounds": {"type": whole(1), "default": 3, "help": "rounds, of which the medians are given (default: 3)"},
}

MEASUREMENTS = {
    "processes": (("sizes", "steps", "rounds"), "start-up, speed, memory and open files of runs with real processes"),
    "scale": (("sizes", "steps", "rounds"), "how the cost of a step grows with the swarm, in one process"),
    "engines": (("agents", "steps", "rounds"), "whole runs by the Python and by the dense engine, in one process"),
    "radio_cost": (("agents", "steps", "rounds"), "what the radio models cost, in one process"),
    "bodies": (("agents", "steps", "rounds"), "what discs and quadcopters cost, in one process"),
    "coverage": (("rounds",), "how fast an order of the operator spreads, in one process"),
}
"""Modules of this package that have a function `measure`, with its arguments and what it measures."""


def parser() -> Parser:
    parser = Parser(
        prog="python -m benchmarks", description="Measure what a swarm costs on this machine; print the result as JSON."
    )
    measurements = parser.add_subparsers(dest="measurement", required=True, metavar="MEASUREMENT")
    for name, (options, summary) in MEASUREMENTS.items():
        command = measurements.add_parser(name, help=summary, description=f"Measure {summary}.")
        for option in options:
            command.add_argument(f"--{option}", metavar="N,N,..." if option == "sizes" else "N", **OPTIONS[option])
        command.set_defaults(func=measure)
    return parser


def measure(arguments: argparse.Namespace) -> int:
    options, _ = MEASUREMENTS[arguments.measurement]
    module = importlib.import_module(f"benchmarks.{arguments.measurement}")
    result = module.measure(*(getattr(arguments, option) for option in options))
    print(json.dumps(result, indent=2))
    return OK


def main(argv: Sequence[str] | None = None) -> int:
    """Do a measurement; return the exit code."""
    return carry_out(parser().parse_args(argv), "benchmarks")


if __name__ == "__main__":
    sys.exit(main())
