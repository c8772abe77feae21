"""Compile the cores into the wheel, on request: `DELTASWARM_COMPILE=1 pip install .` needs a C compiler and mypyc.

The sources stay beside the compiled modules, for tracebacks and for Pythons that cannot load them. An editable
installation is never compiled: a change of a source file must have an effect.
"""

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

REQUEST = "DELTASWARM_COMPILE"
"""The environment variable that asks for compiled cores; its value is the C compiler's optimisation level, 1 to 3."""

COMPILER = ("mypy>=1.14", "setuptools>=70")


class CompiledCores(BuildHookInterface[Any]):
    """Adds compiled modules to the wheel. `modules`, in pyproject.toml, are paths; a folder stands for its modules."""

    def dependencies(self) -> list[str]:
        """Return what the build needs besides hatchling."""
        return list(COMPILER) if _level() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile if that is asked for. Raises what the compilers raise, which ends the installation."""
        if not (level := _level()) or version == "editable":
            return
        self._built = Path(tempfile.mkdtemp(prefix="deltaswarm-compiled-"))
        build_data["pure_python"], build_data["infer_tag"] = False, True
        for library in compile_modules(Path(self.root), self.config, self._built, level):
            build_data["force_include"][str(library)] = str(library.relative_to(self._built / "lib"))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what the wheel now has."""
        if built := getattr(self, "_built", None):
            shutil.rmtree(built, ignore_errors=True)


def _level() -> str:
    level = os.environ.get(REQUEST, "")
    if level not in ("", "0", "1", "2", "3"):
        raise ValueError(f"{REQUEST} must be the optimisation level, 1 to 3, or 0 for pure Python (got {level!r})")
    return level if level != "0" else ""


def compile_modules(root: Path, config: dict[str, Any], out: Path, level: str) -> list[Path]:
    """Compile the listed modules; return the libraries, below `out/lib`."""
    from mypyc.build import mypycify
    from setuptools import Distribution
    from setuptools.command.build_ext import build_ext

    os.chdir(root)
    os.environ["MYPYPATH"] = os.pathsep.join(config["roots"])
    kept_out = {Path(name) for name in config["interpreted"]}
    found = [file for name in config["modules"] for file in _modules(Path(name)) if file not in kept_out]
    flags = [
        "--config-file=",
        "--no-site-packages",
        "--cache-dir=/dev/null",
        "--explicit-package-bases",
        "--ignore-missing-imports",
    ]
    extensions = mypycify(
        [*flags, *map(str, found)], opt_level=level, target_dir=str(out / "c"), group_name="deltaswarm"
    )
    command = build_ext(Distribution({"name": "deltaswarm", "ext_modules": extensions}))
    command.build_lib, command.build_temp, command.inplace = str(out / "lib"), str(out / "tmp"), False
    command.ensure_finalized()
    command.run()
    return [file for file in (out / "lib").rglob("*") if file.is_file()]


def _modules(path: Path) -> list[Path]:
    return sorted(file for file in path.rglob("*.py") if file.name != "__init__.py") if path.is_dir() else [path]
