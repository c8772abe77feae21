"""The command `deltaswarm list`."""

import argparse
from importlib.metadata import entry_points

from deltaswarm_orchestrator.base.exits import OK
from deltaswarm_orchestrator.base.text import aligned
from deltaswarm_orchestrator.cli.arguments import add_json, show


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm list`."""
    command.description = "List what comes with deltaswarm and what other installed packages add to it."
    add_json(command, "the lists")
    command.set_defaults(func=list_all)


def list_all(arguments: argparse.Namespace) -> int:
    """Print the names of scenarios, sweeps, studies, controllers, commands and bodies, each with a short text."""
    found = known()
    texts = (f"{kind}:\n{aligned(('', *pair) for pair in names.items())}" for kind, names in found.items())
    show(arguments, found, "\n".join(texts))
    return OK


def known() -> dict[str, dict[str, str]]:
    """Return every name that a command or a settings file may use, by kind, with a line about it."""
    from deltaswarm_orchestrator.scenarios.load import files_in
    from deltaswarm_orchestrator.sweeps.load import STUDY_FOLDERS
    from deltaswarm_wire.commands import forms_of
    from deltaswarm_wire.plugins import BODIES, BODY_GROUP, CONTROLLER_GROUP, CONTROLLERS, find_controller

    def about(*folders: str) -> dict[str, str]:
        texts = {name: file.read_text() for name, file in files_in(*folders).items()}
        return {name: text.partition("\n")[0].removeprefix("# ") for name, text in texts.items()}

    def plugins(shipped: dict[str, str], group: str) -> dict[str, str]:
        return {**shipped, **{point.name: point.value for point in entry_points(group=group)}}

    return {
        "scenarios": about("scenarios"),
        "sweeps": about("sweeps/built_in"),
        "studies": about(*STUDY_FOLDERS),
        "controllers": plugins(CONTROLLERS, CONTROLLER_GROUP),
        "commands": {form.name: form.help for mode in CONTROLLERS for form in forms_of(find_controller(mode))},
        "bodies": plugins(BODIES, BODY_GROUP),
    }
