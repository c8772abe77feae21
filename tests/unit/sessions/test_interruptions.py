"""What a folder of sessions keeps: one command at a time, nothing half done, and no change unseen."""

import json
import multiprocessing
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_cli import report
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import FAILED
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_sessions import roster, tables
from deltaswarm_sessions.folder import RECORD, read_record
from tests.support.complaints import Printed
from tests.support.sessions import a_command, a_participant, edited, rows_of

STEPS = {"roster.json", "session.json", "seal.json", "participants.tsv", "participant-002", "commitment.json", "bids"}
"""Files and folders before whose renaming a command is killed."""


@pytest.fixture
def command(tmp_path: Path) -> list[str]:
    """The command for a folder with sessions of participants 1 and 3."""
    for number in (1, 3):
        a_participant(tmp_path / "out", number, "A")
    return a_command(tmp_path)


def test_withdrawals_side_by_side_are_all_noted(command: list[str], tmp_path: Path) -> None:
    """Each waits for the others."""
    for number in range(4, 9):
        a_participant(tmp_path / "out", number, "AB")
    fork = multiprocessing.get_context("fork")
    start = fork.Barrier(6)

    def withdraw(number: int) -> None:
        start.wait(60)
        sys.exit(main([*command, "--withdraw", str(number)]))

    processes = [fork.Process(target=withdraw, args=(number,)) for number in range(3, 9)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(120)
    assert [process.exitcode for process in processes] == [0] * 6
    assert sorted(one.participant for one in roster.read(tmp_path / "out").withdrawn) == [*range(3, 9)]


@pytest.mark.parametrize(
    "options", ["--withdraw 1", "--renumber 1 2", "--next", "--table data", "--freeze", "--participant 9"]
)
def test_a_command_that_waits_in_vain_is_refused(
    options: str, command: list[str], tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It names the folder and changes nothing."""
    monkeypatch.setattr(roster, "WAIT_S", 0.0)
    monkeypatch.setattr(report, "run_and_report", lambda *_, **__: FAILED)
    monkeypatch.chdir(tmp_path)
    lock = FolderLock(tmp_path / "out")
    before = sorted((tmp_path / "out").rglob("*"))
    assert main([*command, *options.split()]) == 1
    assert f"{tmp_path / 'out'} must be free" in capsys.readouterr().err
    assert sorted((tmp_path / "out").rglob("*")) == before
    lock.release()


def killed_at(step: int, options: list[str]) -> bool:
    """Do a command in a process that is killed before a step, and say whether it was."""
    if child := os.fork():
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    left = [step]

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        if event == "shutil.rmtree" or (event == "os.rename" and Path(str(arguments[1])).name in STEPS):
            left[0] -= 1
            if not left[0]:
                os._exit(9)

    sys.addaudithook(watch)
    os._exit(min(main(options), 8))


@pytest.mark.parametrize("is_same", [False, True])
def test_a_withdrawal_that_is_killed_is_finished_by_the_next_command(
    is_same: bool, command: list[str], tmp_path: Path, capsys: Printed
) -> None:
    """Whatever it was killed in: data, exports and number are gone, or all is as before."""
    out, data = tmp_path / "out", tmp_path / "data"
    table, withdraw = [*command, "--table", str(data), "--format", "bids"], [*command, "--withdraw", "1"]
    assert main(table) == 0
    for folder in (out, data):
        shutil.copytree(folder, folder.with_suffix(".before"))
    step = 1
    while killed_at(step, withdraw):
        assert bool(roster.read(out).withdrawn) == (step > 1)
        assert main(withdraw if is_same else [*command, "--next"]) == 0
        noted, is_gone = roster.read(out), is_same or step > 1
        assert ([one.participant for one in noted.withdrawn], noted.unfinished) == ([1] * is_gone, ())
        there = {row["participant"] for row in rows_of(data / "runs.tsv")}
        assert ("1" in there, (data / "bids" / "sub-001").exists(), (out / "participant-001").exists()) == (
            (not is_gone,) * 3
        )
        assert [path for path in data.iterdir() if path.suffix == ".part"] == []
        for folder in (out, data):
            shutil.rmtree(folder)
            shutil.copytree(folder.with_suffix(".before"), folder)
        step += 1
    assert step > 6
    assert is_same or "--withdraw 1 was interrupted; it is finished now" in capsys.readouterr().err


@pytest.mark.parametrize("following", [["--next"], ["--renumber", "1", "2"]])
def test_a_correction_that_is_killed_is_finished_by_the_next_command(
    following: list[str], command: list[str], tmp_path: Path
) -> None:
    """No folder is left with another number than its record."""
    out = tmp_path / "out"
    shutil.copytree(out, tmp_path / "before")
    step = 1
    while killed_at(step, [*command, "--renumber", "1", "2"]):
        assert main([*command, *following]) == 0
        assert roster.read(out).unfinished == ()
        number = 1 if (out / "participant-001").exists() else 2
        record = read_record(out / f"participant-00{number}")
        assert (record["participant"], record.get("allocated", 1)) == (number, 1)
        assert following == ["--next"] or number == 2
        shutil.rmtree(out)
        shutil.copytree(tmp_path / "before", out)
        step += 1
    assert step == 5


def test_a_freeze_that_is_killed_is_there_or_not(tmp_path: Path, capsys: Printed) -> None:
    """If it is there, the next one tells the hash, which nobody has seen."""
    command = [*a_command(tmp_path), "--freeze"]
    assert killed_at(2, command)
    found = json.loads((tmp_path / "out" / "commitment.json").read_text())["hash"]
    assert main(command) == 2
    assert found in capsys.readouterr().err


def test_tables_that_are_cut_off_are_found_by_a_withdrawal(command: list[str], tmp_path: Path) -> None:
    """Where they are is noted before they are written."""
    data = tmp_path / "data"
    assert killed_at(3, [*command, "--table", str(data)])
    assert main([*command, "--table", str(data)]) == 0
    assert killed_at(4, [*command, "--table", str(data)])
    assert not (data / "seal.json").exists()
    assert main([*command, "--withdraw", "1"]) == 0
    assert "1" not in {row["participant"] for row in rows_of(data / "runs.tsv")}


def test_a_withdrawal_that_cannot_remove_the_folder_is_not_done(
    command: list[str], tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No table is written and no number given before it is."""
    real = shutil.rmtree

    def refuse(path: Path, **options: bool) -> None:
        if "participant-001" in str(path):
            raise PermissionError(13, "Permission denied", str(path))
        real(path, **options)

    monkeypatch.setattr(shutil, "rmtree", refuse)
    for options in (["--withdraw", "1"], ["--table", str(tmp_path / "data")], ["--next"]):
        assert main([*command, *options]) == 1
        assert "the withdrawal of 1 is not finished" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()
    assert main([*command, "--participant", "1"]) == 2
    monkeypatch.undo()
    assert main([*command, "--table", str(tmp_path / "data")]) == 0
    assert "1" not in {row["participant"] for row in rows_of(tmp_path / "data" / "runs.tsv")}


def test_a_full_disk_leaves_the_tables_as_they_were(
    command: list[str], tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With their seal and exports; a withdrawal says that it is not finished, and the next command finishes it."""
    data = tmp_path / "data"
    assert main([*command, "--table", str(data), "--format", "bids"]) == 0
    before = {file: file.read_bytes() for file in data.rglob("*") if file.is_file()}
    real, count = tables.write_csv, len([*data.glob("*.tsv")])
    for room in (0, 5, count):
        left = iter(range(room))

        def write(file: Path, *table: Any, left: Iterator[int] = left) -> None:
            if next(left, None) is None:
                raise OSError(28, "No space left on device", str(file))
            real(file, *table)

        monkeypatch.setattr(tables, "write_csv", write)
        assert main([*command, "--withdraw", "1"]) == 1
        assert "the withdrawal of 1 is not finished" in capsys.readouterr().err
        there = {file: file.read_bytes() for file in data.rglob("*") if file.is_file()}
        assert set(there) == set(before)
        changed = [file for file in before if there[file] != before[file]]
        assert [file for file in changed if room < count or "bids" in file.parts] == []
    monkeypatch.undo()
    assert main([*command, "--next"]) == 0
    assert "1" not in {row["participant"] for row in rows_of(data / "bids" / "sub-003" / "sub-003_scans.tsv")}
    assert not (data / "bids" / "sub-001").exists()


def test_a_folder_of_a_withdrawn_participant_is_in_no_table(
    command: list[str], tmp_path: Path, capsys: Printed
) -> None:
    """Such as one that was copied back."""
    assert main([*command, "--withdraw", "1"]) == 0
    a_participant(tmp_path / "out", 1, "AB")
    assert main([*command, "--table", str(tmp_path / "data")]) == 2
    assert "--withdraw 1 deletes it" in capsys.readouterr().err


CHANGES: list[Callable[[Path], object]] = [
    lambda roster: edited(roster, withdrawn=[]),
    lambda roster: (roster.parent / "commitment.json").unlink(),
    Path.unlink,
]


@pytest.mark.parametrize("change", CHANGES)
def test_no_change_of_what_is_kept_goes_unseen(
    change: Callable[[Path], object], command: list[str], tmp_path: Path, capsys: Printed
) -> None:
    """A deleted row, a deleted roster and a deleted commitment are refused, so no number comes back."""
    out = tmp_path / "out"
    assert main([*command, "--withdraw", "1"]) == 0
    (out / "commitment.json").write_text("{}")
    roster.write(out, roster.read(out))
    edited(out / "participant-003" / RECORD, begun="2026-11-28T00:00:00+00:00")
    change(out / "roster.json")
    for options in (["--next"], ["--participant", "1"], ["--withdraw", "3"], ["--renumber", "3", "1"]):
        assert main([*command, *options]) == 2
        error = capsys.readouterr().err
        assert "roster.json" in error or "commitment.json" in error
