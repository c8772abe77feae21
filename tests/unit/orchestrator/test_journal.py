"""A journal has every input that was begun, whatever was cut off, and the clock of the process that wrote it."""

import time
from pathlib import Path

import pytest

from deltaswarm_orchestrator.run import journal
from deltaswarm_orchestrator.run.journal import BEGIN, INPUT, STEP, Header, Journal, Row

ROWS = (Row(BEGIN, 5.0), Row(STEP, 6.5), Row(INPUT, 7.0, "person", b'{"type":"note"}'), Row(INPUT, 8.0, "person", None))


def written(file: Path) -> Header:
    header = Header("run", "identity", "boot", 5.0, 1000.0)
    made = Journal(file, header)
    for row in ROWS:
        made.append(row)
    made.close()
    return header


def test_what_is_written_is_read(tmp_path: Path) -> None:
    header = written(tmp_path / "j")
    assert Journal.read(tmp_path / "j") == (header, ROWS)


def test_it_is_continued_and_never_begun_over_another(tmp_path: Path) -> None:
    header = written(tmp_path / "j")
    more = Journal(tmp_path / "j", header, ROWS)
    more.append(Row(STEP, 9.0))
    more.close()
    assert Journal.read(tmp_path / "j") == (header, (*ROWS, Row(STEP, 9.0)))
    with pytest.raises(FileExistsError):
        Journal(tmp_path / "j", header)


def test_a_row_that_was_cut_off_is_cut_off_in_the_file(tmp_path: Path) -> None:
    """At whatever byte; a journal in which nothing had begun is removed."""
    header = written(tmp_path / "j")
    whole = (tmp_path / "j").read_bytes()
    seen = set()
    for length in range(len(whole)):
        file = tmp_path / f"j{length}"
        file.write_bytes(whole[:length])
        found = Journal.read(file)
        if found is None:
            assert not file.exists()
            continue
        assert found[0] == header
        assert found[1] == ROWS[: len(found[1])]
        seen.add(len(found[1]))
        Journal(file, header, found[1]).append(Row(STEP, 9.0))
        assert Journal.read(file) == (header, (*found[1], Row(STEP, 9.0)))
    assert seen == {1, 2, 3}


def test_zeros_that_a_power_cut_left_are_no_rows(tmp_path: Path) -> None:
    header = written(tmp_path / "j")
    whole = (tmp_path / "j").read_bytes()
    (tmp_path / "j").write_bytes(whole + bytes(100))
    assert Journal.read(tmp_path / "j") == (header, ROWS)
    assert (tmp_path / "j").read_bytes() == whole
    (tmp_path / "zeros").write_bytes(bytes(100))
    assert Journal.read(tmp_path / "zeros") is None


def test_there_may_be_none(tmp_path: Path) -> None:
    assert Journal.read(tmp_path / "j") is None


def test_the_clock_goes_on_after_the_machine_has_restarted(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the calendar: a minute has passed, and this machine's clock began anew."""
    now = Header.now("run", "identity")
    assert now.ahead_s == 0.0
    monkeypatch.setattr(journal, "_boot", lambda: "another")
    monkeypatch.setattr(time, "time", lambda: now.unix_s + 60.0)
    monkeypatch.setattr(time, "monotonic", lambda: 3.0)
    assert 3.0 + now.ahead_s == pytest.approx(now.wall_s + 60.0)
