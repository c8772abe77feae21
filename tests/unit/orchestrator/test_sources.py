"""What a third-party controller's results rest on: every file that decides what it does is in its digest."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator.base.provenance import data_of, sources
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.plugin_errors import PluginError
from tests.support.tiers import in_one_test

FILES = {
    "mine.py": """
        import json
        import numpy
        from helpers import rules
        from helpers.deep import Base
        from dataclasses import dataclass

        @dataclass(frozen=True)
        class NoSettings:
            pass

        class Mine(Base):
            Settings = NoSettings
            data_files = ("table.csv",)

            def step(self, percept):
                import late
    """,
    "late.py": "LIMIT = 3\n",
    "unused.py": "LIMIT = 3\n",
    "table.csv": "1,2\n",
    "helpers/__init__.py": "from . import constants\n",
    "helpers/constants.py": "LIMIT = 3\n",
    "helpers/rules.py": "LIMIT = 3\n",
    "helpers/deep/__init__.py": "from .base import Base\n",
    "helpers/deep/base.py": "from ..siblings import LIMIT\n\n\nclass Base:\n    pass\n",
    "helpers/siblings.py": "LIMIT = 3\n",
    "helpers/unused.py": "LIMIT = 3\n",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        lines = text.strip("\n").splitlines()
        indent = len(lines[0]) - len(lines[0].lstrip()) if lines else 0
        (tmp_path / name).write_text("\n".join(line[indent:] for line in lines) + "\n")
    return tmp_path


PROGRAM = """
import json, os, sys
from deltaswarm_orchestrator.base.provenance import sources
from deltaswarm_orchestrator.results.run_tables import new_manifest
from deltaswarm_orchestrator.scenarios.load import load_scenario
for name in ["", *sys.argv[1:]]:
    if name:
        with open(os.path.join(sys.path[1], name), "a") as file:
            file.write("# edited\\n")
    if os.fork() == 0:
        scenario = load_scenario("smoke", ["control.mode=mine:Mine"])
        manifest = new_manifest(scenario, "processes", "off")
        print(*(source.digest for source in sources(scenario)), json.dumps(manifest["controller"]), flush=True)
        os._exit(0)
    if os.wait()[1]:
        sys.exit(1)
"""


def sources_of(folder: Path, *edited: str) -> list[tuple[str, dict[str, Any]]]:
    """The digest and the manifest's entry at first and after each edit.

    Each as a new process sees it: a module that is loaded already does not change with its file.
    """
    environment = {**os.environ, "PYTHONPATH": f"{folder}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-c", PROGRAM, *edited]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = [line.split(" ", 1) for line in done.stdout.splitlines()]
    return [(digest, json.loads(controller)) for digest, controller in lines]


def test_every_file_that_it_imports_or_declares_counts(folder: Path) -> None:
    """Helpers in packages, relative and late imports, bases and data; not what nothing imports."""
    (before, controller), *edited = sources_of(folder, *FILES)
    assert controller["source"] == before
    modules = [name.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name in FILES if ".py" in name]
    assert controller["files"] == sorted(["data: table.csv", *(name for name in modules if "unused" not in name)])
    for name, (after, _) in zip(FILES, edited, strict=True):
        assert (after != before) == ("unused" not in name), name
        before = after


def test_a_file_that_it_declares_must_be_there(folder: Path) -> None:
    (folder / "table.csv").unlink()
    with pytest.raises(AssertionError, match=r"must be a controller whose files can be read: .*table\.csv"):
        sources_of(folder)


def test_shipped_controllers_are_identified_by_the_version() -> None:
    """Their code is in the digest of deltaswarm's own, as that of shipped faults is."""
    assert sources(load_scenario("smoke", ['fault=[{kind="kill",at_s=1,agents=[0]}]'])) == []


@in_one_test("wrong", [3, "table.csv", (3,)])
def test_data_files_must_be_paths(wrong: Any) -> None:
    kind = type("Own", (), {"data_files": wrong, "__module__": __name__})
    with pytest.raises(PluginError, match=rf"{__name__}:Own\.data_files must be a tuple of paths"):
        data_of(kind)
