"""The folder of a run under way: whose it is, what it replaces, and what is kept."""

import fcntl
import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.results import folder as run_folder
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.folder import FolderError, FolderTakenError, RunFolder
from deltaswarm_orchestrator.results.folder_lock import LOCK, is_held
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.run_tables import new_manifest
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml


def test_a_run_folder_has_its_name_when_it_is_whole(tmp_path: Path) -> None:
    target = tmp_path / "run"
    folder = RunFolder(target, force=False)
    scenario = load_scenario("smoke")
    folder.prepare(scenario, new_manifest(scenario, "in-process", "off"))
    assert [path.name for path in tmp_path.iterdir()] == ["run.part"]
    assert folder.finish() == target
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert (target / "scenario.toml").read_text() == to_toml(scenario)
    assert json.loads((target / "manifest.json").read_text())["seed"] == 1


@pytest.mark.parametrize("there", ["run", "run.part"])
def test_nothing_is_overwritten_without_force(tmp_path: Path, there: str) -> None:
    (tmp_path / there).mkdir()
    for name in ("manifest.json", "scenario.toml"):
        (tmp_path / there / name).touch()
    with pytest.raises(FolderError, match="--force replaces it"):
        RunFolder(tmp_path / "run", force=False)
    assert (tmp_path / there / "manifest.json").exists()
    RunFolder(tmp_path / "run", force=True).finish()
    assert not list((tmp_path / "run").iterdir())


@pytest.mark.parametrize("force", [False, True])
def test_a_run_under_way_is_never_replaced(tmp_path: Path, force: bool) -> None:
    """Not by force either: both would write into one folder, and the first to end would name a mixture its own."""
    scenario = load_scenario("smoke")
    with RunFolder(tmp_path / "run", force=False) as folder:
        folder.prepare(scenario, new_manifest(scenario, "in-process", "off"))
        with pytest.raises(FolderError, match="run in progress"):
            RunFolder(tmp_path / "run", force=force)
        assert (folder.path / "manifest.json").exists()
    RunFolder(tmp_path / "run", force=True).release()
    assert [path.name for path in tmp_path.iterdir()] == ["run.part"]


def test_only_runs_are_replaced_by_force(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No folder with anything else in it, no sweep, no file, and not the folder one is in, nor the one above."""
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "thesis").touch()
    monkeypatch.chdir(tmp_path / "work")
    (tmp_path / "sweep" / "runs").mkdir(parents=True)
    for name in ("manifest.json", "sweep.toml"):
        (tmp_path / "sweep" / name).touch()
    for target in (tmp_path / "work", tmp_path / "work" / "thesis", Path(), Path(".."), tmp_path / "sweep"):
        with pytest.raises(FolderError, match="replace"):
            RunFolder(target, force=True)
    assert (tmp_path / "work" / "thesis").exists()
    assert (tmp_path / "sweep" / "runs").exists()


def test_no_folder_is_taken_that_is_no_runs(tmp_path: Path) -> None:
    """Not one that is called as a run's folder is while it is written."""
    (tmp_path / "run.part").mkdir()
    (tmp_path / "run.part" / "thesis").touch()
    for force in (False, True):
        with pytest.raises(FolderError, match=r"run\.part"):
            RunFolder(tmp_path / "run", force=force)
    assert [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")] == ["run.part", "run.part/thesis"]


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("name", ["dangling", "linked", "dangling.part"])
def test_a_symbolic_link_is_refused_at_the_start(tmp_path: Path, name: str, force: bool) -> None:
    """Whether it leads somewhere or not: it could not be replaced at the end."""
    RunFolder(tmp_path / "run", force=False).finish()
    (tmp_path / name).symlink_to(tmp_path / ("run" if name == "linked" else "nowhere"))
    with pytest.raises(FolderError, match=r"symbolic link|not a run folder"):
        RunFolder(tmp_path / name.removesuffix(".part"), force=force)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["run", name])


def test_a_folder_has_a_name() -> None:
    with pytest.raises(FolderError, match="name"):
        RunFolder(Path("nowhere/.."), force=True)


def a_run(target: Path) -> None:
    target.mkdir()
    for name in ("manifest.json", "scenario.toml"):
        (target / name).write_text("another")


def work(target: Path) -> None:
    target.mkdir()
    (target / "thesis").touch()


APPEARS: dict[str, Callable[[Path], None]] = {
    "a run": a_run,
    "work": work,
    "a file": Path.touch,
    "a link": lambda target: target.symlink_to("nowhere"),
}


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("what", APPEARS)
def test_what_appears_during_a_run_is_replaced_only_if_it_is_a_run(tmp_path: Path, what: str, force: bool) -> None:
    target = tmp_path / "run"
    scenario = load_scenario("smoke")
    with RunFolder(target, force=force) as folder:
        folder.prepare(scenario, new_manifest(scenario, "in-process", "off"))
        APPEARS[what](target)
        if force and what == "a run":
            assert folder.finish() == target
            assert (target / "scenario.toml").read_text() == to_toml(scenario)
            assert [path.name for path in tmp_path.iterdir()] == ["run"]
            return
        before = target.lstat()
        with pytest.raises(FolderTakenError, match="whole run"):
            folder.finish()
    assert os.path.samestat(target.lstat(), before)
    assert (folder.path / "scenario.toml").read_text() == to_toml(scenario)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "run.part"]


def test_the_command_keeps_a_run_whose_name_was_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line and exit code 1; `info` shows the whole run."""
    written = run_tables.write_tables

    def then_it_appears(folder: Path, outcome: Outcome, *, keep_unmerged: bool) -> None:
        written(folder, outcome, keep_unmerged=keep_unmerged)
        work(tmp_path / "run")

    monkeypatch.setattr(run_tables, "write_tables", then_it_appears)
    short = ["run", "smoke", "--set", "run.duration_s=20", "--record", "off", "--in-process"]
    assert main([*short, "--out", str(tmp_path / "run"), "--force"]) == 1
    printed = capsys.readouterr()
    (line,) = [line for line in printed.err.splitlines() if line.startswith("deltaswarm: ")]
    assert str(tmp_path / "run.part") in line
    assert (tmp_path / "run" / "thesis").exists()
    assert main(["info", str(tmp_path / "run.part"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["state"] == "complete"


MOMENTS = [
    (Path, "mkdir", 1),
    (run_folder, "FolderLock", 1),
    (run_folder, "FolderLock", 2),
    (fcntl, "flock", 2),  # when the folder of an interrupted run is open, but not locked yet
    (Path, "rename", 1),
    (Path, "rename", 2),
]


@pytest.mark.parametrize("moment", MOMENTS, ids=lambda moment: f"{moment[1]} {moment[2]}")
def test_of_two_runs_one_gets_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: tuple[object, str, int]
) -> None:
    """Whenever the second begins while the first makes it; the other is refused, and takes nothing from it."""
    a_run(tmp_path / "run.part")
    owner, name, call = moment
    real = getattr(owner, name)
    had: list[RunFolder] = []
    calls = count(1)

    def attempt() -> None:
        with suppress(FolderError):
            had.append(RunFolder(tmp_path / "run", force=True))

    def interrupted(*arguments: object, **named: object) -> object:
        if next(calls) == call:
            attempt()
        return real(*arguments, **named)

    monkeypatch.setattr(owner, name, interrupted)
    attempt()
    monkeypatch.undo()
    assert next(calls) > call
    (kept,) = had
    assert is_held(kept.path)
    assert [path.name for path in kept.path.iterdir()] == [LOCK]
    assert [path.name for path in tmp_path.iterdir()] == ["run.part"]
    kept.finish()


def test_what_a_resume_needs_is_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scenario, and the names that lead to it, whatever becomes of the machine."""
    synced: set[int] = set()
    sync = os.fsync

    def noted(file: int) -> None:
        synced.add(os.fstat(file).st_ino)
        sync(file)

    monkeypatch.setattr(os, "fsync", noted)
    with RunFolder(tmp_path / "run", force=False) as folder:
        folder.prepare(load_scenario("smoke"), {})
        needed = tmp_path, folder.path, folder.path / "scenario.toml"
        assert {path.stat().st_ino for path in needed} <= synced


CROWD = """
import errno, fcntl, os, sys
from pathlib import Path
from deltaswarm_orchestrator.results.folder_lock import LOCK_FILES, is_held
from deltaswarm_orchestrator.results.folder import FolderError, RunFolder

def none(handle, operation):
    raise OSError(errno.ENOSYS, "Function not implemented")

top, has_flock = Path(sys.argv[1]), sys.argv[2] == "True"
if not has_flock:
    fcntl.flock = none

def once():
    try:
        folder = RunFolder(top / "run", force=True)
    except FolderError:
        return 1
    os.close(os.open(top / "busy", os.O_CREAT | os.O_EXCL))
    (folder.path / "mine").touch()
    assert is_held(folder.path)
    assert {path.name for path in folder.path.iterdir()} - LOCK_FILES == {"mine"}
    (folder.path / "mine").rename(folder.path / "scenario.toml")
    os.unlink(top / "busy")
    return 0  # without letting go, as one that is killed

had = 0
print("ready", flush=True)
sys.stdin.readline()
while had < 10:
    if not (child := os.fork()):
        code = 2
        try:
            code = once()
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code != 2
    had += code == 0
"""


@pytest.mark.processes
@pytest.mark.parametrize("has_flock", [True, False])
def test_of_many_runs_at_once_one_has_the_folder(tmp_path: Path, has_flock: bool) -> None:
    """Each by force and after one that was killed; with a file system's locks as without them."""
    command = [sys.executable, "-c", CROWD, str(tmp_path), str(has_flock)]
    crowd = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    for one in crowd:
        assert one.stdout is not None
        assert one.stdout.readline() == "ready\n"
    for one in crowd:
        assert one.stdin is not None
        one.stdin.write("\n")
        one.stdin.flush()
    assert [one.communicate() for one in crowd] == [("", "")] * 3
    assert [path.name for path in tmp_path.iterdir()] == ["run.part"]
