"""`deltaswarm bench`."""

import argparse
import json
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.exits import FAILED, OK, USAGE, complain


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm bench`."""
    command.add_argument("--agents", type=int, default=25, metavar="N", help="size of the swarm (default: 25)")
    command.add_argument("--steps", type=int, default=1000, metavar="N", help="steps per measurement (default: 1000)")
    command.add_argument(
        "--scale", action="store_true", help="measure how the cost of a step grows with the swarm, in one process"
    )
    command.add_argument("--radio", action="store_true", help="measure what the radio models cost, in one process")
    command.add_argument("--sizes", type=_sizes, metavar="N,N,...", help="with --scale (default: 25,50,100,200,400)")
    command.add_argument("--rounds", type=int, default=3, metavar="N", help="with --scale or --radio (default: 3)")
    command.add_argument("--plot", type=Path, metavar="NAME", help="with --scale: draw NAME.png and NAME.svg")
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(func=bench)


def _sizes(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: numbers with commas between them are expected") from None


def bench(arguments: argparse.Namespace) -> int:
    """Measure, and print what was measured."""
    from deltaswarm_orchestrator.bench.doctor import can_start_parts

    if not (arguments.scale or arguments.radio or can_start_parts()):
        return FAILED
    try:
        found, text = _measured(arguments)
    except ValueError as error:
        complain(str(error))
        return USAGE
    print(json.dumps(found) if arguments.json else text)
    return OK


def _measured(arguments: argparse.Namespace) -> tuple[dict[str, Any], str]:
    from deltaswarm_orchestrator.bench import bench, radio_cost, scale

    if arguments.radio:
        found = radio_cost.measure_radio(arguments.agents, arguments.steps, arguments.rounds)
        return found, radio_cost.text(found)
    if not arguments.scale:
        found = bench.measure(arguments.agents, arguments.steps)
        return found, bench.text(found)
    found = scale.measure_scale(arguments.sizes or scale.SIZES, arguments.steps, arguments.rounds)
    if arguments.plot:
        from deltaswarm_orchestrator.report.plots.scale import scale as drawn
        from deltaswarm_orchestrator.report.plots.style import save

        save(drawn([{**row, "rss_mb": row["peak_memory_mb"]} for row in found["sizes"]]), arguments.plot)
    return found, scale.text(found)
