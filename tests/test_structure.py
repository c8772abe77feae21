"""The structure that the project promises: who imports what, how long files are, and what must not exist."""

import ast
import dataclasses
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_agent.controllers import potential
from deltaswarm_agent.controllers.central import controller as central_settings
from deltaswarm_agent.controllers.paper import settings as paper_settings
from deltaswarm_wire import settings as wire_settings
from deltaswarm_wire import (
    settings_downlink,
    settings_fault,
    settings_obstacles,
    settings_operator,
    settings_radio,
    settings_uplink,
)

ROOT = Path(__file__).parents[1]
SOURCES = ("agent", "world", "operator", "orchestrator")
MAX_LINES = 400

NOT_IN_A_CORE = {
    "zenoh",
    "asyncio",
    "threading",
    "multiprocessing",
    "concurrent",
    "socket",
    "select",
    "signal",
    "subprocess",
    "time",
    "datetime",
    "logging",
    "random",
    "secrets",
    "uuid",
}
"""Whole modules; of `random` a core may import the class `Random` and be handed an instance."""

ADAPTERS = {
    *("process.py", "run.py", "__main__.py", "output.py", "wakeup.py", "transport.py", "slow_links.py"),
    "control_input.py",
    *("open_air.py", "mavlink.py", "mavlink_link.py", "notify.py", "recording.py", "logs.py"),
    *("signals.py", "waiting.py", "server.py", "channel.py", "console_server.py", "field_console.py", "page.py"),
    *("attention.py", "replaying.py"),
}
"""They do the input and output of their parts; output.py writes the world's tables, by the wall clock; transport.py,
wakeup.py and slow_links.py are the world's ends of the fabric, and control_input.py is what Zenoh's threads tell its
main one.
On a board: its air, its vehicle and the link to it, systemd, signals, and what it writes; in open air, what waits for
the operator. server.py has the station's sockets, channel.py and console_server.py the operator's end of them; in open
air page.py starts the station, and field_console.py reads the clock. attention.py is what the world's end of the fabric
has taken in, replaying.py a replay's process."""


def modules(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


CORES = [path for path in modules("agent", "world", "operator") if path.name not in ADAPTERS]


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


def test_a_core_has_no_clock_no_network_and_no_chance_of_its_own() -> None:
    """Time and generators are arguments; what a core does follows from what it is given."""
    for path in CORES:
        found = {name for name in imported(path) if name.split(":")[0].split(".")[0] in NOT_IN_A_CORE}
        assert found <= {"random:Random"}, named(path)


def test_no_core_draws_from_a_shared_generator() -> None:
    """Neither `random` nor numpy's global one: each use of chance has its own, from the seed."""
    for path in CORES:
        drawn = set(re.findall(r"\bnp\.random\.(\w+)", path.read_text()))
        assert drawn <= {"Generator", "default_rng"}, named(path)


def test_there_are_cores_to_look_at() -> None:
    """The two rules above are not kept by looking nowhere."""
    names = {named(path) for path in CORES}
    assert {
        "agent/deltaswarm_agent/agent_core.py",
        "agent/deltaswarm_agent/controllers/paper/controller.py",
        "agent/deltaswarm_wire/envelope.py",
        "operator/deltaswarm_operator/workload.py",
        "world/deltaswarm_world/core.py",
    } <= names
    assert "zenoh" in set(imported(ROOT / "agent" / "deltaswarm_agent" / "process.py"))


@pytest.mark.parametrize("folder", [*SOURCES, "tests"])
def test_files_are_short(folder: str) -> None:
    """A file that grows past 400 lines is telling of a missing idea."""
    long = {named(path): path.read_text().count("\n") for path in modules(folder)}
    assert {name: lines for name, lines in long.items() if lines >= MAX_LINES} == {}


SETTINGS: list[Any] = [
    found
    for module in (
        *(wire_settings, settings_downlink, settings_fault, settings_obstacles),
        *(settings_operator, settings_radio, settings_uplink),
        *(paper_settings, central_settings, potential),
    )
    for found in vars(module).values()
    if dataclasses.is_dataclass(found) and getattr(found, "__module__", "") == module.__name__
    if found is not settings_fault.FaultKind  # a row of a table, and no settings
]


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda found: found.__name__)
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
