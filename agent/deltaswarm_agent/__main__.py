"""`python -m deltaswarm_agent`: one agent in a world."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from deltaswarm_agent.controller import ControllerError
from deltaswarm_agent.io.process import AgentConfig, run_agent
from deltaswarm_wire import checked
from deltaswarm_wire.arguments import Parser, add_link_arguments, link_of, number, program, whole
from deltaswarm_wire.codec import MAX_STEP
from deltaswarm_wire.commands import BASE_ID
from deltaswarm_wire.keys import AGENT
from deltaswarm_wire.logs import log_to_standard_error
from deltaswarm_wire.plugin_errors import described
from deltaswarm_wire.plugins import controller_settings
from deltaswarm_wire.reading import read_toml
from deltaswarm_wire.settings import AgentSettings


def parser() -> argparse.ArgumentParser:
    name = program(AGENT)
    parser = Parser(
        prog=name,
        description="Run one agent in a world.",
        epilog=f"On a board with its own body: {name} board FILE (package deltaswarm_board); see its --help.",
    )
    parser.add_argument(
        "--id", type=whole(0, BASE_ID - 1), required=True, help=f"the agent's number, 0 to {BASE_ID - 1}"
    )
    parser.add_argument("--settings", type=Path, required=True, metavar="FILE", help="the agent's settings (TOML)")
    parser.add_argument("--low-latency", action="store_true", help="for agents on the world's own machine")
    parser.add_argument(
        "--restart", type=whole(0), default=0, metavar="N", help="earlier starts of the agent in this run"
    )
    parser.add_argument(
        "--world-lost-s", type=number(0.0), default=5.0, help="exit after this long without a world [s] (default: 5)"
    )
    parser.add_argument(
        "--checkpoints", type=Path, metavar="FOLDER", help="save the agent there at the world's request"
    )
    parser.add_argument(
        "--resume", type=whole(0, MAX_STEP), metavar="STEP", help="resume the agent saved after this step"
    )
    add_link_arguments(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one agent. Exit code: 0 after a complete run, 2 for bad arguments, else one of `deltaswarm_wire.child`."""
    arguments = parser().parse_args(argv)
    log_to_standard_error()
    try:
        if arguments.resume is not None and arguments.checkpoints is None:
            raise ValueError("--resume needs --checkpoints")
        config = AgentConfig(
            run=arguments.run,
            agent=arguments.id,
            link=link_of(arguments, AGENT, arguments.id, arguments.low_latency),
            settings=checked.load(AgentSettings, read_toml(arguments.settings)),
            restart=arguments.restart,
            world_lost_s=arguments.world_lost_s,
            checkpoints=arguments.checkpoints,
            resume_step=arguments.resume,
        )
        controller_settings(config.settings.control.mode, config.settings.control.options, config.settings)
    except (ValueError, OSError) as error:
        print(f"{program(AGENT)}: {error}", file=sys.stderr)
        return 2
    try:
        return run_agent(config)
    except ControllerError as error:
        logging.getLogger("deltaswarm.agent").critical("%s", error.report)
        return 1
    except Exception as error:
        logging.getLogger("deltaswarm.agent").critical("%s", described(error), exc_info=not isinstance(error, OSError))
        return 1


if __name__ == "__main__":
    sys.exit(main())
