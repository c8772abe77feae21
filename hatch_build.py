"""Write the commit into what is built."""

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMMIT_FILE = "orchestrator/deltaswarm_orchestrator/commit.txt"
"""Where a source archive made by a build keeps the commit; the wheel has it in the package."""

ARCHIVED = ".git_archival.txt"
"""Where `git archive` writes the commit."""


class Build(BuildHookInterface[Any]):
    """Adds the commit."""

    _scratch: Path | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        self._scratch = Path(tempfile.mkdtemp(prefix="deltaswarm-build-"))
        if commit := commit_of(Path(self.root)):
            file = self._scratch / "commit.txt"
            file.write_text(f"{commit}\n", encoding="ascii")
            target = COMMIT_FILE if self.target_name == "sdist" else COMMIT_FILE.partition("/")[2]
            build_data["force_include"][str(file)] = target

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what is now in the archive."""
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
