"""`deltaswarm list`."""

import argparse
import json
from importlib.metadata import entry_points

from deltaswarm_orchestrator.exits import OK


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm list`."""
    command.description = "List what comes with deltaswarm and what other installed packages add to it."
    command.add_argument("--json", action="store_true", help="print the lists as JSON")
    command.set_defaults(func=list_all)


def list_all(arguments: argparse.Namespace) -> int:
    """Print the names of scenarios, sweeps, studies, controllers and bodies, each with what it is."""
    found = known()
    if arguments.json:
        print(json.dumps(found))
        return OK
    width = max(len(name) for names in found.values() for name in names)
    for kind, names in found.items():
        print(f"{kind}:")
        print("\n".join(f"  {name:{width}}  {what}".rstrip() for name, what in names.items()))
    return OK


def known() -> dict[str, dict[str, str]]:
    """Every name that a command or a settings file may use, by kind, with a line about it."""
    from deltaswarm_orchestrator.run.scenario import BUILT_IN as SCENARIOS
    from deltaswarm_orchestrator.sweeps.load import FOLDERS, files_in
    from deltaswarm_wire.plugins import BODIES, BODY_GROUP, CONTROLLER_GROUP, CONTROLLERS

    def about(folder: str) -> dict[str, str]:
        texts = {file.name.removesuffix(".toml"): file.read_text() for file in files_in(folder)}
        return {name: text.partition("\n")[0].removeprefix("# ") for name, text in texts.items()}

    def plugins(shipped: dict[str, str], group: str) -> dict[str, str]:
        return {**shipped, **{point.name: point.value for point in entry_points(group=group)}}

    scenarios = about("scenarios")
    studies = {
        name: text for folder in FOLDERS if folder.startswith("studies/") for name, text in about(folder).items()
    }
    return {
        "scenarios": {name: scenarios[name] for name in SCENARIOS},
        "sweeps": about("sweeps/built_in"),
        "studies": studies,
        "controllers": plugins(CONTROLLERS, CONTROLLER_GROUP),
        "bodies": plugins(BODIES, BODY_GROUP),
    }
