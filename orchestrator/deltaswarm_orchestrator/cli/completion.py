"""The command `deltaswarm completion`."""

import argparse
from pathlib import Path

from deltaswarm_orchestrator.base.exits import OK

SHELLS = ("bash", "zsh", "tcsh")

EXAMPLES = """\
examples:
  source <(deltaswarm completion bash)
  deltaswarm completion zsh > ~/.zfunc/_deltaswarm
"""


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm completion`."""
    command.description = "Print a script with which a shell completes commands, options and file names."
    command.epilog, command.formatter_class = EXAMPLES, argparse.RawDescriptionHelpFormatter
    command.add_argument("shell", choices=SHELLS, help="the shell that the script is for")
    command.set_defaults(func=completion)


def completion(arguments: argparse.Namespace) -> int:
    """Print the script, which is made from the parsers of all commands."""
    import shtab

    from deltaswarm_orchestrator.cli import COMMANDS, parser

    made = parser(*COMMANDS)
    _complete_files(made, shtab.FILE)
    print(shtab.complete(made, shell=arguments.shell))
    return OK


def _complete_files(parser: argparse.ArgumentParser, files: object) -> None:
    """Let arguments that are paths be completed with the names of files, in subcommands too."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for own in action.choices.values():
                _complete_files(own, files)
        elif action.type is Path or "FILE" in str(action.metavar):
            action.complete = files  # type: ignore[attr-defined]
