"""Temporary folders do not pile up: what a killed process leaves, the next command removes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from deltaswarm_orchestrator.base.temporary import PREFIX, TemporaryFolder, locked_folder, new_folder, remove_left

LEAVE = """
import os, sys
from pathlib import Path
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
kept = TemporaryFolder(Path(sys.argv[1]))
(kept.path / "file").touch()
os.kill(os.getpid(), 9)
"""


def test_the_next_removes_what_a_killed_one_has_left(tmp_path: Path) -> None:
    """One in use stays; each ends with its block, or with its object."""
    with TemporaryFolder(tmp_path) as used:
        subprocess.run([sys.executable, "-c", LEAVE, str(tmp_path)], check=False)
        assert len(list(tmp_path.iterdir())) == 2
        kept = TemporaryFolder(tmp_path)
        assert {*tmp_path.iterdir()} == {used, kept.path}
    del kept
    assert not list(tmp_path.iterdir())


def test_nothing_of_others_is_removed(tmp_path: Path) -> None:
    """One whose lock is held stays, as does what has another name, and what a link of such a name leads to."""
    held, lock = locked_folder(tmp_path)
    left, other = tmp_path / f"{PREFIX}{'0' * 16}", tmp_path / f"{PREFIX}other"
    for folder in (left, other):
        folder.mkdir()
        (folder / "3.key").write_bytes(b"SECRET")
    (tmp_path / f"{PREFIX}{'1' * 16}").symlink_to(other)
    remove_left(tmp_path)
    assert (held.exists(), left.exists(), (other / "3.key").exists()) == (True, False, True)
    os.close(lock)
    remove_left(tmp_path)
    assert not held.exists()


def test_a_new_folder_is_there_once_it_is_whole(tmp_path: Path) -> None:
    """What fails before leaves nothing that the next attempt would refuse."""
    out = tmp_path / "some" / "new"
    with pytest.raises(OSError, match="full"), new_folder(out):
        raise OSError("the disk is full")
    assert not list(out.parent.iterdir())
    with new_folder(out) as folder:
        (folder / "file").touch()
        assert not out.exists()
    assert [path.name for path in out.parent.iterdir()] == ["new"]
    assert [path.name for path in out.iterdir()] == ["file"]
