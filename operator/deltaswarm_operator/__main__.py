"""`python -m deltaswarm_operator`: the operator of one run, on this machine or on another."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from deltaswarm_operator.process import OperatorConfig, run_operator
from deltaswarm_wire import checked
from deltaswarm_wire.arguments import LOG_FORMAT, add_link_arguments, link_of
from deltaswarm_wire.keys import OPERATOR
from deltaswarm_wire.settings import OperatorSettings, RunSettings


def parser() -> argparse.ArgumentParser:
    """The command line of the operator."""
    made = argparse.ArgumentParser(prog="deltaswarm operator", description="Run the operator.")
    made.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="for operator.csv and operator.json")
    made.add_argument("--step-s", type=float, default=1.0, help="length of the world's steps [s] (default: 1)")
    made.add_argument(
        "--threshold-hz", type=float, default=5.0, help="count the time above this message rate (default: 5)"
    )
    made.add_argument(
        "--publish-all", action="store_true", help="publish the workload of every step; wait for a recorder to listen"
    )
    made.add_argument(
        "--uplink",
        action="store_true",
        help="for a scenario with [uplink]: hear the reports that its model lets through",
    )
    made.add_argument("--low-latency", action="store_true", help="for an operator on the world's own machine")
    add_link_arguments(made)
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the operator; its exit code is 0 after a whole run, 2 for bad arguments, else 1."""
    arguments = parser().parse_args(argv)
    logging.basicConfig(level=logging.INFO, format=LOG_FORMAT)
    try:
        config = OperatorConfig(
            run=arguments.run,
            link=link_of(arguments, OPERATOR, low_latency=arguments.low_latency),
            settings=checked.load(OperatorSettings, {"threshold_hz": arguments.threshold_hz}, "operator"),
            step_s=checked.load(RunSettings, {"step_s": arguments.step_s}, "run").step_s,
            out=arguments.out,
            uplink=arguments.uplink,
            publish_all=arguments.publish_all,
        )
        if (config.out / "operator.csv").exists():
            raise FileExistsError(f"--out {config.out}: operator.csv is there already, and nothing is overwritten")
    except (ValueError, OSError) as error:
        print(f"deltaswarm operator: {error}", file=sys.stderr)
        return 2
    try:
        return run_operator(config)
    except Exception as error:
        logging.getLogger("deltaswarm.operator").exception("the operator fails: %s", error)
        return 1


if __name__ == "__main__":
    sys.exit(main())
