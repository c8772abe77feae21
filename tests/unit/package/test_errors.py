"""What the system refuses: one line that names the file and what was written, from the command line and from Python."""

import errno
import os
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

import deltaswarm
from deltaswarm.errors import error_of
from deltaswarm_cli.main import main
from deltaswarm_wire.files import Written, write_secret, write_whole
from tests.support.complaints import Printed
from tests.support.sessions import a_file
from tests.support.tiers import in_one_test


@pytest.fixture
def no_room() -> Iterator[None]:
    """No file can get a byte, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(
    "command",
    [
        "new controller my_walk --out OUT",
        "certificates --agents 0 --out OUT",
        "certificates --operator-key OUT/key.pem",
        "session SESSION --freeze --out OUT",
        "study paper --freeze --out OUT",
        "sweep smoke --repeats 1 --prove 0 --quiet --out OUT",
    ],
)
def test_a_full_disk_ends_a_command_with_the_file_and_what_was_written(
    command: str, tmp_path: Path, capsys: Printed, request: pytest.FixtureRequest
) -> None:
    """In one line, with exit code 1; no half-written file is left."""
    session, out = a_file(tmp_path), tmp_path / "out"
    request.getfixturevalue("no_room")
    assert main([word.replace("SESSION", str(session)).replace("OUT", str(out)) for word in command.split()]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f"deltaswarm: {out}/" in line
    assert "could not be written: File too large; nothing was written" in line
    assert not [file for file in out.rglob("*") if file.is_file() and file.name != ".lock"]


def test_a_file_that_cannot_be_replaced_is_as_it_was(tmp_path: Path, no_room: None) -> None:
    """The error names it, although Python's own does not; a secret that cannot be written is not left."""
    file = tmp_path / "table.csv"
    file.touch()
    for write, path in ((write_whole, file), (write_secret, tmp_path / "secret")):
        with pytest.raises(OSError, match="File too large") as caught:
            write(path, b"x")
        assert caught.value.filename == str(path)
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


@in_one_test(
    ("error", "told"),
    [
        (OSError(errno.ENOSPC, "full", "a.csv"), "a.csv could not be written: full; only "),
        (OSError(errno.EDQUOT, "quota", "a.csv", None, "b.csv"), "b.csv could not be written: quota; only "),
        (OSError(errno.EACCES, "no", "a.csv"), "a.csv could not be read or written: no; only "),
        (OSError(errno.ENOSPC, "full"), "deltaswarm x failed: full; only "),
        (OSError(errno.EMFILE, "many", "a.csv"), "may not open more files"),
        (MemoryError(), "no memory left; only "),
    ],
)
def test_an_error_of_the_system_is_told_with_its_file(error: Exception, told: str, tmp_path: Path) -> None:
    Written.begin()
    write_whole(tmp_path / "first.csv", b"x")
    made = error_of(error, "deltaswarm x")
    assert made is not None
    assert made.code == 1
    assert told in str(made)
    assert "first.csv was written" in str(made)


def test_a_removed_working_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(SystemExit):
        main(["run", "smoke", "--dry-run"])
    assert "the working folder must exist" in capsys.readouterr().err
    with pytest.raises(deltaswarm.Error, match="the working folder must exist"):
        deltaswarm.run("smoke", out="run", progress=False)
    os.chdir(tmp_path)
