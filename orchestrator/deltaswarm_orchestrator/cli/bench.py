"""The command `deltaswarm bench`."""

import argparse
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import OK, CommandError
from deltaswarm_orchestrator.base.text import named
from deltaswarm_orchestrator.cli.arguments import add_json, show, whole


def _sizes(text: str) -> list[int]:
    return [whole(1)(part) for part in text.split(",")]


OPTIONS: dict[str, dict[str, Any]] = {
    "--agents": {"type": whole(1), "default": 25, "metavar": "N", "help": "size of the swarm (default: 25)"},
    "--sizes": {"type": _sizes, "metavar": "N,N,...", "help": "sizes of the swarm (default: 25,50,100,200,400)"},
    "--steps": {"type": whole(1), "default": 1000, "metavar": "N", "help": "steps per measurement (default: 1000)"},
    "--rounds": {"type": whole(1), "default": 3, "metavar": "N", "help": "measure this often (default: 3)"},
    "--plot": {"type": Path, "metavar": "NAME", "help": "draw NAME.png, NAME.svg and NAME.pdf"},
}


def add(command: argparse.ArgumentParser) -> None:
    """Add the measurements, each with the options that it takes."""
    measurements = command.add_subparsers(dest="measurement", required=True, metavar="MEASUREMENT")
    for name, (measured, options) in MEASUREMENTS.items():
        summary = (measured.__doc__ or "").removesuffix(".")
        own = measurements.add_parser(name, help=summary[0].lower() + summary[1:], description=measured.__doc__)
        for option in options:
            own.add_argument(option, **OPTIONS[option])
        add_json(own)
    command.set_defaults(func=bench)


def bench(arguments: argparse.Namespace) -> int:
    """Do the measurements and print the results."""
    from deltaswarm_orchestrator.bench.doctor import check_parts_can_start

    if arguments.measurement in WITH_PROCESSES:
        check_parts_can_start()
    measured, _ = MEASUREMENTS[arguments.measurement]
    try:
        found = measured(arguments)
    except ValueError as error:
        raise CommandError(str(error)) from None
    show(arguments, found, named(found))
    return OK


def _run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure a run with real processes, beside the bare exchange of the same messages."""
    from deltaswarm_orchestrator.bench import speed

    return speed.measure(arguments.agents, arguments.steps)


def _scale(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure how the cost of a step grows with the swarm, in one process."""
    from deltaswarm_orchestrator.bench import scale

    found = scale.measure_scale(arguments.sizes or scale.SIZES, arguments.steps, arguments.rounds)
    if arguments.plot:
        from deltaswarm_orchestrator.report.plots.scale import scale as drawn
        from deltaswarm_orchestrator.report.plots.style import save

        save(drawn(found["sizes"]), arguments.plot)
    return found


def _radio(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure what the radio models cost, in one process."""
    from deltaswarm_orchestrator.bench import radio_cost

    return radio_cost.measure_radio(arguments.agents, arguments.steps, arguments.rounds)


def _coverage(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure how fast a command of the operator spreads, in one process."""
    from deltaswarm_orchestrator.bench.coverage import measure_coverage

    found = measure_coverage(arguments.rounds)
    if arguments.plot:
        from deltaswarm_orchestrator.report.plots.coverage import coverage
        from deltaswarm_orchestrator.report.plots.style import save

        save(coverage(found), arguments.plot)
    if arguments.json:
        return found
    for row in found["rows"]:  # as text, the time until half and nine tenths of the agents know it
        shares = row.pop("share_known")
        for share in (0.5, 0.9):
            reached = (step * found["step_s"] for step, known in enumerate(shares) if known >= share)
            row[f"{share:.0%}_know_after_s"] = next(reached, None)
        row["known_at_end"] = shares[-1]
    return found


def _station(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure what the operator's station and its pages cost a run."""
    from deltaswarm_orchestrator.bench.station_cost import measure_station

    return measure_station(arguments.agents, arguments.steps, arguments.rounds)


MEASUREMENTS = {
    "run": (_run, ("--agents", "--steps")),
    "scale": (_scale, ("--sizes", "--steps", "--rounds", "--plot")),
    "radio": (_radio, ("--agents", "--steps", "--rounds")),
    "coverage": (_coverage, ("--rounds", "--plot")),
    "station": (_station, ("--agents", "--steps", "--rounds")),
}
"""Each measurement, described by its docstring, and the options that it takes."""

WITH_PROCESSES = ("run", "station")
