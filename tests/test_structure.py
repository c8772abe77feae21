"""The structure that the project promises: who imports what, how long files are, and what must not exist."""

import ast
import dataclasses
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_agent.controllers import potential
from deltaswarm_agent.controllers.central import controller as central_settings
from deltaswarm_agent.controllers.paper import settings as paper_settings
from deltaswarm_scenario import density, fault, operator_links, operator_settings, page_language, radio, scenario
from deltaswarm_wire import obstacles
from deltaswarm_wire import settings as agent_settings
from deltaswarm_wire.plugin_errors import PACKAGES
from deltaswarm_wire.plugins import FAULTS, find
from tests.support.tiers import in_one_test

ROOT = Path(__file__).parents[1]
SOURCES = ("agent", "world", "operator", "orchestrator")
MAX_LINES = 400


def modules(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


CORES = [path for part in ("agent", "world", "operator") for path in (ROOT / part).rglob("*/core/**/*.py")]
CORES += modules("agent/deltaswarm_agent/controllers")


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Python in the repository's root, as a user starts it there."""
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)


def imported(path: Path) -> Iterator[str]:
    """The modules that a file imports anywhere in it; what is taken from one, after a colon."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}:{alias.name}" for alias in node.names)


def test_the_operators_folder_is_no_package() -> None:
    """An operator/__init__.py would shadow Python's own `operator` module for everything started here."""
    assert not (ROOT / "operator" / "__init__.py").exists()
    assert "/operator/__init__.py" in (ROOT / ".gitignore").read_text().split()


@pytest.mark.parametrize("arguments", [("-c", "import collections"), ("-m", "pytest", "--version")], ids=" ".join)
def test_python_works_in_the_repositorys_root(arguments: tuple[str, ...]) -> None:
    """Where the folder `operator` comes first on Python's path."""
    done = python(*arguments)
    assert done.returncode == 0, done.stderr


def test_the_parts_meet_only_on_the_wire() -> None:
    """The import contracts of pyproject.toml are kept."""
    done = python("-c", "from importlinter.cli import lint_imports_command as main; main()", "--no-cache")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


def test_no_core_draws_from_a_shared_generator() -> None:
    """Neither `random`, of which only the class may be imported, nor numpy's global one."""
    assert len(CORES) > 60
    for path in CORES:
        assert {name for name in imported(path) if name.startswith("random")} <= {"random:Random"}, named(path)
        drawn = set(re.findall(r"\bnp\.random\.(\w+)", path.read_text()))
        assert drawn <= {"Generator", "default_rng"}, named(path)


@in_one_test("folder", [*SOURCES, "tests"])
def test_files_are_short(folder: str) -> None:
    """A file that grows past 400 lines is telling of a missing idea."""
    long = {named(path): path.read_text().count("\n") for path in modules(folder)}
    assert {name: lines for name, lines in long.items() if lines >= MAX_LINES} == {}


SETTINGS: list[Any] = [
    found
    for module in (
        *(agent_settings, obstacles, scenario, density, fault, operator_links, operator_settings, radio),
        *(page_language, paper_settings, central_settings, potential),
    )
    for found in vars(module).values()
    if dataclasses.is_dataclass(found) and getattr(found, "__module__", "") == module.__name__
] + [find(FAULTS, kind, "fault.kind").Settings for kind in FAULTS.shipped]


@in_one_test("settings", SETTINGS)
def test_every_setting_says_what_it_means(settings: Any) -> None:
    """Each key has a default and a text; a default that the paper does not give says whose reading it is."""
    for spec in dataclasses.fields(settings):
        key = f"{settings.__name__}.{spec.name}"
        assert spec.metadata.get("doc"), key
        source = spec.metadata.get("source", "")
        assert source in ("", "our reading") or source.startswith("paper"), key
        assert spec.default is not dataclasses.MISSING or spec.default_factory is not dataclasses.MISSING, key


def test_what_decides_in_a_swarm_has_a_source() -> None:
    """Paper or our reading: every default of how agents decide under the paper's control."""
    unsaid = [spec.name for spec in dataclasses.fields(paper_settings.PaperSettings) if not spec.metadata["source"]]
    assert not unsaid


def test_every_package_of_the_wheel_is_our_own_code() -> None:
    """Else its errors would be blamed on a plug-in, and an edit of it would not change the digest of the code."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    packages = {Path(folder).name for folder in tool["hatch"]["build"]["targets"]["wheel"]["packages"]}
    assert packages == PACKAGES == {*tool["importlinter"]["root_packages"]}


def test_mutated_files_and_their_tests_exist() -> None:
    """All paths that `[tool.mutants]` of pyproject.toml names."""
    table = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mutants"]
    paths = [path for file, tests in table.items() for path in (file, *tests)]
    assert [path for path in paths if not (ROOT / path).exists()] == []
