"""The commit of the code is known however deltaswarm was installed, and a run says which cores it could use."""

import importlib.util
import os
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest

from deltaswarm_orchestrator.base import provenance

ROOT = Path(__file__).parents[3]


@pytest.fixture
def commit_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], str]:
    """What a build takes for the commit of its sources; builds have hatchling, which tests need not have."""
    interface = types.ModuleType("interface")
    interface.BuildHookInterface = dict  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "hatchling.builders.hooks.plugin.interface", interface)
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: Callable[[Path], str] = module.commit_of
    return found


def git(folder: Path, *arguments: str) -> str:
    identity = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    done = subprocess.run(["git", "-C", folder, *identity, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_build_knows_the_commit_of_a_clone_and_of_a_source_archive(
    tmp_path: Path, commit_of: Callable[[Path], str]
) -> None:
    """A changed clone is marked; a folder inside somebody else's checkout has no commit."""
    clone, archive = tmp_path / "clone", tmp_path / "clone" / "archive"
    clone.mkdir()
    for name in (".git_archival.txt", ".gitattributes"):
        (clone / name).write_text((ROOT / name).read_text())
    (clone / ".gitignore").write_text("archive\n")
    git(clone, "init", "-q")
    assert commit_of(clone) == ""
    git(clone, "add", ".")
    git(clone, "commit", "-qm", "x")
    head = git(clone, "rev-parse", "HEAD")
    assert commit_of(clone) == head
    archive.mkdir()
    assert commit_of(archive) == ""
    (archive / ".git_archival.txt").write_text(git(clone, "show", "HEAD:.git_archival.txt"))
    assert commit_of(archive) == ""
    packed = tmp_path / "packed.tar"
    git(clone, "archive", "-o", str(packed), "HEAD")
    subprocess.run(["tar", "-xf", packed, "-C", archive], check=True)
    assert commit_of(archive) == head
    (clone / ".gitignore").write_text("archive\n# changed\n")
    assert commit_of(clone) == f"{head}-dirty"


def test_a_file_is_committed_as_it_is_or_not(tmp_path: Path) -> None:
    """Changed, new, ignored, in a repository without a commit, in none."""
    folder = tmp_path / "clone"
    folder.mkdir()
    for name in ("same", "changed", "new", "ignored"):
        (folder / name).write_text("1")
    (folder / ".gitignore").write_text("ignored\n")
    assert provenance.commit_of(folder / "same") == (None, False)
    git(folder, "init", "-q")
    assert provenance.commit_of(folder / "same") == (None, False)
    git(folder, "add", "same", "changed", ".gitignore")
    git(folder, "commit", "-qm", "x")
    (folder / "changed").write_text("2")
    head = git(folder, "rev-parse", "HEAD")
    found = {name: provenance.commit_of(folder / name) for name in ("same", "changed", "new", "ignored")}
    assert found == {"same": (head, True), "changed": (head, False), "new": (head, False), "ignored": (head, False)}


def test_the_cores_are_those_that_the_run_may_use() -> None:
    """And not all of the machine, of which a job on a cluster often has a few."""
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert provenance.host()["cores"] == 1
    finally:
        os.sched_setaffinity(0, allowed)
