"""`python -m deltaswarm_board FILE`: one agent on a board."""

import argparse
import logging
import os
import signal
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from deltaswarm_agent.__main__ import main as agent_in_world
from deltaswarm_agent.body import BodyContext
from deltaswarm_agent.io.process import AgentConfig, check_link, run_agent
from deltaswarm_board.bodies import find_body, make_body, options_of
from deltaswarm_board.driver import Follower
from deltaswarm_board.process import BoardRun, run_board
from deltaswarm_board.service import Notifier, block_signals, log_to, stand_on_signals
from deltaswarm_board.settings import WORLD_BODY, BoardSettings, read_settings
from deltaswarm_wire.arguments import Parser, number, program, whole
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.codec import MAX_STEP
from deltaswarm_wire.keys import AGENT
from deltaswarm_wire.logs import log_to_standard_error
from deltaswarm_wire.plugin_errors import PluginError, blamed


def parser() -> argparse.ArgumentParser:
    parser = Parser(prog=f"{program(AGENT)} board", description="Run one agent on a board.")
    parser.add_argument("file", type=Path, metavar="FILE", help="the board's settings (TOML)")
    parser.add_argument("--check", action="store_true", help="check the file, print what would be done, and exit")
    parser.add_argument(
        "--accelerate",
        type=number(1e-6, 10_000),
        default=1.0,
        metavar="N",
        help="simulated seconds per wall second (default: 1)",
    )
    parser.add_argument(
        "--steps",
        type=whole(1, MAX_STEP),
        default=MAX_STEP,
        metavar="N",
        help="exit after this many steps (default: never)",
    )
    return parser


def agent(argv: Sequence[str] | None = None) -> int:
    """Run an agent on a board with `board FILE`, else an agent in a world: the board's `deltaswarm-agent`."""
    argv = sys.argv[1:] if argv is None else argv
    return main(argv[1:]) if argv[:1] == ["board"] else agent_in_world(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a board. Exit code: 0 after a signal to stop, 2 for a bad file or arguments, else 1."""
    arguments = parser().parse_args(argv)
    log_to_standard_error()
    try:
        settings = read_settings(arguments.file)
        run = BoardRun(settings, arguments.accelerate, arguments.steps)
        if settings.body.kind == WORLD_BODY:
            if arguments.steps != MAX_STEP or arguments.accelerate != 1.0:
                raise ValueError("body.kind = world goes by the world's steps: leave out --steps and --accelerate")
            begin = partial(run_in_world, settings, follower_options(settings))
            check_link(world_config(settings))
        else:
            begin = partial(run_board, run, run.check())
        if arguments.check:
            check_certificate(settings)
            print(description(settings))
            return 0
    except (ValueError, OSError, PluginError) as error:
        print(f"{arguments.file}: {error}".replace("\n", f"\n{arguments.file}: "), file=sys.stderr)
        return 2
    warn_of_certificate(settings)
    try:
        return begin()
    except SettingsError as error:  # of a body that only then can tell
        logging.getLogger("deltaswarm.board").error("%s: %s", arguments.file, error)
        return 2
    except BaseException as error:
        if plugin := blamed(error):
            logging.getLogger("deltaswarm.board").error("agent %d fails: %s", settings.id, plugin.report)
            return 1
        if not isinstance(error, Exception):
            raise
        logging.getLogger("deltaswarm.board").exception("agent %d fails: %s", settings.id, error)
        return 1


def check_certificate(settings: BoardSettings) -> None:
    """Raise SettingsError if the other end of a link would refuse the certificate or it names another process."""
    from deltaswarm_wire.certificate import certificate_problem  # costs an agent 4 MB; only this check needs it

    tls = settings.air.tls.files
    if tls is not None and (text := certificate_problem(tls, settings.user)):
        raise SettingsError([Problem("air.tls.cert_file", repr(tls.certificate), f"must be valid: {text}")])


def warn_of_certificate(settings: BoardSettings) -> None:
    """Log what `check_certificate` finds, since the other end refuses silently.

    The agent continues, for only its clock may be wrong. A child process checks, so that its memory is freed.
    """
    if settings.air.tls.files is None:
        return
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            check_certificate(settings)
        except SettingsError as error:
            os.write(writing, str(error).encode())
        finally:
            os._exit(0)
    os.close(writing)
    with open(reading, encoding="utf-8") as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    if text:
        logging.getLogger("deltaswarm.board").warning("%s", text)


WORLD_LOST_S = 60.0
"""Time that a board without a link waits for the world before it exits, for systemd to restart it [s]."""


def world_config(settings: BoardSettings) -> AgentConfig:
    """Configure an agent with a body simulated by the world: the same process as in a simulation."""
    return AgentConfig(
        settings.run, settings.id, settings.air.link(settings.user), settings.agent, world_lost_s=WORLD_LOST_S
    )


def follower_options(settings: BoardSettings) -> Any:
    """Check the options of the robot that follows the simulated body; return None without one."""
    body = settings.body
    if not body.follower:
        return None
    return options_of(find_body(body.follower, "body.follower"), body.options)


def make_follower(settings: BoardSettings, options: Any) -> Follower | None:
    """Make the robot that follows the simulated body, if there is one."""
    if options is None:
        return None
    agent = settings.agent
    context = BodyContext(settings.id, agent, Random(f"deltaswarm/{agent.seed}/agent/{settings.id}/body"))
    body = make_body(find_body(settings.body.follower), options, context)
    return Follower(body, agent.step_s, settings.body.max_std_m)


def run_in_world(settings: BoardSettings, options: Any) -> int:
    """Run an agent of a world, with systemd's watchdog and the board's log; return the exit code.

    The world may pause indefinitely, so the watchdog reports that the process lives, not that it steps.
    """
    config = world_config(settings)
    log_to(settings.log, settings.id)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(
            signal.SIGINT, signal.SIG_DFL
        )  # Python's own handler would wait for Zenoh, which may hang on a dead link
    if options is not None:
        block_signals()  # before there are other threads
    notifier = Notifier.from_environment()
    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(notifier.alive_every_s):
            notifier.alive()

    if notifier.alive_every_s is not None:
        threading.Thread(target=tell, name="alive", daemon=True).start()
    follower = make_follower(settings, options)
    if follower:
        stand_on_signals(follower.close)
    try:
        if follower:
            return run_agent(config, notifier.ready, follower.follow, follower.close)
        return run_agent(config, notifier.ready)
    finally:
        ended.set()
        if follower:
            follower.close()
        notifier.stopping()
        notifier.close()


def description(settings: BoardSettings) -> str:
    air, body, log, agent = settings.air, settings.body, settings.log, settings.agent
    lines = [
        f"agent {settings.id} of run {settings.run}, {agent.control.mode}, a step every {agent.step_s:g} s",
        f"arena {agent.width_m:g} m x {agent.height_m:g} m, radio range {agent.range_m:g} m",
        f"air: {air.mode}"
        + "".join(f", connects to {endpoint}" for endpoint in air.connect)
        + "".join(f", listens on {endpoint}" for endpoint in air.listen)
        + (", multicast" if air.multicast else "")
        + (", gossip" if air.gossip else "")
        + (", mTLS" if air.tls.ca_file else "")
        + (f", only agents {air.agents}" if air.agents else "")
        + (f", logs in as {settings.user}" if air.credentials_file else "")
        + (f", drops frames from beyond {air.range_m:g} m" if air.range_m else ""),
        f"body: {body.kind}" + (f", followed by {body.follower}" if body.follower else ""),
    ]
    if body.kind != WORLD_BODY or body.follower:
        options = asdict(options_of(find_body(body.follower or body.kind), body.options))
        lines.append(f"its options: {', '.join(f'{name} = {value!r}' for name, value in options.items()) or 'none'}")
    where = f"{log.folder}, {log.backups + 1} files of {log.max_bytes} bytes" if log.folder else "standard error"
    lines.append(f"log: {where}" + (", and its frames as MCAP" if log.record != "off" else ""))
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
