"""Which files a third-party controller's results rest on: its module, what that imports, and data that it declares."""

import ast
import hashlib
import importlib.util
import sys
import sysconfig
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.provenance import PACKAGES
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.plugins import CONTROLLERS, find_controller

INSTALLED = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))
"""Folders whose modules a version identifies, and not their content."""


@cache
def source_digest(mode: str) -> str | None:
    """Digest all files that a third-party controller rests on; None for a shipped one, which the version identifies.

    Raises:
        SettingsError: there is no such controller, its class lacks something, or a file of it cannot be read.
    """
    if mode in CONTROLLERS.shipped:
        return None
    digest = hashlib.blake2b(digest_size=8)
    for name, file in sorted(files_of(find_controller(mode)).items()):
        try:
            content = file.read_bytes()
        except OSError as error:
            must = f"must be a controller whose files can be read: {file}: {error.strerror}"
            raise SettingsError([Problem("control.mode", repr(mode), must)]) from None
        digest.update(f"{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def files_of(cls: type[Any]) -> dict[str, Path]:
    """The files by module, and by name for those that `cls.data_files` lists, relative to the class's own file.

    The modules are those of the class and its bases, and whatever these import, also in functions; of installed
    packages those of the class itself. What a module imports by a computed name is not found.
    """
    bases = [base.__module__ for base in cls.__mro__ if _is_third_party(base.__module__)]
    own_packages = {name.partition(".")[0] for name in bases}
    files: dict[str, Path] = {}
    waiting = bases
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if name in files or file is None or (_is_installed(file) and name.partition(".")[0] not in own_packages):
            continue
        files[name] = file
        waiting += [imported for imported in _imports(name, file) if _is_third_party(imported)]
    folder = Path(sys.modules[cls.__module__].__file__ or "").parent
    return files | {f"data: {name}": folder / name for name in getattr(cls, "data_files", ())}


def _is_third_party(name: str) -> bool:
    package = name.partition(".")[0]
    return package not in sys.stdlib_module_names and package not in PACKAGES


def _is_installed(file: Path) -> bool:
    return any(file.resolve().is_relative_to(folder) for folder in INSTALLED)


def _file_of(name: str) -> Path | None:
    try:
        module = sys.modules.get(name)
        spec = module.__spec__ if module is not None else importlib.util.find_spec(name)
    except (ImportError, AttributeError, ValueError):
        return None
    origin = getattr(module, "__file__", None) or (spec.origin if spec is not None else None)
    return Path(origin) if origin and Path(origin).is_file() else None


def _imports(name: str, file: Path) -> Iterator[str]:
    """The absolute names that a module may import: modules, their packages, and attributes that may be modules."""
    if file.suffix != ".py":
        return
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*parents, *([node.module] if node.module else [])])
            targets = [base, *(f"{base}.{alias.name}" for alias in node.names)]
        else:
            continue
        for target in targets:
            parts = target.split(".")
            yield from (".".join(parts[: length + 1]) for length in range(len(parts)))
