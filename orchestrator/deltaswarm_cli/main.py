"""The command `deltaswarm`. A command's module is imported only when the command is asked for."""

import argparse
import importlib
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Protocol

from deltaswarm.errors import Error, error_of, of_plugin, of_settings
from deltaswarm_orchestrator.base.exits import EXIT_CODES, FAILED, complain, show_notices
from deltaswarm_orchestrator.base.output import Output, OutputError, only_results, results, standard_output
from deltaswarm_orchestrator.base.signals import STOP_SIGNALS, raise_on_signals
from deltaswarm_wire import __version__
from deltaswarm_wire.arguments import Parser
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.files import Written
from deltaswarm_wire.foreign import called, name_of
from deltaswarm_wire.plugin_errors import PACKAGES, PluginError, defined_at
from deltaswarm_wire.plugins import COMMANDS as COMMAND_POINT
from deltaswarm_wire.plugins import PARTS, find

COMMANDS = {
    "run": "run a scenario with real processes",
    "sweep": "do many runs that differ in some keys, with their results in one table",
    "list": "list scenarios, sweeps, studies, controllers and bodies",
    "new": "make a folder for your own controller, with tests, a scenario and a study",
    "station": "open the operator's page of a run in progress",
    "replay": "replay a recorded run on the station's page",
    "info": "show a finished or interrupted run, from its folder",
    "top": "watch a run in progress in the terminal",
    "why": "explain how a run ended, or why one agent could not hear another at a given time",
    "export": "export a run's recording as tables, MCAP, ROS 2 bag, Rerun file or video",
    "doctor": "check whether this machine has what runs need",
    "completion": "print a script with which a shell completes commands and options",
}
"""The core's commands. Each is in the module of its name or of MODULES; `add_<command>` adds its arguments."""

MODULES = {
    **dict.fromkeys(("export", "info", "replay", "station", "top", "why"), "one_run"),
    **dict.fromkeys(("completion", "doctor", "list"), "installation"),
}


GROUPS = {
    "one run": ("run", "top", "station", "info", "why", "replay", "export"),
    "many runs": ("sweep", "study", "report"),
    "a run with a difference": ("branch", "value"),
    "participants": ("session", "serve", "verify"),
    "extensions": ("list", "new", "learn"),
    "boards": ("bundle", "certificates"),
    "this installation": ("doctor", "completion"),
    "parts by hand": ("agent", "world", "operator"),
}
"""How `--help` groups the commands; those of other packages follow."""


class _Grouped(argparse.RawDescriptionHelpFormatter):
    """Shows the commands under the titles of GROUPS."""

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        left = {choice.dest: choice for choice in action._choices_actions}
        groups = {title: [left.pop(name) for name in names if name in left] for title, names in GROUPS.items()}
        groups["other packages"] = list(left.values())
        lines = []
        for title, choices in groups.items():
            if choices:
                lines.append(f"\n  {title}:\n")
                self._indent()
                lines += [self._format_action(choice) for choice in choices]
                self._dedent()
        return "".join(lines).removeprefix("\n")


class AddArguments(Protocol):
    """What an entry point of a command names: adds its arguments, and sets these defaults.

    `func` takes the arguments and returns the exit code; `makes_files` says that the results are on disk, so that a
    failed standard output changes neither them nor the exit code; `handles_signals` that the command does so itself.
    The first line of the docstring is shown by `deltaswarm --help`.
    """

    def __call__(self, command: argparse.ArgumentParser) -> None: ...


def all_commands() -> list[str]:
    """Return the names of all commands: the core's, and those of extension packages."""
    return [*COMMANDS, *COMMAND_POINT.names()]


def parser(*complete: str, has_help: bool = True) -> argparse.ArgumentParser:
    """Return the parser of the command line: the names of all commands, and the arguments of those in `complete`.

    Without `has_help` the other commands of extensions have no summaries, for which their modules must be imported.
    """
    everything = Parser(
        prog="deltaswarm",
        description="A human-swarm testbed: agents as processes, coordination by messages,\nworkload measured.",
        epilog="\n".join(["exit codes:", *(f"  {code:<3}  {meaning}" for code, meaning in EXIT_CODES.items())]),
        formatter_class=_Grouped,
    )
    everything._positionals.title = "commands"
    everything.add_argument("--version", action="version", version=f"deltaswarm {__version__}")
    commands = everything.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, summary in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        if name in complete:
            module = importlib.import_module(f"deltaswarm_cli.{MODULES.get(name, name)}")
            getattr(module, f"add_{name}")(command)
    if not set(complete) <= {*COMMANDS, "--version"}:  # else there is no need to look through all packages
        for name, target in COMMAND_POINT.names().items():
            if name not in complete and not has_help:
                commands.add_parser(name)
                continue
            try:
                add: AddArguments = find(COMMAND_POINT, target, f"command {name}")
            except SettingsError:
                if name in complete:
                    raise
                continue  # a broken command of a plug-in breaks no other
            summary = (add.__doc__ or "").partition("\n")[0].removesuffix(".")
            command = commands.add_parser(name, help=summary[:1].lower() + summary[1:])
            if name in complete:
                called(name_of(add), add, command)
                if not callable(command.get_default("func")):
                    must = f"{name_of(add)} must set the default func, a function that does the command"
                    raise PluginError(f"{must} ({defined_at(add)})")
    for part in PARTS.shipped:
        commands.add_parser(part, help=f"run one {part} by hand (see: deltaswarm {part} --help)", add_help=False)
    return everything


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code."""
    output = standard_output()
    try:
        try:
            code = _run(list(sys.argv[1:] if argv is None else argv), output)
        finally:
            results().flush()
    except OutputError:
        code = FAILED
    if output and output.error and not output.error.is_unread:
        complain(str(output.error))
    return code


def _run(argv: list[str], output: Output | None) -> int:
    """Run one command, which may have an output of its own; return its exit code."""
    command = argv[0] if argv else ""
    if command in PARTS.shipped:
        raise_on_signals()
        name = " ".join(argv[:2])
        is_short = not argv[1:] or argv[1].startswith("-") or name not in PARTS.names()  # which looks through packages
        part, rest = (command, argv[1:]) if is_short else (name, argv[2:])
        return int(find(PARTS, part, "command")(rest))
    try:
        with only_results():  # plug-ins are imported
            everything = parser(command, has_help=command in ("-h", "--help"))
    except SettingsError as error:
        return _complain_of(of_settings(error))
    except PluginError as error:
        return _complain_of(of_plugin(error))
    arguments = everything.parse_args(argv)
    arguments.given = argv
    if not getattr(arguments, "handles_signals", False):
        raise_on_signals(STOP_SIGNALS)
    show_notices(not getattr(arguments, "quiet", False))
    if output and getattr(arguments, "makes_files", False) and not getattr(arguments, "dry_run", False):
        output.is_needed = False
    return carry_out(arguments, command)


def carry_out(arguments: argparse.Namespace, command: str) -> int:
    """Carry out a parsed command; say in a line what went wrong, and return the exit code."""
    Written.begin()
    is_plugin = arguments.func.__module__.partition(".")[0] not in PACKAGES
    try:
        with nullcontext() if is_plugin else only_results(to_the_end=True):
            code = arguments.func(arguments)
        if not isinstance(code, int):
            must = f"{name_of(arguments.func)} must return an exit code, 0 for success (got {code!r:.80})"
            raise PluginError(f"{must} ({defined_at(arguments.func)})")
        return int(code)
    except BaseException as error:
        if is_plugin and isinstance(error, SystemExit):
            raise
        is_the_users = is_plugin and isinstance(error, KeyboardInterrupt)
        if (told := error_of(KeyboardInterrupt() if is_the_users else error, command)) is None:
            raise
        return _complain_of(told)


def _complain_of(error: Error) -> int:
    for line in error.lines:
        complain(line)
    for trace in error.traces:
        print(trace, file=sys.stderr)
    return error.code
