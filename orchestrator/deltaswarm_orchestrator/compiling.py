"""Compile the cores with mypyc, into a wheel that is being built or into the installation at hand.

This file uses the standard library alone, because the build of a wheel loads it without its package. Compiled modules
lie beside their sources; Python prefers them.
"""

import importlib.machinery
import json
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from deltaswarm_scenario.scenario import Scenario

MODULES = (
    "deltaswarm_wire/codec.py",
    "deltaswarm_wire/digest.py",
    "deltaswarm_wire/envelope.py",
    "deltaswarm_wire/messages.py",
    "deltaswarm_wire/saved.py",
    "deltaswarm_agent/recurring.py",
    "deltaswarm_agent/core",
    "deltaswarm_agent/controllers/paper",
    "deltaswarm_world/core/bookkeeping.py",
    "deltaswarm_world/core/downlink.py",
    "deltaswarm_world/core/environment.py",
    "deltaswarm_world/core/intake.py",
    "deltaswarm_world/core/participants.py",
    "deltaswarm_world/core/sleep_schedule.py",
    "deltaswarm_world/core/turns.py",
    "deltaswarm_world/core/world.py",
    "deltaswarm_operator/core/workload.py",
)
"""What is compiled; a folder stands for its modules."""

INTERPRETED = (
    "deltaswarm_agent/controllers/paper/adaptive.py",
    "deltaswarm_agent/controllers/paper/controller.py",
    "deltaswarm_agent/controllers/paper/settings.py",
)
"""Settings are inspected as dataclasses, and the paper's controllers may be subclassed."""

PACKAGES = tuple(f"deltaswarm_{name}" for name in ("wire", "scenario", "agent", "world", "operator"))
"""What the compiler must see."""

COMPILER = ("mypy>=1.14", "setuptools>=70")
GROUP = "deltaswarm"
"""The library that all compiled modules share is named after it."""

SUFFIXES = tuple(importlib.machinery.EXTENSION_SUFFIXES)
LEVEL = "2"
BUILD_WITHIN_S = 1800.0

SAVED_SHARE = 0.25
"""Share of the time of runs in one process that compiled cores save; measured: 0.12 to 0.35 (docs/PERFORMANCE.md)."""

AGENT_STEP_S = 25e-6
"""Time of a step of an agent, with the world's share (docs/PERFORMANCE.md) [s]."""

WORTH_S = 600.0
"""Planned time from which on compiled cores are suggested [s]."""

CHECK = """\
from itertools import islice
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
swarm = InProcess(load_scenario("paper-25", ["record=off", "events.rate_hz=0.5"], 1))
for _ in islice(swarm.steps(), 200):
    pass
print(swarm.world.digest.hex())
"""
"""A short run, whose digest must be the same before and after."""


class CompileError(Exception):
    """Why the cores cannot be compiled here, or removed: what must hold, and what to do."""


def compile_modules(roots: Sequence[Path], out: Path, level: str) -> list[Path]:
    """Compile the modules, which are below these roots; return the libraries, below `out/lib`. Change the folder."""
    from mypyc.build import mypycify
    from setuptools import Distribution
    from setuptools.command.build_ext import build_ext

    os.chdir(roots[0].parent)
    os.environ["MYPYPATH"] = os.pathsep.join(map(str, roots))
    flags = [
        "--config-file=",
        "--no-site-packages",
        "--cache-dir=/dev/null",
        "--explicit-package-bases",
        "--ignore-missing-imports",
        "--follow-imports=silent",
    ]
    sources = [os.path.relpath(file) for file in sources_below(roots)]
    extensions = mypycify([*flags, *sources], opt_level=level, target_dir=str(out / "c"), group_name=GROUP)
    command = build_ext(Distribution({"name": GROUP, "ext_modules": extensions}))
    command.build_lib, command.build_temp, command.inplace = str(out / "lib"), str(out / "tmp"), False
    command.ensure_finalized()
    command.run()
    return [file for file in (out / "lib").rglob("*") if file.is_file()]


def sources_below(roots: Iterable[Path]) -> list[Path]:
    """Return the files of the modules to compile."""
    found = []
    for root in roots:
        kept_out = {root / name for name in INTERPRETED}
        for path in (root / name for name in MODULES):
            files = (
                sorted(file for file in path.rglob("*.py") if file.name != "__init__.py") if path.is_dir() else [path]
            )
            found += [file for file in files if file.is_file() and file not in kept_out]
    return found


def site() -> Path:
    """Return the folder into which deltaswarm is installed.

    Raises:
        CompileError: it is not installed, or runs from its sources.
    """
    here = Path(__file__).resolve().parents[1]
    try:
        distribution = metadata.distribution("deltaswarm")
    except metadata.PackageNotFoundError:
        raise CompileError(f"deltaswarm must be installed to be compiled (got sources in {here})") from None
    origin = json.loads(distribution.read_text("direct_url.json") or "{}")
    folder = Path(str(distribution.locate_file(""))).resolve()
    if origin.get("dir_info", {}).get("editable") or folder != here:
        raise CompileError(
            f"an editable installation stays pure Python, so that changes of its sources have an effect (got {here}); "
            "install a copy elsewhere: DELTASWARM_COMPILE=2 pip install ."
        )
    return folder


def record_of() -> Path:
    """Return pip's list of the installed files: what stands there is removed with the next version."""
    distribution = metadata.distribution("deltaswarm")
    for file in distribution.files or ():
        if file.name == "RECORD" and file.parent.name.endswith(".dist-info"):
            return Path(str(distribution.locate_file(file)))
    raise CompileError("the installation must have pip's list of its files (RECORD): install deltaswarm with pip")


def check_writable(folder: Path) -> Path:
    """Check that compiled modules can be written; return the list of installed files.

    Raises:
        CompileError: one of the folders belongs to somebody else.
    """
    record = record_of()
    for path in sorted({folder, record, *(file.parent for file in sources_below([folder]))}):
        if not os.access(path, os.W_OK):
            raise CompileError(
                f"{path} must be writable (it belongs to {owner(path)}): "
                "use that account, or install deltaswarm into an environment of your own"
            )
    return record


def owner(path: Path) -> str:
    """Return who owns a file, by name or number."""
    try:
        return path.owner()
    except KeyError:
        return f"user {path.stat().st_uid}"


def check_compiler() -> None:
    """Check that there is what compiles.

    Raises:
        CompileError: a package, the C compiler or Python's headers are missing; the text has all that is.
    """
    missing = []
    for name in COMPILER:
        package, _, least = name.partition(">=")
        try:
            found = metadata.version(package)
        except metadata.PackageNotFoundError:
            found = ""
        if not found or _numbers(found) < _numbers(least):
            missing.append(f"{name} (pip install 'deltaswarm[compile]')")
    command = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    if not shutil.which(command):
        missing.append(f"the C compiler {command} (on Debian: apt install gcc)")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append("Python's headers (on Debian: apt install python3-dev)")
    if missing:
        raise CompileError(f"compiling needs {', '.join(missing)}")


def _numbers(version: str) -> list[int]:
    return [int(part) for part in version.split(".")[:2] if part.isdecimal()]


def compiled_files(folder: Path) -> list[Path]:
    """Return the compiled modules in an installation, and the library that they share."""
    candidates = [source.with_suffix(suffix) for source in sources_below([folder]) for suffix in SUFFIXES]
    return [file for file in [*candidates, *folder.glob(f"{GROUP}__mypyc*.so")] if file.is_file()]


def install() -> list[Path]:
    """Compile the cores of the installation at hand; return the files.

    Raises:
        CompileError: that is not possible here; the installation is as it was.
    """
    from deltaswarm_orchestrator.base.kernel import bound_to_this
    from deltaswarm_orchestrator.base.temporary import TemporaryFolder
    from deltaswarm_wire.files import write_whole  # see the first lines of this file

    folder = site()
    check_compiler()
    record = check_writable(folder)
    expected = digest_of_short_run()
    with TemporaryFolder() as scratch:
        for package in PACKAGES:
            shutil.copytree(folder / package, scratch / "src" / package, ignore=shutil.ignore_patterns("*.so", "*.pyc"))
        command = bound_to_this("deltaswarm_orchestrator.compiling", str(scratch))
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=BUILD_WITHIN_S)
        if done.returncode:
            last = "\n".join((done.stdout + done.stderr).strip().splitlines()[-5:])
            raise CompileError(f"the compiler must end well (exit code {done.returncode}):\n{last}")
        remove()
        built = [file for file in (scratch / "lib").rglob("*") if file.is_file()]
        placed = [folder / file.relative_to(scratch / "lib") for file in built]
        lines = [f"{file.relative_to(folder).as_posix()},,\n" for file in placed]
        mode = Path(__file__).stat().st_mode
        try:  # the record first: what is not listed would outlive the next version
            write_whole(record, record.read_bytes() + "".join(lines).encode())
            for file, place in zip(built, placed, strict=True):
                write_whole(place, file.read_bytes(), mode)
        except OSError:
            remove()
            raise
    try:
        found = digest_of_short_run()
    except CompileError as error:
        found = str(error)
    if found != expected:
        remove()
        raise CompileError(f"a compiled run must have the digest {expected} (got {found}); the cores are pure again")
    return placed


def remove() -> list[Path]:
    """Remove the compiled modules of the installation at hand; return them.

    Raises:
        CompileError: that is not possible here.
    """
    from deltaswarm_wire.files import write_whole  # see the first lines of this file

    folder = site()
    record = check_writable(folder)
    files = compiled_files(folder)
    for file in files:
        file.unlink()
    gone = {file.relative_to(folder).as_posix() for file in files}
    lines = record.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if line.split(",")[0] not in gone]
    if kept != lines:
        write_whole(record, "".join(kept).encode())
    return files


def digest_of_short_run() -> str:
    """Return the digest of a run by a new process.

    Raises:
        CompileError: it failed.
    """
    done = subprocess.run([sys.executable, "-P", "-c", CHECK], capture_output=True, text=True, check=False)
    if done.returncode:
        raise CompileError(f"a short run must end well: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout.strip()


def rough_s(scenarios: Iterable["Scenario"]) -> float:
    """Return roughly how long runs take in pure Python, one after another in one process [s]."""
    return AGENT_STEP_S * sum(scenario.run.steps * scenario.agents.count for scenario in scenarios)


def hint(planned_s: float, build: str) -> str | None:
    """Return a line about what compiled cores would save of this much planned time in one process; None if little."""
    if planned_s < WORTH_S or build != "pure Python":
        return None
    try:
        site()
        command = "`deltaswarm compile`"
    except CompileError:
        command = "`DELTASWARM_COMPILE=2 pip install .` into another environment"
    return (
        f"compiled cores would save about {SAVED_SHARE * planned_s / 60:.0f} min of it, with equal results: {command}"
    )


if __name__ == "__main__":
    scratch = Path(sys.argv[1])
    compile_modules([scratch / "src"], scratch, LEVEL)
