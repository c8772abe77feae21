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
CORE = tuple(f"deltaswarm_{name}" for name in ("wire", "scenario", "agent", "world", "operator", "orchestrator"))
EXTENSIONS = tuple(f"deltaswarm_{name}" for name in ("board", "ros2", "studies", "sessions", "cluster"))
PACKAGES = CORE + EXTENSIONS

GIT_WITHIN_S = 5.0
"""Maximum wait for git [s], which may hang, for example on a lost network drive."""


def now() -> str:
    """Return date and time in UTC, as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str | None]:
    """Return the versions of Python and of what the results depend on; None for what is not installed."""
    return {"python": platform.python_version(), **{name: _version(name) for name in DISTRIBUTIONS}}


def _version(distribution: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version  # slow to import, and not needed by a sweep's worker

    try:
        return version(distribution)
    except PackageNotFoundError:
        return None


def host() -> dict[str, str | int | None]:
    """Return the machine's system, architecture and the number of cores that this process may use, but not its name."""
    return {"system": platform.platform(), "machine": platform.machine(), "cores": len(os.sched_getaffinity(0))}


@cache
def commit() -> str | None:
    """Return the git commit of the sources, with `-dirty` if they differ from it; None if it is not known.

    In a checkout git says it; an installation has it in a file, which the build wrote.
    """
    here = Path(__file__)

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(here.parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=GIT_WITHIN_S).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", here.name)
        return git("describe", "--always", "--dirty", "--exclude=*", "--abbrev=40")
    except (OSError, subprocess.SubprocessError):
        installed = here.parents[1] / "commit.txt"
        return installed.read_text(encoding="ascii").strip() if installed.exists() else None


@cache
def build() -> str:
    """Return whether the cores are "compiled" or "pure Python"; the results do not depend on it."""
    spec = importlib.util.find_spec("deltaswarm_agent.core.agent_core")
    assert spec is not None
    return "pure Python" if str(spec.origin).endswith(".py") else "compiled"


@cache
def code_digest() -> str:
    """Return a digest of all sources of deltaswarm; it tells different code of one version number apart."""
    digest = hashlib.blake2b(digest_size=8)
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        assert spec is not None, package
        for folder in spec.submodule_search_locations or ():
            for file in sorted(Path(folder).rglob("*.py")):
                digest.update(f"{package}/{file.relative_to(folder)}\n".encode() + file.read_bytes())
    return digest.hexdigest()
