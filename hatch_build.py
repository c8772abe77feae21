"""Write the commit into what is built, and compile the cores into the wheel on request.

`DELTASWARM_COMPILE=1 pip install .` needs a C compiler and mypyc. The sources stay beside the compiled modules, for
tracebacks and for Pythons that cannot load them. An editable installation is never compiled: a change of a source file
must have an effect.
"""

import importlib.util
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

REQUEST = "DELTASWARM_COMPILE"
"""The environment variable that asks for compiled cores; its value is the C compiler's optimisation level, 1 to 3."""

COMMIT_FILE = "orchestrator/deltaswarm_orchestrator/commit.txt"
"""Where a source archive made by a build keeps the commit; the wheel has it in the package."""

ARCHIVED = ".git_archival.txt"
"""Where `git archive` writes the commit."""

ROOTS = ("agent", "world", "operator", "orchestrator")


def _compiling() -> Any:
    """Load the module that compiles, without its package."""
    file = Path(__file__).parent / "orchestrator" / "deltaswarm_orchestrator" / "compiling.py"
    spec = importlib.util.spec_from_file_location("compiling", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Build(BuildHookInterface[Any]):
    """Adds the commit and compiled modules."""

    _scratch: Path | None = None

    def dependencies(self) -> list[str]:
        """Return what the build needs besides hatchling."""
        return list(_compiling().COMPILER) if self.target_name == "wheel" and _level() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Note the commit, and compile if that is asked for.

        Raises what the compilers raise, which ends the installation.
        """
        if version == "editable":
            return
        self._scratch = Path(tempfile.mkdtemp(prefix="deltaswarm-build-"))
        if commit := commit_of(Path(self.root)):
            file = self._scratch / "commit.txt"
            file.write_text(f"{commit}\n", encoding="ascii")
            target = COMMIT_FILE if self.target_name == "sdist" else COMMIT_FILE.partition("/")[2]
            build_data["force_include"][str(file)] = target
        if self.target_name == "wheel" and (level := _level()):
            build_data["pure_python"], build_data["infer_tag"] = False, True
            roots = [Path(self.root) / name for name in ROOTS]
            for library in _compiling().compile_modules(roots, self._scratch, level):
                build_data["force_include"][str(library)] = str(library.relative_to(self._scratch / "lib"))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what the wheel now has."""
        if self._scratch:
            shutil.rmtree(self._scratch, ignore_errors=True)


def commit_of(root: Path) -> str:
    """Return the commit of the sources, with `-dirty` if they differ from it; empty if it is not known."""
    try:
        if (root / ".git").exists():  # and not that of a folder around an unpacked archive
            command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*", "--abbrev=40"]
            return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
        archived = root / (COMMIT_FILE if (root / COMMIT_FILE).exists() else ARCHIVED)
        text = archived.read_text(encoding="ascii").strip()
    except (OSError, subprocess.SubprocessError):
        return ""
    return "" if text.startswith("$") else text


def _level() -> str:
    level = os.environ.get(REQUEST, "")
    if level not in ("", "0", "1", "2", "3"):
        raise ValueError(f"{REQUEST} must be the optimisation level, 1 to 3, or 0 for pure Python (got {level!r})")
    return level if level != "0" else ""
