"""Who takes part: withdrawal, a pilot, wrong numbers, and the number that keeps the balance."""

import errno
import json
import shutil
from collections import Counter
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.results.folder_lock import FolderLock
from deltaswarm_sessions import roster
from deltaswarm_sessions.links import Links
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.roster import next_number, renumber, withdraw
from deltaswarm_sessions.settings import load_session
from tests.support.complaints import Printed
from tests.support.sessions import Pretended, a_command, a_file, rows_of


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The command for sessions of two conditions, whose runs are pretended."""
    Pretended(monkeypatch)
    return a_command(tmp_path)


def test_a_withdrawn_participant_leaves_number_date_and_reason(
    command: list[str], tmp_path: Path, capsys: Printed
) -> None:
    """In the tables that were written before, too; the number is not given again."""
    for number in ("1", "2"):
        assert main([*command, "--participant", number]) == 0
    for name in ("data", "moved"):
        assert main([*command, "--table", str(tmp_path / name), "--format", "bids"]) == 0
    (tmp_path / "moved").rename(tmp_path / "elsewhere")
    assert main([*command, "--withdraw", "1", "--reason", "by mail"]) == 0
    printed = capsys.readouterr().out
    assert f"not reached: tables in {tmp_path / 'moved'}" in printed
    assert "back-ups" in printed
    assert not (tmp_path / "out" / "participant-001").exists()
    gone, left = rows_of(tmp_path / "data" / "participants.tsv")
    assert (gone["participant"], gone["withdrawn_because"], gone["language"]) == ("1", "by mail", "")
    assert gone["withdrawn"].startswith("20")
    assert (left["participant"], left["withdrawn"]) == ("2", "")
    assert {row["participant"] for row in rows_of(tmp_path / "data" / "runs.tsv")} == {"2"}
    assert [path.name for path in (tmp_path / "data" / "bids").glob("sub-*")] == ["sub-002"]
    assert main([*command, "--participant", "1"]) == 2
    assert "1 withdrew on 20" in capsys.readouterr().err
    assert next_number(load_session(command[1])[0], tmp_path / "out")["next"] == 3
    assert main([*command, "--withdraw", "2"]) == 0
    assert rows_of(tmp_path / "data" / "runs.tsv") == [], "the last one, too"
    assert main([*command, "--withdraw", "2", "--reason", "again"]) == 0
    assert [row["withdrawn_because"] for row in rows_of(tmp_path / "data" / "participants.tsv")] == ["by mail", ""]
    assert main([*command, "--withdraw", "3"]) == 2


@pytest.mark.parametrize("copies", [["out"], ["out", "data"]])
def test_a_withdrawal_in_a_copy_leaves_the_original_as_it_is(
    command: list[str], tmp_path: Path, capsys: Printed, copies: list[str]
) -> None:
    """Tables that were copied with the sessions are written again, those of the original are not."""
    for number in ("1", "2"):
        assert main([*command, "--participant", number]) == 0
    assert main([*command, "--table", str(tmp_path / "data")]) == 0
    for name in copies:
        shutil.copytree(tmp_path / name, tmp_path / "copy" / name)
    of_copy = [*command[: command.index("--out")], "--out", str(tmp_path / "copy" / "out")]
    assert main([*of_copy, "--withdraw", "1", "--reason", "by mail"]) == 0
    assert [row["withdrawn"] for row in rows_of(tmp_path / "data" / "participants.tsv")] == ["", ""]
    assert (tmp_path / "out" / "participant-001").exists()
    copied = tmp_path / "copy" / "data"
    if "data" in copies:
        assert [bool(row["withdrawn"]) for row in rows_of(copied / "participants.tsv")] == [True, False]
    else:
        assert f"not reached: tables in {copied}" in capsys.readouterr().out


def test_nothing_is_withdrawn_or_renumbered_while_a_session_is_under_way(command: list[str], tmp_path: Path) -> None:
    """Its folder is held."""
    assert main([*command, "--participant", "1"]) == 0
    out = tmp_path / "out"
    lock = FolderLock(out / "participant-001")
    for attempt in (lambda: withdraw(out, 1, ""), lambda: renumber(out, 1, 2)):
        with pytest.raises(CommandError, match="under way"):
            attempt()
    assert next_number(load_session(command[1])[0], out)["counted"] == [1]
    lock.release()
    assert (out / "participant-001" / "session.json").exists()
    assert not roster.read(out).withdrawn


def test_tables_are_written_from_what_is_only_read(
    command: list[str], tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder without write permission, or without its roster; no other command goes on, and both are told."""
    assert main([*command, "--participant", "1"]) == 0
    assert roster.read(tmp_path / "out").begun == (1,)
    table = [*command, "--table", str(tmp_path / "data")]

    def refuse(folder: Path) -> FolderLock:
        raise PermissionError(errno.EACCES, "Permission denied", str(folder))

    with monkeypatch.context() as patch:
        patch.setattr(roster, "FolderLock", refuse)
        for options, code, said in ((table, 0, "--withdraw will not find"), ([*command, "--next"], 1, "Permission")):
            assert main(options) == code
            assert said in capsys.readouterr().err
    (tmp_path / "out" / "roster.json").unlink()
    for options, code in ((table, 0), ([*command, "--next"], 2)):
        assert main(options) == code
        assert "roster.json is missing" in capsys.readouterr().err


def test_a_pilot_has_a_folder_and_a_column(command: list[str], tmp_path: Path) -> None:
    """Its participants use up no number of the study."""
    assert main([*command, "--participant", "1", "--pilot"]) == 0
    assert (tmp_path / "out" / "pilot" / "participant-001").exists()
    assert main([*command, "--table", str(tmp_path / "data")]) == 2
    assert main([*command, "--table", str(tmp_path / "data"), "--pilot"]) == 0
    for table in ("participants", "runs"):
        assert {row["pilot"] for row in rows_of(tmp_path / "data" / f"{table}.tsv")} == {"1"}
    assert next_number(load_session(command[1])[0], tmp_path / "out")["next"] == 1


def test_a_corrected_number_keeps_the_order(command: list[str], tmp_path: Path, capsys: Printed) -> None:
    """The session goes on under the new number; the wrong one is free for its owner."""
    assert main([*command, "--participant", "1"]) == 0
    folder = tmp_path / "out" / "participant-001"
    before = json.loads((folder / "session.json").read_text())["runs"]
    (folder / f"2-{before[2]['condition']}").rename(tmp_path / "undone")
    assert main([*command, "--renumber", "1", "2"]) == 0
    assert roster.read(tmp_path / "out").begun == (2,)
    assert main([*command, "--participant", "2"]) == 0
    record = json.loads((tmp_path / "out" / "participant-002" / "session.json").read_text())
    assert [run["condition"] for run in record["runs"]] == [run["condition"] for run in before]
    assert (record["participant"], record["allocated"], record["corrected"][0]["from"]) == (2, 1, 1)
    assert main([*command, "--participant", "1"]) == 0
    assert main([*command, "--table", str(tmp_path / "data")]) == 0
    rows = rows_of(tmp_path / "data" / "participants.tsv")
    assert [(row["participant"], row["allocated"]) for row in rows] == [("1", "1"), ("2", "1")]
    assert main([*command, "--renumber", "1", "2"]) == 2
    assert "must end with a number that is free" in capsys.readouterr().err


def test_a_number_that_was_corrected_is_not_offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its owner may come yet, although nobody has done its order to the end."""
    Pretended(monkeypatch, {}, {"complete": False})
    command = a_command(tmp_path)
    assert main([*command, "--participant", "1"]) == 1
    assert main([*command, "--renumber", "1", "2"]) == 0
    found = next_number(load_session(command[1])[0], tmp_path / "out")
    assert (found["next"], found["not_complete"]) == (3, [2])


def test_a_number_that_a_link_has_is_for_nobody_else(command: list[str], tmp_path: Path, capsys: Printed) -> None:
    """Else two people would do one session, and one of them would get the code for the other's data."""
    assert main([*command, "--participant", "4"]) == 0
    links = Links()
    for number in (1, 2, None):
        links.add(number)
    links.write(tmp_path / "out")
    capsys.readouterr()
    assert main([*command, "--next"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "3"
    for given in (["--participant", "2"], ["--renumber", "4", "2"]):
        assert main([*command, *given]) == 2
        assert f"{given[0]} must not be a number that a link has (got 2" in capsys.readouterr().err
    assert main([*command, "--renumber", "4", "3"]) == 0


def test_a_share_without_a_free_number_says_so(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="is free"):
        next_number(load_session(str(a_file(tmp_path, 2)))[0], tmp_path, (), (9999, 9999))


def test_the_next_number_keeps_the_balance_after_drop_outs(command: list[str], tmp_path: Path) -> None:
    """With the numbers it gives, orders and streams are balanced in a group of those who came to the end."""
    file, out = Path(command[1]), tmp_path / "out"
    file.write_text(file.read_text().replace("speed = 5.0", "speed = 5.0\narrival_sets = 2"))
    settings, beside = load_session(command[1])
    drops = {2, 5, 6}
    done: list[tuple[object, ...]] = []
    while len(done) < 8:
        number = next_number(settings, out)["next"]
        is_done = number not in drops
        runs = [
            {"place": place, "condition": "x", "attempts": [{"folder": "x", "complete": is_done or not place}]}
            for place in range(3)
        ]
        folder = out / f"participant-{number:03}"
        folder.mkdir(parents=True)
        (folder / "session.json").write_text(json.dumps({"participant": number, "runs": runs}))
        if is_done:
            done.append(tuple((run.label, run.stream) for run in plan(settings, number, beside)[1:]))
    assert set(Counter(done).values()) == {1}
    found = next_number(settings, out)
    assert set(found["not_complete"]) == drops
    assert len(found["counted"]) == 8


def test_machines_that_share_a_study_give_other_numbers_in_whole_groups(tmp_path: Path) -> None:
    """Two conditions with crossed streams make groups of four."""
    settings, _ = load_session(str(a_file(tmp_path, 2)))
    given: dict[int, list[int]] = {1: [], 2: [], 3: []}
    for mine, numbers in given.items():
        for _ in range(8):
            numbers.append(next_number(settings, tmp_path, numbers, (mine, 3))["next"])
    assert {mine: sorted(numbers) for mine, numbers in given.items()} == {
        1: [1, 2, 3, 4, 13, 14, 15, 16],
        2: [5, 6, 7, 8, 17, 18, 19, 20],
        3: [9, 10, 11, 12, 21, 22, 23, 24],
    }
