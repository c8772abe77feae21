"""A folder is one process's, also where the file system has no locks."""

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.results.folder import FolderError, RunFolder
from deltaswarm_orchestrator.results.folder_lock import CLAIM, LOCK, LOCK_FILES, OWNER, FolderLock, HeldError, is_held
from deltaswarm_orchestrator.sweeps.folder import SweepFolder, SweepFolderError

KILLED = """
import errno, fcntl, os, sys
from pathlib import Path
from deltaswarm_orchestrator.results.folder_lock import FolderLock
def none(handle, operation):
    raise OSError(errno.ENOSYS, "Function not implemented")
fcntl.flock = none
lock = FolderLock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.readline()
os._exit(1)
"""


@pytest.fixture(params=[None, errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP], ids=lambda code: errno.errorcode.get(code))
def has_flock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether the file system has `flock`; if not, it says so in one of these ways."""
    code: int | None = request.param
    if code is not None:
        without_flock(monkeypatch, code)
    return code is None


def without_flock(monkeypatch: pytest.MonkeyPatch, code: int = errno.ENOSYS) -> None:
    def none(handle: int, operation: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("fcntl.flock", none)


def test_a_folder_is_held_until_it_is_let_go_of(tmp_path: Path, has_flock: bool) -> None:
    """Also under another name; others know meanwhile, and which process it is if there is no `flock`."""
    (tmp_path / "a").mkdir()
    assert is_held(tmp_path / "a") is False
    lock = FolderLock(tmp_path / "a")
    (tmp_path / "a").rename(tmp_path / "b")
    assert (lock.is_at(tmp_path / "a"), lock.is_at(tmp_path / "b")) == (False, True)
    assert is_held(tmp_path / "b") is True
    with pytest.raises(HeldError, match="^$" if has_flock else f"process {os.getpid()}"):
        FolderLock(tmp_path / "b")
    assert is_held(tmp_path / "b") is True
    for _ in range(2):
        lock.release()
        assert is_held(tmp_path / "b") is False
    FolderLock(tmp_path / "b").release()
    assert {path.name for path in (tmp_path / "b").iterdir()} == {LOCK}


def test_the_lock_of_a_killed_process_is_void(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_flock(monkeypatch)
    command = [sys.executable, "-c", KILLED, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        assert is_held(tmp_path) is True
        with pytest.raises(HeldError, match=f"process {process.pid}"):
            FolderLock(tmp_path)
        assert process.stdin is not None
        process.stdin.close()
        process.wait()
    assert is_held(tmp_path) is False
    owner = json.loads((tmp_path / OWNER).read_text())
    (tmp_path / OWNER).write_text(json.dumps([*owner[:2], os.getpid(), owner[3]]))
    assert is_held(tmp_path) is False
    lock = FolderLock(tmp_path)
    assert is_held(tmp_path) is True
    lock.release()


@pytest.mark.parametrize("owner", ['["node3", "another boot", 7, "7"]', "", "[1]"], ids=["elsewhere", "empty", "other"])
def test_an_owner_of_whom_nothing_is_known_here_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, owner: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the file to delete if it has ended: for runs and sweeps alike, in one line."""
    without_flock(monkeypatch)
    RunFolder(tmp_path / "run", force=False).release()
    out = str(tmp_path / "sweep")
    sweep = ["sweep", "smoke", "--set", "run.duration_s=20", "--repeats", "1", "--prove", "0", "-j", "1", "--out", out]
    assert main(sweep) == 0
    commands: dict[Path, list[str]] = {
        tmp_path / "run.part": ["run", "smoke", "--in-process", "--force", "--out", str(tmp_path / "run")],
        tmp_path / "sweep": sweep,
    }
    capsys.readouterr()
    for folder, command in commands.items():
        (folder / OWNER).write_text(owner)
        assert is_held(folder) is None
        assert main(command) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"delete {folder / OWNER}" in line
        assert "node3" in line or "node3" not in owner
        (folder / OWNER).unlink()
    RunFolder(tmp_path / "run", force=True).finish()
    assert main(sweep) == 0


def test_who_takes_over_is_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two that find the same owner dead cannot both put themselves in its place."""
    without_flock(monkeypatch)
    FolderLock(tmp_path).release()
    with subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdin=subprocess.DEVNULL) as process:
        process.wait()
    real: Callable[[FolderLock, str], bool] = FolderLock._create
    first: list[FolderLock] = []

    def create(self: FolderLock, name: str) -> bool:
        if name == CLAIM and not first:
            monkeypatch.setattr(FolderLock, "_create", real)
            first.append(FolderLock(tmp_path))
        return real(self, name)

    monkeypatch.setattr(FolderLock, "_create", create)
    with pytest.raises(HeldError, match=f"process {os.getpid()}"):
        FolderLock(tmp_path)
    assert is_held(tmp_path) is True
    assert {path.name for path in tmp_path.iterdir()} == {LOCK, OWNER}
    first[0].release()


def test_runs_and_sweeps_do_without_flock(tmp_path: Path, has_flock: bool) -> None:
    with RunFolder(tmp_path / "run", force=False) as folder:
        with pytest.raises(FolderError, match="run in progress"):
            RunFolder(tmp_path / "run", force=True)
        folder.finish()
    assert list((tmp_path / "run").iterdir()) == []
    sweep = SweepFolder(tmp_path / "sweep")
    with sweep.held("mine"), pytest.raises(SweepFolderError, match="another sweep"), sweep.held("mine"):
        pass
    with sweep.held("mine"):
        pass
    assert {path.name for path in (tmp_path / "sweep").iterdir()} & LOCK_FILES == {LOCK}
