"""Make a folder that installs an agent on a board without internet: wheels for its platform, and an installer.

The wheels are those of the agent, eclipse-zenoh and msgpack, in the versions that this machine runs; for boards that
obey an operator, also cryptography and its dependencies, and where it is installed here, pycdr2 for ROS 2 robots. pip
fetches only wheels that the board's Python accepts; a wheel that is built here must be pure Python.
"""

import hashlib
import importlib.util
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.kernel import bound_to_this
from deltaswarm_orchestrator.base.temporary import TemporaryFolder, new_folder
from deltaswarm_wire import __version__
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.files import write_whole

PLATFORMS = ("linux_aarch64", "linux_armv7l", "linux_x86_64")
PYTHONS = ("3.11", "3.12", "3.13", "3.14", "3.15")
"""Raspberry Pi OS has 3.11 (bookworm) and 3.13 (trixie)."""

ZENOH, MSGPACK = "eclipse-zenoh", "msgpack"
CRYPTOGRAPHY, CFFI, PYCPARSER = "cryptography", "cffi", "pycparser"
"""The packages that check the operator's signatures, for boards that obey an operator."""

PYCDR2 = "pycdr2"
"""Encodes messages of ROS 2 (extra ros2)."""

GLIBC_MINORS = range(36, 16, -1)
"""Minor versions of glibc 2, newest first: bookworm has 2.36, and none of our wheels is older than manylinux_2_17."""

PACKAGES = ("deltaswarm_wire", "deltaswarm_agent", "deltaswarm_board", "deltaswarm_ros2")
DATA = ("pyproject.toml", "README.md", "systemd")
"""What the board's wheel and the bundle are made of besides the packages, in the source tree's agent/."""

EXAMPLE, NO_OPERATOR = "example.toml", 'operator_key = ""'

INSTALLED_DATA = "wheel"
"""The folder of `deltaswarm_board` in which an installed deltaswarm keeps `DATA`."""

TAIL_LINES = 8


class BundleError(CommandError):
    """No bundle was made; the text says why."""

    code = FAILED


def bundle(out: Path, platform: str, pythons: Sequence[str] = PYTHONS, operator_key: str = "") -> list[str]:
    """Make the folder `out`; return the names of its wheels.

    If given, the operator's public key is put into the example of a board's file.
    """
    if out.exists():
        raise SettingsError([Problem("--out", str(out), "must be a new folder; nothing is overwritten")])
    with _beside(out) as folder, TemporaryFolder() as scratch:
        wheels = folder / "wheels"
        wheels.mkdir()
        source = copy_source(scratch / "agent")
        _build(wheels, str(source))
        _fetch(ZENOH, platform, pythons[0], wheels)
        for python in pythons:
            _fetch_msgpack(platform, python, wheels)
        if importlib.util.find_spec(PYCDR2):
            _fetch(PYCDR2, platform, pythons[0], wheels)
        for item in (source / "systemd").iterdir():
            shutil.copy(item, folder)
        if operator_key:
            _fetch(CRYPTOGRAPHY, platform, pythons[0], wheels)
            _fetch(PYCPARSER, platform, pythons[0], wheels)
            for python in pythons:  # the others have one wheel for all Pythons
                _fetch(CFFI, platform, python, wheels)
            example = folder / EXAMPLE
            example.write_text(
                example.read_text(encoding="utf-8").replace(NO_OPERATOR, f'operator_key = "{operator_key}"')
            )
        shutil.copy(source / "README.md", folder)
        _write_sums(folder)
        return sorted(wheel.name for wheel in wheels.iterdir())


def wheel_platforms(platform: str) -> list[str]:
    """Return the platform tags that `linux_<machine>` accepts, best first (PEP 600)."""
    machine = platform.removeprefix("linux_")
    return [*(f"manylinux_2_{minor}_{machine}" for minor in GLIBC_MINORS), f"manylinux2014_{machine}", platform]


def _build(wheels: Path, requirement: str, *options: str, environment: Mapping[str, str] | None = None) -> None:
    """Build a wheel that fits any board."""
    before = set(wheels.iterdir())
    run_pip("wheel", "--no-deps", *options, "--wheel-dir", str(wheels), requirement, environment=environment)
    for wheel in set(wheels.iterdir()) - before:
        if not wheel.name.endswith("-py3-none-any.whl"):
            raise BundleError(f"a wheel that is built here must be pure Python (got {wheel.name})")


def _fetch(package: str, platform: str, python: str, wheels: Path) -> None:
    """Fetch the wheel of a package in the version that this machine runs."""
    platforms = [option for tag in wheel_platforms(platform) for option in ("--platform", tag)]
    run_pip(
        *("download", "--no-deps", "--only-binary", ":all:", "--implementation", "cp", "--python-version", python),
        *(*platforms, "--dest", str(wheels), f"{package}=={version(package)}"),
    )


def _fetch_msgpack(platform: str, python: str, wheels: Path) -> None:
    """Fetch a compiled wheel or, if there is none, build the pure-Python one from source."""
    wanted = version(MSGPACK)
    if (wheels / f"{MSGPACK}-{wanted}-py3-none-any.whl").exists():
        return
    try:
        _fetch(MSGPACK, platform, python, wheels)
    except BundleError:
        options = ("--no-cache-dir", "--no-binary", MSGPACK)
        _build(wheels, f"{MSGPACK}=={wanted}", *options, environment={"MSGPACK_PUREPYTHON": "1"})


def run_pip(command: str, *arguments: str, environment: Mapping[str, str] | None = None) -> None:
    """Run pip."""
    argv = bound_to_this("pip", command, "--quiet", "--disable-pip-version-check", *arguments)
    done = subprocess.run(argv, capture_output=True, text=True, check=False, env={**os.environ, **(environment or {})})
    if done.returncode:
        lines = (done.stdout + done.stderr).splitlines()
        errors = [line.strip() for line in lines if any(word in line for word in ("ERROR", "error:", "[Errno "))]
        raise BundleError(f"pip {command} {arguments[-1]} failed:\n" + "\n".join((errors or lines)[-TAIL_LINES:]))


def copy_source(folder: Path) -> Path:
    """Copy what the board's wheel is made of, from the source tree or this installation, into the folder."""
    origins = [Path(_origin(package)).parent for package in PACKAGES]
    data = origins[0].parent
    if not all((data / name).exists() for name in DATA):
        data = Path(_origin("deltaswarm_board")).parent / INSTALLED_DATA
    for origin in origins:
        ignored = shutil.ignore_patterns("__pycache__", "*.so", INSTALLED_DATA)
        shutil.copytree(origin, folder / origin.name, ignore=ignored)
    for name in DATA:
        if not (data / name).exists():
            raise BundleError(f"{data / name} is missing: this installation of deltaswarm {__version__} is incomplete")
        (shutil.copytree if (data / name).is_dir() else shutil.copy)(data / name, folder / name)
    return folder


def _origin(package: str) -> str:
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise BundleError(f"{package} is not installed")
    return spec.origin


def _write_sums(folder: Path) -> None:
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    lines = [f"{hashlib.sha256((folder / file).read_bytes()).hexdigest()}  {file}\n" for file in files]
    write_whole(folder / "SHA256SUMS", "".join(lines).encode())


@contextmanager
def _beside(out: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `out`, and rename it to `out` when it is complete."""
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(new_folder(out))
            folder.chmod(0o755)
            yield folder
            stack.close()
        except OSError as error:
            raise BundleError(f"{out} could not be made: {error.strerror or error}; nothing was written") from None
