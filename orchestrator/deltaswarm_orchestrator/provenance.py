"""Where results come from: versions, host, code, date."""

import hashlib
import importlib.util
import os
import platform
import subprocess
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

DISTRIBUTIONS = ("deltaswarm", "eclipse-zenoh", "msgpack", "numpy", "scipy", "pandas", "mcap")
PACKAGES = ("deltaswarm_wire", "deltaswarm_agent", "deltaswarm_world", "deltaswarm_operator", "deltaswarm_orchestrator")

GIT_WITHIN_S = 5.0
"""A git that takes longer, as on a network drive that is gone, has nothing to tell."""


def now() -> str:
    """Date and time, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str | None]:
    """Of Python and of what the results depend on; None for what is not installed."""
    return {"python": platform.python_version(), **{name: _version(name) for name in DISTRIBUTIONS}}


def _version(distribution: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version  # slow to import, and a sweep's worker needs none

    try:
        return version(distribution)
    except PackageNotFoundError:
        return None


def host() -> dict[str, str | int | None]:
    """The machine's kind, not its name."""
    return {"system": platform.platform(), "machine": platform.machine(), "cores": os.cpu_count()}


@cache
def commit() -> str | None:
    """The git commit of the sources, with `-dirty` if they differ from it; None outside of a git checkout."""
    here = Path(__file__)

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(here.parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=GIT_WITHIN_S).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", here.name)
        return git("describe", "--always", "--dirty", "--exclude=*", "--abbrev=40")
    except (OSError, subprocess.SubprocessError):
        return None


@cache
def code_digest() -> str:
    """A digest of all sources of deltaswarm, which tells apart what one version number may hold."""
    found = hashlib.blake2b(digest_size=8)
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        assert spec is not None, package
        for folder in spec.submodule_search_locations or ():
            for file in sorted(Path(folder).rglob("*.py")):
                found.update(f"{package}/{file.relative_to(folder)}\n".encode() + file.read_bytes())
    return found.hexdigest()
