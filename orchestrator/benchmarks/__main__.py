"""`python -m benchmarks`: the developers' measurements, from a clone that is installed with `pip install -e`."""

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.signals import STOP_SIGNALS, raise_on_signals
from deltaswarm_orchestrator.cli import carry_out
from deltaswarm_orchestrator.cli.bench import Measurement, add_measurements
from deltaswarm_wire.arguments import Parser

MEASUREMENTS = {
    "scale": Measurement(
        "benchmarks.scale",
        ("sizes", "steps", "rounds", "plot"),
        "Measure how the cost of a step grows with the swarm, in one process.",
    ),
    "radio": Measurement(
        "benchmarks.radio_cost", ("agents", "steps", "rounds"), "Measure what the radio models cost, in one process."
    ),
    "coverage": Measurement(
        "benchmarks.coverage", ("rounds", "plot"), "Measure how fast a command of the operator spreads, in one process."
    ),
    "processes": Measurement(
        "benchmarks.processes",
        ("sizes", "steps"),
        "Measure start-up, memory, speed and open files of runs with more and more real processes.",
        needs_processes=True,
        defaults={"sizes": "25,100,400,1000", "steps": 100},
    ),
    "station": Measurement(
        "benchmarks.station_cost",
        ("agents", "steps", "rounds"),
        "Measure what the operator's station and its pages cost a run.",
        needs_processes=True,
    ),
    "link": Measurement(
        "benchmarks.link",
        ("agents", "steps", "rounds", "rtts"),
        "Measure how the speed depends on the round-trip time to agents on other machines.",
        needs_processes=True,
    ),
}


def parser() -> Parser:
    """The command line of all measurements."""
    parser = Parser(prog="python -m benchmarks", description="Measure what a swarm costs on this machine.")
    add_measurements(parser, MEASUREMENTS)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Do a measurement; return the exit code."""
    arguments = parser().parse_args(argv)
    raise_on_signals(STOP_SIGNALS)
    arguments.func = partial(_checked, arguments.func)
    return carry_out(arguments, "bench")


def _checked(measure: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    if getattr(arguments, "plot", None) is not None:
        _check_plot(arguments.plot)
    return measure(arguments)


def _check_plot(path: Path) -> None:
    """Check before the measurement that its figure can be written afterwards.

    Raises:
        CommandError: it cannot.
    """
    from deltaswarm_studies.style import files_of

    try:
        for file in files_of(path):
            is_new = not file.exists()
            file.open("ab").close()
            if is_new:
                file.unlink()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise CommandError(
            f"--plot must be a name with which files can be written (got {str(path)!r}; {why})"
        ) from None


if __name__ == "__main__":
    sys.exit(main())
