"""The command `deltaswarm new`."""

import argparse
from importlib.util import find_spec
from pathlib import Path

from deltaswarm.new import new_controller
from deltaswarm_cli.arguments import add_json, show
from deltaswarm_orchestrator.base.exits import OK, notice


def add_new(command: argparse.ArgumentParser) -> None:
    command.add_argument("what", choices=("controller",), help="what to make")
    command.add_argument("name", metavar="NAME", help="of the controller's module, such as my_walk")
    command.add_argument("--out", type=Path, metavar="FOLDER", help="the folder to make (default: NAME)")
    add_json(command, "the names of the files")
    command.set_defaults(func=new, makes_files=True)


def new(arguments: argparse.Namespace) -> int:
    folder = arguments.out or Path(arguments.name)
    files = new_controller(arguments.name, folder)
    show(arguments, [str(file) for file in files], "\n".join(map(str, files)))
    tests = f"{'' if find_spec('pytest') else 'pip install pytest; '}python -m pytest"
    notice(f"next: cd {folder}; export PYTHONPATH=$PWD; {tests}; deltaswarm run scenario.toml --in-process")
    return OK
