"""The command `deltaswarm bench`."""

import argparse
import importlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError, named
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.cli.arguments import add_json, show
from deltaswarm_wire.arguments import number, whole


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
    """A module that has `measure`, perhaps `brief` to shorten the result, and `save` if it takes `plot`."""

    module: str
    options: tuple[str, ...]
    """The arguments of `measure`, and `plot`."""
    help: str
    needs_processes: bool = False
    defaults: Mapping[str, object] = MappingProxyType({})
    """Defaults that differ from those of `OPTIONS`."""


MEASUREMENTS = {
    "run": Measurement(
        "deltaswarm_orchestrator.bench.speed",
        ("agents", "steps"),
        "Measure a run with real processes, beside the bare exchange of the same messages.",
        needs_processes=True,
    ),
}
"""The measurement of every installation; those of this project's developers are in the clone's `benchmarks`."""


def add_bench(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm bench`."""
    add_measurements(command, MEASUREMENTS)


def add_measurements(command: argparse.ArgumentParser, table: Mapping[str, Measurement]) -> None:
    """Add the measurements, each with the options that it takes."""
    measurements = command.add_subparsers(dest="measurement", required=True, metavar="MEASUREMENT")
    for name, measurement in table.items():
        summary = measurement.help[0].lower() + measurement.help[1:].removesuffix(".")
        parser = measurements.add_parser(name, help=summary, description=measurement.help)
        for option in measurement.options:
            parser.add_argument(f"--{option}", **OPTIONS[option])
        parser.set_defaults(**measurement.defaults, func=partial(bench, measurement))
        add_json(parser)


def bench(measurement: Measurement, arguments: argparse.Namespace) -> int:
    """Do the measurements and print the results."""
    from deltaswarm_orchestrator.processes.starter import LaunchError

    if measurement.needs_processes:
        from deltaswarm_orchestrator.doctor import check_parts_can_start

        check_parts_can_start(max(getattr(arguments, "sizes", None) or [arguments.agents]))
    if plot := getattr(arguments, "plot", None):
        check_out(plot.parent, "--plot", is_ours=False)
    module = importlib.import_module(measurement.module)
    try:
        result = module.measure(*(getattr(arguments, option) for option in measurement.options if option != "plot"))
    except ValueError as error:
        raise CommandError(str(error)) from None
    except (LaunchError, ConnectionError) as error:
        raise CommandError(str(error), FAILED) from None
    brief = getattr(module, "brief", lambda everything: everything)
    show(arguments, result, named(brief(result)))
    if plot:
        module.save(result, plot)
    return OK
