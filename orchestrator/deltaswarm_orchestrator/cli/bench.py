"""The command `deltaswarm bench`."""

import argparse
import json
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError
from deltaswarm_orchestrator.base.text import named
from deltaswarm_orchestrator.cli.arguments import whole


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm bench`."""
    count = whole(1)
    command.add_argument("--agents", type=count, default=25, metavar="N", help="size of the swarm (default: 25)")
    command.add_argument("--steps", type=count, default=1000, metavar="N", help="steps per measurement (default: 1000)")
    command.add_argument(
        "--scale", action="store_true", help="measure how the cost of a step grows with the swarm, in one process"
    )
    command.add_argument("--radio", action="store_true", help="measure what the radio models cost, in one process")
    command.add_argument(
        "--sizes",
        type=lambda text: [count(part) for part in text.split(",")],
        metavar="N,N,...",
        help="with --scale (default: 25,50,100,200,400)",
    )
    command.add_argument(
        "--coverage", action="store_true", help="measure how fast a command of the operator spreads, in one process"
    )
    command.add_argument(
        "--station", action="store_true", help="measure what the operator's station and its pages cost a run"
    )
    command.add_argument("--rounds", type=count, default=3, metavar="N", help="with one of the four above (default: 3)")
    command.add_argument(
        "--plot", type=Path, metavar="NAME", help="with --scale or --coverage: draw NAME.png, NAME.svg and NAME.pdf"
    )
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(func=bench)


def bench(arguments: argparse.Namespace) -> int:
    """Do the measurements and print the results."""
    from deltaswarm_orchestrator.bench.doctor import can_start_parts

    if not (arguments.scale or arguments.radio or arguments.coverage or can_start_parts()):
        return FAILED
    try:
        found = _measured(arguments)
    except ValueError as error:
        raise CommandError(str(error)) from None
    print(json.dumps(found) if arguments.json else named(found))
    return OK


def _measured(arguments: argparse.Namespace) -> dict[str, Any]:
    from deltaswarm_orchestrator.bench import radio_cost, scale, speed

    if arguments.coverage:
        return _coverage(arguments)
    if arguments.station:
        from deltaswarm_orchestrator.bench.station_cost import measure_station

        return measure_station(arguments.agents, arguments.steps, arguments.rounds)
    if arguments.radio:
        return radio_cost.measure_radio(arguments.agents, arguments.steps, arguments.rounds)
    if not arguments.scale:
        return speed.measure(arguments.agents, arguments.steps)
    found = scale.measure_scale(arguments.sizes or scale.SIZES, arguments.steps, arguments.rounds)
    if arguments.plot:
        from deltaswarm_orchestrator.report.plots.scale import scale as drawn
        from deltaswarm_orchestrator.report.plots.style import save

        save(drawn(found["sizes"]), arguments.plot)
    return found


def _coverage(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure how a command spreads; as text, the time until half and nine tenths of the agents know it."""
    from deltaswarm_orchestrator.bench.coverage import measure_coverage

    found = measure_coverage(arguments.rounds)
    if arguments.plot:
        from deltaswarm_orchestrator.report.plots.coverage import coverage
        from deltaswarm_orchestrator.report.plots.style import save

        save(coverage(found), arguments.plot)
    if arguments.json:
        return found
    for row in found["rows"]:
        shares = row.pop("share_known")
        for share in (0.5, 0.9):
            reached = (step * found["step_s"] for step, known in enumerate(shares) if known >= share)
            row[f"{share:.0%}_know_after_s"] = next(reached, None)
        row["known_at_end"] = shares[-1]
    return found
