"""Where results come from: versions, host, code, date, and the files of third-party extensions.

Extensions here are what a scenario names: its controller, radio models, faults and inbox policy. Their results rest on
their modules, what these import, and data that they declare.
"""

import ast
import contextlib
import hashlib
import importlib.util
import os
import platform
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.commands import CommandForm, forms_of
from deltaswarm_wire.controller_metrics import ControllerMetric, declared
from deltaswarm_wire.digest import of_numbers
from deltaswarm_wire.foreign import name_of
from deltaswarm_wire.plugin_errors import PACKAGES, PluginError, defined_at
from deltaswarm_wire.plugins import (
    CONTROLLERS,
    DYNAMICS,
    FAULTS,
    INBOX_POLICIES,
    RADIO_MODELS,
    ExtensionPoint,
    as_recorded,
    find,
    find_controller,
)

DISTRIBUTIONS = ("deltaswarm", "eclipse-zenoh", "msgpack", "numpy", "scipy", "pandas", "mcap")

INSTALLED = tuple(
    Path(folder).resolve()
    for folder in (
        *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")),
        *(entry for entry in sys.path if Path(entry).name in ("site-packages", "dist-packages")),
    )
)
"""Folders whose modules a version identifies, and not their content; a virtual environment may use another's, too."""

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
    here, changed = Path(__file__), uncommitted()
    if changed is not None and (head := _asked(here, "rev-parse", "HEAD")):
        return head + "-dirty" * bool(changed)
    installed = here.parents[1] / "commit.txt"
    return installed.read_text(encoding="ascii").strip() if installed.exists() else None


def uncommitted() -> list[str] | None:
    """List the files of deltaswarm's packages that git does not have as they are; None if git has none of them."""
    here = Path(__file__)
    if _asked(here, "ls-files", "--error-unmatch", here.name) is None:
        return None
    status = _asked(here, "status", "--porcelain", "--", *(str(folder) for _, folder in _folders()))
    return None if status is None else [line.strip().partition(" ")[2].strip() for line in status.splitlines()]


def is_tracked(folder: Path) -> bool:
    """Return whether git has a file of a folder, which is then published."""
    return bool(_asked(folder / "any", "ls-files"))


def at_commit(folder: Path, revision: str) -> tuple[str, bytes]:
    """Return a commit of a folder's repository, and the folder as it was then, as a ZIP archive.

    Raises:
        OSError, SubprocessError: there is no such commit, or it does not have the folder.
    """
    commit = _git(folder / "any", "rev-parse", "--verify", f"{revision}^{{commit}}")
    command = ["git", "-C", str(folder), "archive", "--format=zip", commit, "."]
    return commit, subprocess.run(command, capture_output=True, check=True, timeout=GIT_WITHIN_S).stdout


def commit_of(file: Path) -> tuple[str | None, bool]:
    """Return the commit of the git repository that holds a file, if any, and whether it has the file as it is."""
    commit = _asked(file, "rev-parse", "HEAD")
    return commit, commit is not None and _asked(file, "status", "--porcelain", "--ignored", "--", file.name) == ""


def _asked(beside: Path, *arguments: str) -> str | None:
    """Return what git says; None if there is no git, or it has no answer."""
    try:
        return _git(beside, *arguments)
    except (OSError, subprocess.SubprocessError):
        return None


def _git(beside: Path, *arguments: str) -> str:
    command = ["git", "-C", str(beside.parent), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=GIT_WITHIN_S).stdout.strip()


def _folders() -> Iterator[tuple[str, Path]]:
    for package in sorted(PACKAGES):
        spec = importlib.util.find_spec(package)
        assert spec is not None, package
        yield from ((package, Path(folder)) for folder in spec.submodule_search_locations or ())


def _code() -> Iterator[tuple[str, bytes]]:
    for package, folder in _folders():
        for file in sorted(folder.rglob("*.py")):
            yield f"{package}/{file.relative_to(folder)}", file.read_bytes()


@cache
def code_digest() -> str:
    """Return a digest of all sources of deltaswarm; it tells different code of one version number apart."""
    digest = hashlib.blake2b(digest_size=8)
    for name, content in _code():
        digest.update(f"{name}\n".encode() + content)
    return digest.hexdigest()


@cache
def code_files() -> dict[str, str]:
    """Return a short digest of each source file of deltaswarm, which tells what has changed."""
    return {name: hashlib.blake2b(content, digest_size=4).hexdigest() for name, content in _code()}


class Source(NamedTuple):
    """What the results of one third-party extension rest on."""

    what: str
    """The kind of extension, as `ExtensionPoint.what`."""
    name: str
    """How the scenario names it."""
    digest: str
    files: tuple[str, ...]


def sources(scenario: Scenario) -> list[Source]:
    """Return the sources of all third-party extensions of a scenario; shipped ones are identified by the version."""
    return [_source(*one) for one in extensions(scenario)]


def extensions(scenario: Scenario) -> list[tuple[ExtensionPoint, str, str, Any]]:
    """Return all third-party extensions of a scenario: the point, the name, the key that has it, and the class."""
    named = [
        (CONTROLLERS, scenario.control.mode, "control.mode"),
        (DYNAMICS, scenario.world.dynamics, "world.dynamics"),
        *((RADIO_MODELS, name, "radio.models") for name in scenario.radio.models),
        (INBOX_POLICIES, scenario.operator.inbox.policy, "operator.inbox.policy"),
        *((FAULTS, kind, "fault.kind") for kind in sorted({fault.kind for fault in scenario.fault})),
    ]
    return [(point, name, path, find(point, name, path)) for point, name, path in named if name not in point.shipped]


def _source(point: ExtensionPoint, name: str, path: str, found: Any) -> Source:
    digest = hashlib.blake2b(digest_size=8)
    for cell in _cells_of(found):
        digest.update(cell.encode())
    try:
        files = {module: content for module, (_, content) in modules_of(found).items()}
        files |= {f"data: {data}": file.read_bytes() for data, file in data_of(found).items()}
    except OSError as error:
        must = f"must be a {point.what} whose files can be read: {error.filename}: {error.strerror}"
        raise SettingsError([Problem(path, repr(name), must)]) from None
    for file, content in sorted(files.items()):
        digest.update(f"{file} {len(content)}\n".encode() + content)
    return Source(point.what, name, digest.hexdigest(), tuple(sorted(files)))


def data_of(cls: type[Any]) -> dict[str, Path]:
    """Return the files that `cls.data_files` lists, relative to the class's own file."""
    folder = Path(getattr(sys.modules[cls.__module__], "__file__", None) or "").parent
    names = getattr(cls, "data_files", ())
    if not isinstance(names, tuple | list) or not all(isinstance(name, str | os.PathLike) for name in names):
        must = f"{name_of(cls)}.data_files must be a tuple of paths (got {names!r:.80})"
        raise PluginError(f"{must} ({defined_at(cls)})")
    return {name: folder / name for name in names}


def plugin_files(scenario: Scenario) -> set[Path]:
    """Return the files of all third-party extensions of a scenario, and the data that they declare."""
    found = [cls for *_, cls in extensions(scenario)]
    modules = (file for cls in found for file, _ in modules_of(cls).values())
    return {*modules, *(file for cls in found for file in data_of(cls).values())}


def controller_of(scenario: Scenario) -> dict[str, Any]:
    """Return what a manifest says of a scenario's controller: its files, and what it declares if it is third-party."""
    mode = scenario.control.mode
    own = next((source for source in sources(scenario) if source.what == CONTROLLERS.what), None)
    found: dict[str, Any] = {"mode": mode, "source": own and own.digest, "files": list(own.files) if own else []}
    if policy := scenario.control.options.get("policy"):
        found["policy"] = of_numbers(policy)
    if own:
        found["metrics"] = [asdict(metric) for metric in declared(mode)]
        found["commands"] = [checked.plain(form) for form in forms_of(find_controller(mode))]
    return found


def reading(manifest: Mapping[str, Any]) -> AbstractContextManager[None]:
    """Let no third-party code be imported while a run is read; its manifest says what its controller declared."""
    try:
        told = manifest["controller"]
        metrics = tuple([ControllerMetric(**metric) for metric in told["metrics"]])
        commands = tuple([checked.load(CommandForm, form) for form in told["commands"]])
    except (LookupError, TypeError, SettingsError):  # of a shipped controller, or of an earlier version
        return as_recorded()
    return as_recorded(metrics, commands)


@cache
def modules_of(cls: Any) -> dict[str, tuple[Path, bytes]]:
    """Return the modules of a class and its bases, and whatever these import, also in functions, with their content.

    Of installed packages it has those of the class itself. What a module imports by a computed name is not found. The
    content is that of the first call, soon after the class was loaded: the process goes on with it.
    """
    bases = [base.__module__ for base in cls.__mro__ if _is_third_party(base.__module__)]
    own_packages = {name.partition(".")[0] for name in bases}
    files: dict[str, tuple[Path, bytes]] = {}
    waiting = bases
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if name in files or file is None or (_is_installed(file) and name.partition(".")[0] not in own_packages):
            continue
        files[name] = file, file.read_bytes()
        waiting += [imported for imported in _imports(name, *files[name]) if _is_third_party(imported)]
    return files


def _cells_of(cls: type[Any]) -> list[str]:
    """Return the source of the class and of its bases, as far as they are in a notebook, which is no file."""
    import inspect  # slow to import

    own = [base for base in cls.__mro__ if base.__module__ == "__main__" and _file_of("__main__") is None]
    with contextlib.suppress(OSError, TypeError):  # typed into a console that keeps nothing
        return [inspect.getsource(base) for base in own]
    return []


def _is_third_party(name: str) -> bool:
    package = name.partition(".")[0]
    return package not in sys.stdlib_module_names and package not in PACKAGES


def _is_installed(file: Path) -> bool:
    return any(file.resolve().is_relative_to(folder) for folder in INSTALLED)


def _file_of(name: str) -> Path | None:
    try:
        module = sys.modules.get(name)
        spec = module.__spec__ if module is not None else importlib.util.find_spec(name)
    except Exception:  # a package that is imported may raise anything, such as one for another system
        return None
    origin = getattr(module, "__file__", None) or (spec.origin if spec is not None else None)
    return Path(origin) if origin and Path(origin).is_file() else None


def _imports(name: str, file: Path, content: bytes) -> Iterator[str]:
    """The absolute names that a module may import: modules, their packages, and attributes that may be modules."""
    if file.suffix != ".py":
        return
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(content)):
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
