"""The command `deltaswarm bench`."""

import argparse
import importlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base.disk import room_for
from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError
from deltaswarm_orchestrator.base.text import named
from deltaswarm_orchestrator.cli.arguments import add_json, number, show, whole


def _sizes(text: str) -> list[int]:
    return [whole(1)(part) for part in text.split(",")]


def _times(text: str) -> list[float]:
    return [number(0, 10_000)(part) for part in text.split(",")]


OPTIONS: dict[str, dict[str, Any]] = {
    "agents": {"type": whole(1), "default": 25, "metavar": "N", "help": "size of the swarm (default: 25)"},
    "sizes": {
        "type": _sizes,
        "default": "25,50,100,200,400,1000",
        "metavar": "N,N,...",
        "help": "sizes of the swarm (default: %(default)s)",
    },
    "steps": {
        "type": whole(1),
        "default": 1000,
        "metavar": "N",
        "help": "steps per measurement (default: %(default)s)",
    },
    "rounds": {"type": whole(1), "default": 3, "metavar": "N", "help": "measure this often (default: 3)"},
    "rtts": {
        "type": _times,
        "default": [0.0, 1.0, 5.0, 20.0],
        "metavar": "MS,MS,...",
        "help": "round-trip times to the agents' machines [ms] (default: 0,1,5,20)",
    },
    "plot": {"type": Path, "metavar": "NAME", "help": "draw NAME.png, NAME.svg and NAME.pdf"},
}


class Measurement(NamedTuple):
    """A module of `bench`: it has `measure`, perhaps `brief` to shorten the result, and `draw` if it takes `plot`."""

    module: str
    options: tuple[str, ...]
    """The arguments of `measure`, and `plot`."""
    help: str
    needs_processes: bool = False
    defaults: Mapping[str, object] = MappingProxyType({})
    """Defaults that differ from those of `OPTIONS`."""


MEASUREMENTS = {
    "run": Measurement(
        "speed",
        ("agents", "steps"),
        "Measure a run with real processes, beside the bare exchange of the same messages.",
        needs_processes=True,
    ),
    "scale": Measurement(
        "scale",
        ("sizes", "steps", "rounds", "plot"),
        "Measure how the cost of a step grows with the swarm, in one process.",
    ),
    "radio": Measurement(
        "radio_cost", ("agents", "steps", "rounds"), "Measure what the radio models cost, in one process."
    ),
    "coverage": Measurement(
        "coverage", ("rounds", "plot"), "Measure how fast a command of the operator spreads, in one process."
    ),
    "processes": Measurement(
        "processes",
        ("sizes", "steps"),
        "Measure start-up, memory, speed and open files of runs with more and more real processes.",
        needs_processes=True,
        defaults={"sizes": "25,100,400,1000", "steps": 100},
    ),
    "station": Measurement(
        "station_cost",
        ("agents", "steps", "rounds"),
        "Measure what the operator's station and its pages cost a run.",
        needs_processes=True,
    ),
    "link": Measurement(
        "link",
        ("agents", "steps", "rounds", "rtts"),
        "Measure how the speed depends on the round-trip time to agents on other machines.",
        needs_processes=True,
    ),
}


def add_bench(command: argparse.ArgumentParser) -> None:
    """Add the measurements, each with the options that it takes."""
    measurements = command.add_subparsers(dest="measurement", required=True, metavar="MEASUREMENT")
    for name, measurement in MEASUREMENTS.items():
        summary = measurement.help[0].lower() + measurement.help[1:].removesuffix(".")
        parser = measurements.add_parser(name, help=summary, description=measurement.help)
        for option in measurement.options:
            parser.add_argument(f"--{option}", **OPTIONS[option])
        parser.set_defaults(**measurement.defaults)
        add_json(parser)
    command.set_defaults(func=bench)


def bench(arguments: argparse.Namespace) -> int:
    """Do the measurements and print the results."""
    from deltaswarm_orchestrator.processes.starter import LaunchError

    measurement, plot = MEASUREMENTS[arguments.measurement], getattr(arguments, "plot", None)
    if plot is not None:
        _check_plot(plot)
    if measurement.needs_processes:
        from deltaswarm_orchestrator.bench.doctor import check_parts_can_start

        check_parts_can_start(max(getattr(arguments, "sizes", None) or [arguments.agents]))
    module = importlib.import_module(f"deltaswarm_orchestrator.bench.{measurement.module}")
    try:
        result = module.measure(*(getattr(arguments, option) for option in measurement.options if option != "plot"))
    except ValueError as error:
        raise CommandError(str(error)) from None
    except (LaunchError, ConnectionError) as error:
        raise CommandError(str(error), FAILED) from None
    brief = getattr(module, "brief", lambda everything: everything)
    show(arguments, result, named(brief(result)))
    if plot is not None:
        from deltaswarm_orchestrator.report.plots.style import save

        with room_for(plot):
            save(module.draw(result), plot)
    return OK


def _check_plot(path: Path) -> None:
    """Check before the measurement that its figure can be written afterwards.

    Raises:
        CommandError: it cannot.
    """
    from deltaswarm_orchestrator.report.plots.style import files_of

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
