"""Commands about this installation: `completion`, `doctor` and `list`."""

import argparse
from collections.abc import Mapping
from dataclasses import asdict
from importlib.resources.abc import Traversable
from itertools import takewhile
from pathlib import Path

from deltaswarm_cli.arguments import add_json, show
from deltaswarm_orchestrator.base.exits import FAILED, OK, aligned
from deltaswarm_orchestrator.base.output import print_result
from deltaswarm_orchestrator.scenarios import BUILT_IN, DEFAULT_SCENARIO

SHELLS = ("bash", "zsh", "tcsh")

EXAMPLES = """\
examples:
  source <(deltaswarm completion bash)
  deltaswarm completion zsh > ~/.zfunc/_deltaswarm
"""


def add_completion(command: argparse.ArgumentParser) -> None:
    command.description = "Print a script with which a shell completes commands, options and file names."
    command.epilog, command.formatter_class = EXAMPLES, argparse.RawDescriptionHelpFormatter
    command.add_argument("shell", choices=SHELLS, help="the shell that the script is for")
    command.set_defaults(func=completion)


def completion(arguments: argparse.Namespace) -> int:
    """Print the script, which is made from the parsers of all commands."""
    import shtab

    from deltaswarm_cli.main import all_commands, parser

    everything = parser(*all_commands())
    _complete_files(everything, shtab.FILE)
    print_result(shtab.complete(everything, shell=arguments.shell))
    return OK


def _complete_files(parser: argparse.ArgumentParser, files: object) -> None:
    """Let arguments that are paths be completed with the names of files, in subcommands too."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for subparser in action.choices.values():
                _complete_files(subparser, files)
        elif action.type is Path or "FILE" in str(action.metavar):
            action.complete = files  # type: ignore[attr-defined]


def add_doctor(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "scenario",
        nargs="?",
        default=DEFAULT_SCENARIO,
        metavar="SCENARIO",
        help=f"the run that this machine should be able to do (default: {DEFAULT_SCENARIO})",
    )
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any scenario key, dotted")
    add_json(command, "the diagnoses")
    command.set_defaults(func=doctor)


def doctor(arguments: argparse.Namespace) -> int:
    """Examine this machine; fail if anything that a run needs is missing."""
    from deltaswarm_orchestrator import doctor
    from deltaswarm_orchestrator.scenarios.load import load_scenario

    diagnoses = doctor.examine(load_scenario(arguments.scenario, arguments.set).agents.count)
    rows = [
        ("ok", diagnosis.name, diagnosis.found)
        if diagnosis.is_well
        else ("MISSING", diagnosis.name, f"{diagnosis.found}  ->  {diagnosis.advice}")
        for diagnosis in diagnoses
    ]
    show(arguments, [asdict(diagnosis) for diagnosis in diagnoses], aligned(rows))
    return OK if all(diagnosis.is_well for diagnosis in diagnoses) else FAILED


def add_list(command: argparse.ArgumentParser) -> None:
    command.description = "List what comes with deltaswarm and what other installed packages add to it."
    add_json(command, "the lists")
    command.set_defaults(func=list_all)


def list_all(arguments: argparse.Namespace) -> int:
    lists = known()
    texts = (f"{kind}:\n{aligned(('', *pair) for pair in names.items())}" for kind, names in lists.items())
    show(arguments, lists, "\n".join(texts))
    return OK


def _first_sentence(text: str) -> str:
    """Return the first lines of a file's comment, up to one that ends with a full stop."""
    lines = []
    for line in takewhile(lambda line: line.startswith("# "), text.splitlines()):
        lines.append(line.removeprefix("# "))
        if line.endswith("."):
            break
    return " ".join(lines)


def known() -> dict[str, dict[str, str]]:
    """Return every name that a command or a settings file may use, by kind, with a line about it."""
    from deltaswarm_orchestrator.sweeps.load import built_in
    from deltaswarm_wire.commands import forms_of
    from deltaswarm_wire.plugins import BODIES, CONTROLLERS, DYNAMICS, FAULTS, RADIO_MODELS, find_controller

    def about(files: Mapping[str, Traversable]) -> dict[str, str]:
        return {name: _first_sentence(file.read_text(encoding="utf-8")) for name, file in files.items()}

    return {
        "scenarios": about(BUILT_IN),
        **{kind: about(files) for kind, files in built_in().items()},
        "controllers": CONTROLLERS.names(),
        "commands": {form.name: form.help for mode in CONTROLLERS.shipped for form in forms_of(find_controller(mode))},
        "bodies": BODIES.names(),
        "dynamics": DYNAMICS.names(),
        "radio models": RADIO_MODELS.names(),
        "faults": FAULTS.names(),
    }
