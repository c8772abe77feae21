"""Make a folder with a controller, its tests, a scenario and a study, all of which work, to begin with."""

import importlib.util
import keyword
import sys
from importlib import resources
from pathlib import Path

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.base.temporary import new_folder

FILES = {
    "controller.txt": "NAME.py",
    "test.txt": "test_NAME.py",
    "scenario.txt": "scenario.toml",
    "study.txt": "study.toml",
}
"""The files in `template/`, and their names in the folder; NAME and CLASS stand for the controller's."""


def new_controller(name: str, folder: Path) -> list[Path]:
    """Write the files of a controller into a new folder; return their paths.

    Raises:
        CommandError: the name cannot be a module's, or the folder exists or cannot be made.
    """
    if not (name.isascii() and name.isidentifier() and name == name.lower()) or keyword.iskeyword(name):
        raise CommandError(f"NAME must be a module's name, of small letters, digits and '_' (got {name!r})")
    taken = name in sys.stdlib_module_names or name.startswith(("test_", "deltaswarm"))
    if taken or importlib.util.find_spec(name) is not None:
        raise CommandError(f"NAME must not be that of another module (got {name!r})")
    if folder.exists():
        raise CommandError(f"{folder} must not exist; choose another folder by --out")
    check_out(folder)
    cls = "".join(part.capitalize() for part in name.split("_"))
    names = [path.replace("NAME", name) for path in FILES.values()]
    with new_folder(folder) as made:
        for template, file in zip(FILES, names, strict=True):
            text = resources.files("deltaswarm").joinpath("template", template).read_text(encoding="utf-8")
            (made / file).write_text(text.replace("NAME", name).replace("CLASS", cls), encoding="utf-8")
    return [folder / file for file in names]
