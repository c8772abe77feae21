"""`deltaswarm compile`: where it may write, what pip must know, and that nothing stays of what does not work."""

import json
import os
import shutil
import subprocess
import sysconfig
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_orchestrator import compiling
from deltaswarm_orchestrator.compiling import CompileError, hint

ROOT = Path(__file__).parents[3]
SUFFIX = compiling.SUFFIXES[0]
BUILT = ("deltaswarm_wire/codec", "deltaswarm_world/core/world", "deltaswarm__mypyc")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installation, and a compiler that writes three libraries."""
    folder = tmp_path / "site"
    for source in compiling.sources_below([ROOT / part for part in ("agent", "world", "operator")]):
        place = folder / Path(*source.relative_to(ROOT).parts[1:])
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, place)
    for package in compiling.PACKAGES:
        (folder / package).mkdir(exist_ok=True)
    (folder / "RECORD").write_text("deltaswarm_wire/codec.py,sha256=x,1\n")

    def build(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        assert (Path(command[-1]) / "src" / "deltaswarm_wire" / "codec.py").is_file()
        for name in BUILT:
            file = Path(command[-1]) / "lib" / f"{name}{SUFFIX}"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(b"compiled")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(compiling, "site", lambda: folder)
    monkeypatch.setattr(compiling, "record_of", lambda: folder / "RECORD")
    monkeypatch.setattr(compiling, "check_compiler", lambda: None)
    monkeypatch.setattr(compiling, "digest_of_short_run", lambda: "as ever")
    monkeypatch.setattr(compiling.subprocess, "run", build)
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_what_was_compiled_is_beside_its_source_and_in_pips_list(site: Path) -> None:
    """Or it would outlive the next version, and take its place. Removed, all is as before."""
    before = content(site)
    for _ in range(2):  # the second time replaces the first
        assert {str(file.relative_to(site)) for file in compiling.install()} == {f"{name}{SUFFIX}" for name in BUILT}
        after = content(site)
        assert after.keys() - before.keys() == {f"{name}{SUFFIX}" for name in BUILT}
        assert sorted((site / "RECORD").read_text().splitlines()) == sorted(
            ["deltaswarm_wire/codec.py,sha256=x,1", *(f"{name}{SUFFIX},," for name in BUILT)]
        )
    assert len(compiling.remove()) == len(BUILT)
    assert content(site) == before
    assert compiling.remove() == []


def test_compiled_cores_that_change_a_digest_do_not_stay(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, digests = content(site), iter(["as ever", "another"])
    monkeypatch.setattr(compiling, "digest_of_short_run", lambda: next(digests))
    with pytest.raises(CompileError, match="digest as ever"):
        compiling.install()
    assert content(site) == before


def test_an_error_of_the_compiler_changes_nothing(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = content(site)
    failed = subprocess.CompletedProcess([], 1, "a\n" * 9, "codec.c:1: error: no room\n")
    monkeypatch.setattr(compiling.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(CompileError, match="no room"):
        compiling.install()
    assert content(site) == before


@pytest.mark.parametrize("command", [compiling.install, compiling.remove])
def test_an_installation_of_somebody_else_is_refused(command: Any, site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = content(site)
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "core")
    with pytest.raises(CompileError, match=r"core must be writable \(it belongs to "):
        command()
    assert content(site) == before


class Installed:
    """A distribution as pip left it."""

    files = ()

    def __init__(self, folder: Path, origin: dict[str, Any] | None) -> None:
        self._folder, self._origin = folder, origin

    def locate_file(self, name: str) -> Path:
        return self._folder / name

    def read_text(self, name: str) -> str | None:
        return None if self._origin is None else json.dumps(self._origin)


HERE = Path(compiling.__file__).parents[1]


@pytest.mark.parametrize(
    ("folder", "origin"),
    [(HERE, {"url": "file:///clone", "dir_info": {"editable": True}}), (Path("/elsewhere"), None)],
    ids=["editable", "another copy is imported"],
)
def test_sources_that_may_change_stay_pure(
    folder: Path, origin: dict[str, Any] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metadata, "distribution", lambda _: Installed(folder, origin))
    with pytest.raises(CompileError, match="editable installation stays pure"):
        compiling.site()
    monkeypatch.setattr(metadata, "distribution", lambda _: Installed(HERE, {"dir_info": {}}))
    assert compiling.site() == HERE
    with pytest.raises(CompileError, match="RECORD"):
        compiling.record_of()


def test_all_that_is_missing_is_said_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -pthread")
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(tmp_path))
    monkeypatch.setattr(metadata, "version", lambda name: {"mypy": "1.9.2", "setuptools": "80.1"}[name])
    with pytest.raises(CompileError, match=r"mypy>=1.14 .*no-such-compiler .*python3-dev") as raised:
        compiling.check_compiler()
    assert "setuptools" not in str(raised.value)


def test_what_compiled_cores_would_save_is_said_of_long_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    """From ten minutes on, and only where they are not compiled yet."""
    monkeypatch.setattr(compiling, "site", lambda: HERE)
    assert hint(599.0, "pure Python") is None
    assert hint(6000.0, "compiled") is None
    assert hint(6000.0, "pure Python") == (
        "compiled cores would save about 25 min of it, with equal results: `deltaswarm compile`"
    )
    monkeypatch.undo()
    monkeypatch.setattr(metadata, "distribution", lambda _: Installed(HERE, {"dir_info": {"editable": True}}))
    assert "pip install" in str(hint(6000.0, "pure Python"))
