"""Commands about one run: `export`, `info`, `replay`, `station`, `top` and `why`."""

import argparse
import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from deltaswarm_cli.arguments import A_RUN, add_json, add_quiet, host_and_port, show
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError, complain, notice
from deltaswarm_orchestrator.base.output import print_result
from deltaswarm_orchestrator.base.paths import check_ports, must_exist, part_of
from deltaswarm_orchestrator.base.signals import stoppable
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_wire.arguments import number, whole
from deltaswarm_wire.commands import BASE_ID
from deltaswarm_wire.keys import OPERATOR

FORMATS = ("csv", "mcap", "rosbag2", "rrd", "mp4")
"""The formats of `export.formats`, which is slow to import."""


def add_export(command: argparse.ArgumentParser) -> None:
    command.description = "Exports the recording of a run, also of one that was cut off. See docs/RECORDING.md."
    command.add_argument("run", type=Path, metavar="RUN", help="a run's folder, or an MCAP recording")
    command.add_argument("--format", choices=FORMATS, required=True, help="tables, MCAP, ROS 2 bag, Rerun, or video")
    command.add_argument("--out", type=Path, help="file or folder to write (default: beside the run)")
    command.add_argument("--force", action="store_true", help="replace an earlier export")
    command.add_argument(
        "--longest-s",
        type=number(0.0),
        metavar="S",
        help="with mp4: leave out views to make the video at most this long; 0: show all of them (default: 30)",
    )
    add_quiet(command)
    add_json(command)
    command.set_defaults(func=export, makes_files=True)


def export(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator.export import formats

    must_exist(arguments.run, "RUN", f"{A_RUN}, or an MCAP recording")
    options = {} if arguments.longest_s is None else {"longest_s": arguments.longest_s}
    if options and arguments.format != "mp4":
        raise CommandError("--longest-s needs --format mp4")
    out = arguments.out or formats.default_out(arguments.run, arguments.format)
    exported = formats.export(arguments.run, arguments.format, out, force=arguments.force, **options)
    if exported.note:
        notice(exported.note)
    if not exported.is_complete:
        notice(f"the recording of {arguments.run} is incomplete; what it holds is exported")
    show(arguments, {"out": str(out), "complete": exported.is_complete}, str(out))
    return OK


def add_info(command: argparse.ArgumentParser) -> None:
    command.add_argument("folder", type=Path, metavar="RUN")
    add_json(command)
    command.set_defaults(func=info)


def info(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator.inspect import info

    must_exist(arguments.folder, "RUN", A_RUN)
    for file in info.finish_recordings(arguments.folder):
        notice(f"{file} was cut off; it has its end now, and every MCAP reader opens it")
    description = info.describe(arguments.folder)
    show(arguments, description, info.text(description))
    return OK


def add_replay(command: argparse.ArgumentParser) -> None:
    command.add_argument("run", type=Path, metavar="RUN", help="the folder of a run, finished or not, with a recording")
    command.add_argument(
        "--listen",
        type=host_and_port,
        default="127.0.0.1:0",
        metavar="HOST:PORT",
        help="where the page is served (default: any free port)",
    )
    command.set_defaults(func=replay)


def replay(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator.processes.pages import serve_page
    from deltaswarm_orchestrator.processes.starter import REPLAY, LaunchError, StoppedError
    from deltaswarm_orchestrator.processes.station import StationChannel
    from deltaswarm_orchestrator.recording.reader import RecordingError
    from deltaswarm_orchestrator.recording.replay import worth_of, write_steps

    def show_url(url: str) -> None:
        print_result(url)

    must_exist(arguments.run, "RUN", A_RUN)
    if not arguments.run.is_dir():
        raise CommandError(f"RUN must be {A_RUN} (got the file {arguments.run})")
    check_ports({"--listen": f"tcp/{arguments.listen}"})
    _notice_unsealed(arguments.run)
    with TemporaryFolder() as folder:
        steps = folder / "steps.msgpack"
        try:
            write_steps(arguments.run, steps)
        except (RecordingError, OSError) as error:
            raise CommandError(f"{arguments.run}: {error}") from None
        page = StationChannel(listen=arguments.listen)
        options = {"--steps": steps, "--run": arguments.run.name, "--worth": worth_of(arguments.run)}
        with stoppable() as stop, suppress(StoppedError):
            try:
                serve_page(REPLAY, options, folder / "logs", page, show_url, was_stopped=lambda: stop.by)
            except LaunchError as error:
                raise CommandError(str(error), FAILED) from None
            finally:
                stop.conclude()
    return OK


def _notice_unsealed(run: Path) -> None:
    """Say which files of a run nothing vouches for: those of a killed run, and of runs before there were seals."""
    from deltaswarm_orchestrator.base import seal
    from deltaswarm_orchestrator.results.folder import results_in

    if unsealed := seal.not_sealed(seal.read_sealed(run / seal.MANIFEST), results_in(run)):
        notice(f"{run}: not sealed, so nobody can tell whether they were changed: {', '.join(unsealed)}")


def add_station(command: argparse.ArgumentParser) -> None:
    command.add_argument("run", type=Path, metavar="RUN", help="the folder of a run that was started with --station")
    add_json(command)
    command.set_defaults(func=station)


def station(arguments: argparse.Namespace) -> int:
    """Print the address of the station's page of a run in progress, and open it in a browser if there is one."""
    from deltaswarm_orchestrator.processes.station import address, open_browser

    run: Path = arguments.run
    must_exist(run, "RUN", A_RUN, or_part=True)
    run = run.resolve()
    url = address(run if run.suffix == ".part" else part_of(run))
    if url is None:
        raise CommandError(
            f"{run}: no run with a station is under way there; see: {command_line('replay', run)}", FAILED
        )
    show(arguments, {"url": url}, url)
    open_browser(url)
    return OK


def add_top(command: argparse.ArgumentParser) -> None:
    command.description = (
        "Shows a run under way on the terminal: map, message rate, agents and events. Attach and leave as often as you "
        "like; the run does not notice. Shows the truth, which no operator knows. See docs/LIVE.md."
    )
    command.add_argument(
        "run", nargs="?", type=Path, metavar="RUN", help="a run's folder (default: the newest run under way from here)"
    )
    add_json(command, "one picture of the run")
    command.set_defaults(func=top)


def top(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator.top.link import linked

    if not arguments.json and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise CommandError("top needs a terminal; with --json it prints one picture of the run")
    if arguments.run is not None:
        must_exist(arguments.run, "RUN", A_RUN, or_part=True)
    if not arguments.json:
        from deltaswarm_orchestrator.top.app import Top
    link = linked(arguments.run, Path())
    if not arguments.json:
        Top(link).run()
        return OK
    if not link.wait():
        raise CommandError(f"{link.folder} showed nothing: it has just ended, or hangs", FAILED)
    print_result(link.as_json())
    return OK


def add_why(command: argparse.ArgumentParser) -> None:
    command.description = (
        "Says how a run ended, what failed in it in which order, and why it is not valid. With A, B and --at: repeats "
        "the run in one process up to a time, and says whether B could hear A then."
    )
    command.add_argument("folder", type=Path, metavar="RUN")
    command.add_argument("sender", nargs="?", type=whole(0, BASE_ID - 1), metavar="A", help="the agent that sends")
    command.add_argument("receiver", nargs="?", type=_receiver, metavar="B", help="the receiving agent, or 'operator'")
    command.add_argument("--at", type=number(0.0), metavar="T", help="time in the run [s]")
    add_json(command)
    command.set_defaults(func=why)


def _receiver(text: str) -> int | str:
    try:
        return text if text == OPERATOR else whole(0, BASE_ID - 1)(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"must be an agent's number or {OPERATOR!r} (got {text!r:.80})") from None


def why(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator.base import inputs, seal
    from deltaswarm_orchestrator.inspect import info, link_report
    from deltaswarm_orchestrator.recording import SCENARIO
    from deltaswarm_orchestrator.scenarios.load import load_scenario

    must_exist(arguments.folder, "RUN", A_RUN)
    asked = {"A": arguments.sender, "B": arguments.receiver, "--at": arguments.at}
    lacking = [name for name, value in asked.items() if value is None]
    if len(lacking) == len(asked):
        ending = info.how_it_ended(arguments.folder)
        show(arguments, ending, info.ending_text(ending))
        return OK
    if lacking:
        raise CommandError(f"why must be given A, B and --at to explain a link (missing: {', '.join(lacking)})")
    answer = link_report.why(arguments.folder, arguments.sender, arguments.receiver, arguments.at)
    _notice_unsealed(arguments.folder)
    show(arguments, asdict(answer), link_report.text(answer))
    if answer.differs_from_step is not None:
        manifest = seal.read_sealed(arguments.folder / seal.MANIFEST)
        because = inputs.why_other(manifest, load_scenario(str(arguments.folder / SCENARIO)))
        complain(f"the repetition differs from the run from step {answer.differs_from_step} on ({because})")
        return FAILED
    return OK
