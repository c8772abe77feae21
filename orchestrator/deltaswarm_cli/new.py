"""The command `deltaswarm new`: a folder with a controller, its tests, a scenario and a study, all of which work."""

import argparse
import builtins
import importlib.util
import keyword
import re
import sys
from importlib import resources
from pathlib import Path

from deltaswarm_cli.arguments import add_json, show
from deltaswarm_orchestrator.base.exits import OK, CommandError, notice
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.base.temporary import new_folder
from deltaswarm_wire.files import write_whole

FILES = {
    "controller.txt": "NAME.py",
    "test.txt": "test_NAME.py",
    "scenario.txt": "scenario.toml",
    "study.txt": "study.toml",
}
"""The files in `template/`, and their names in the folder; NAME and CLASS stand for the controller's."""

NAME_PATTERN = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
MAX_NAME = 60
"""Characters of a name, to which endings are added."""

NAMED_IN_FILES = re.compile(r"^(?:from|class) .*", re.MULTILINE)
"""The lines of the files with the names that the controller's class must not hide."""


def new_controller(name: str, folder: Path) -> list[Path]:
    """Write the files of a controller into a new folder; return their paths.

    Raises:
        CommandError: the name cannot be a module's, or the folder exists or cannot be made.
    """
    if not NAME_PATTERN.fullmatch(name) or len(name) > MAX_NAME or keyword.iskeyword(name):
        must = f"a module's name of at most {MAX_NAME} small letters and digits, with '_' between words"
        raise CommandError(f"NAME must be {must} (got {name!r:.80})")
    taken = {*sys.stdlib_module_names, *dir(builtins), *keyword.softkwlist, "conftest"}
    if name in taken or name.startswith(("test_", "deltaswarm")) or importlib.util.find_spec(name) is not None:
        raise CommandError(f"NAME must not be that of another module, or of Python's own (got {name!r})")
    templates = resources.files("deltaswarm_cli").joinpath("template")
    texts = {path: templates.joinpath(file).read_text(encoding="utf-8") for file, path in FILES.items()}
    cls = "".join(part.capitalize() for part in name.split("_"))
    lines = " ".join(line for text in texts.values() for line in NAMED_IN_FILES.findall(text))
    if cls in dir(builtins) or cls in re.findall(r"\w+", lines):
        raise CommandError(f"NAME must not give its class, {cls}, the name of another class (got {name!r})")
    if folder.exists():
        raise CommandError(f"{folder} must not exist; choose another folder by --out")
    check_out(folder)
    names = [path.replace("NAME", name) for path in texts]
    with new_folder(folder) as made:
        for file, text in zip(names, texts.values(), strict=True):
            write_whole(made / file, text.replace("NAME", name).replace("CLASS", cls).encode())
    return [folder / file for file in names]


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
    tests = f"{'' if importlib.util.find_spec('pytest') else 'pip install pytest; '}python -m pytest"
    notice(f"next: cd {folder}; export PYTHONPATH=$PWD; {tests}; deltaswarm run scenario.toml --in-process")
    return OK
