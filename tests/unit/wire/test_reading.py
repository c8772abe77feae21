"""Files of people: any editor's layout is read, and what is no UTF-8 or no table is named by its place."""

import os
from pathlib import Path

import numpy as np
import pytest

from deltaswarm_scenario.grid import read_grid
from deltaswarm_wire.arguments import Parser
from deltaswarm_wire.reading import decoded, is_file_name, read_text, read_toml, rows_of

BOM = b"\xef\xbb\xbf"


@pytest.mark.parametrize("data", [b"a = 1\nb = 2\n", BOM + b"a = 1\r\nb = 2\r\n", b"a = 1  \nb = 2"])
def test_every_editors_layout_is_read(data: bytes, tmp_path: Path) -> None:
    """A byte order mark, lines that end in CRLF, spaces at their ends, no end of the last line."""
    (tmp_path / "a.toml").write_bytes(data)
    assert read_toml(tmp_path / "a.toml") == {"a": 1, "b": 2}


@pytest.mark.parametrize(
    ("data", "place"),
    [
        ("a = 1".encode("utf-16"), "UTF-16"),
        ("a = 1".encode("utf-16-be"), "line 1, byte 1: .* NUL"),
        ("a = 1".encode("utf-32"), "UTF-16"),
        (b"a = 1\nb = '\xe9'\n", r"line 2, byte 6: .*0xe9"),
        (b"a = 1\n\0", "line 2, byte 1: .* NUL"),
    ],
)
def test_what_is_no_utf_8_is_named_by_its_place(data: bytes, place: str) -> None:
    with pytest.raises(ValueError, match=f"{place}.*save it as UTF-8"):
        decoded(data)


@pytest.mark.parametrize("text", ["a = 1\na = 2", "[t]\n[t]", "a = {b = 1, b = 2}", "a = " + "[" * 5000])
def test_doubled_keys_and_endless_nesting_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(ValueError, match=r"line|nested|document"):
        read_toml(tmp_path / "a.toml")


def test_a_table_is_read_with_its_lines() -> None:
    """Without spaces around cells, and without empty lines, which spreadsheets leave."""
    columns, rows = rows_of('a , b\r\n\r\n1, 2 \r\n,,\r\n"3\n4",5\r\n'.replace(",,", ","))
    assert columns == ["a", "b"]
    assert rows == [(3, {"a": "1", "b": "2"}), (6, {"a": "3\n4", "b": "5"})]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "an empty file"),
        ("\n \n", "an empty file"),
        ("a,b\n", "no row"),
        ("a,b,a\n1,2,3\n", "line 1: .*a twice"),
        ("a,b\n1,2\n3\n", "line 3: .*2 cells.*got 1"),
        ("a,b\n1,2,3\n", "line 2: .*2 cells.*got 3"),
        ('a,b\n1,"2\n', "line 2|line 3"),
    ],
)
def test_what_is_no_table_is_named_by_its_line(text: str, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        rows_of(text)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"1,2\n3,x\n", "line 2, column 2: .*'x'"),
        (b"# weights\n1,2\n3\n", "line 3: .*2 cells"),
        (b"1,2\n-3,4\n", "row 2, column 1: .*-3"),
        (b"1,nan\n", "row 1, column 2: .*nan"),
        (b"1,1e999\n", "row 1, column 2: .*inf"),
        (b"0,0\n", "positive"),
        (b"", "at least one cell"),
        (b"# nothing\n", "at least one cell"),
        (b"1,\xe9\n", "line 1, byte 3"),
    ],
)
def test_a_wrong_cell_of_a_grid_is_named(data: bytes, told: str, tmp_path: Path) -> None:
    (tmp_path / "grid.csv").write_bytes(data)
    with pytest.raises(ValueError, match=told):
        read_grid(str(tmp_path / "grid.csv"))


def test_a_grid_of_a_spreadsheet_or_of_numpy_is_read(tmp_path: Path) -> None:
    (tmp_path / "grid.csv").write_bytes(BOM + b"1, 2\r\n3 ,4\r\n")
    assert read_grid(str(tmp_path / "grid.csv")).tolist() == [[1.0, 2.0], [3.0, 4.0]]
    np.save(tmp_path / "grid.npy", np.array([[1, 2]]))
    assert read_grid(str(tmp_path / "grid.npy")).tolist() == [[1.0, 2.0]]
    np.save(tmp_path / "grid.npy", np.array([[1.0, -2.0]]))
    with pytest.raises(ValueError, match="row 1, column 2"):
        read_grid(str(tmp_path / "grid.npy"))


@pytest.mark.parametrize("name", ["a", "A b-1.x", "é", "x" * 100])
def test_a_name_for_a_file(name: str) -> None:
    assert is_file_name(name)


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../x", "a/b", "/a", "a\\b", "a\0", "a\n", "\x1b[2J", " a", "a ", "a.", ".a", "x" * 101, "é" * 51],
)
def test_a_name_that_leaves_its_folder_or_breaks_a_line_is_none(name: str) -> None:
    assert not is_file_name(name)


def test_a_folder_that_is_not_utf_8_is_refused_by_every_parser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As an argument, behind a link, and as the working folder: in a line, before anything starts."""
    bad = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    bad.mkdir()
    (tmp_path / "link").symlink_to(bad)
    parser = Parser(prog="deltaswarm")
    parser.add_argument("folder")
    for given, where in ((str(bad), tmp_path), (str(tmp_path / "link"), tmp_path), ("ok", bad)):
        monkeypatch.chdir(where)
        with pytest.raises(SystemExit):
            parser.parse_args([given])
        assert "must be UTF-8" in capsys.readouterr().err.splitlines()[-1]
    monkeypatch.chdir(tmp_path)
    assert parser.parse_args(["café"]).folder == "café"


def test_a_file_that_is_not_there_is_an_error_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_text(tmp_path / "none.toml")
