"""Read files that people write, such as TOML and tables: UTF-8 from any editor; errors name the place."""

import os
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

MAX_NAME_BYTES = 100
"""Length of a name that becomes part of a file's name, to which numbers and endings are added."""

FILE_NAME_RULE = (
    f"must be a file's name of at most {MAX_NAME_BYTES} bytes: without '/', '\\' and control characters, and without "
    "a dot or a space at its ends"
)


def is_file_name(text: str) -> bool:
    """Whether a text can be part of a file's name and stays in its folder."""
    is_clean = bool(text) and text.isprintable() and not {*"/\\"} & {*text} and text.strip(" .") == text
    return is_clean and len(text.encode(errors="surrogateescape")) <= MAX_NAME_BYTES


def is_utf8(path: str) -> bool:
    """Whether a path, as the system gives it, is UTF-8."""
    return not any("\udc80" <= letter <= "\udcff" for letter in path)


def working_folder_problem() -> str:
    """Say that the working folder was removed; "" if it is there."""
    try:
        os.getcwd()
    except OSError as error:
        return f"the working folder must exist ({error.strerror}): change to another one"
    return ""


def paths_that_are_not_utf8(given: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield what is no UTF-8 of a command line's arguments, the folders they lead to, and the process's own folders."""
    for text in given:
        if not is_utf8(text) or ("\0" not in text and os.path.lexists(text) and not is_utf8(os.path.realpath(text))):
            yield "the argument", text
    for what, path in (("the working folder", os.getcwd()), ("TMPDIR", os.environ.get("TMPDIR", ""))):
        if not is_utf8(path):
            yield what, path


def decoded(data: bytes) -> str:
    """Decode a file's content, with or without a byte order mark."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError("must be UTF-8 (got UTF-16): save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        place, wrong = error.start, f"byte 0x{data[error.start]:02x}"
    else:
        if "\0" not in text:
            return text
        place, wrong = data.index(b"\0"), "a NUL character, as in UTF-16"
    line, column = data.count(b"\n", 0, place) + 1, place - data.rfind(b"\n", 0, place)
    raise ValueError(f"line {line}, byte {column}: must be UTF-8 text (got {wrong}): save it as UTF-8")


def read_text(file: Path) -> str:
    """Read a file. Raises OSError; ValueError as `decoded`."""
    return decoded(file.read_bytes())


def parsed_toml(text: str) -> dict[str, Any]:
    """Parse TOML, which refuses keys that are given twice. Raises ValueError."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("must not be nested so deeply") from None


def read_toml(file: Path) -> dict[str, Any]:
    """Read a TOML file. Raises OSError, ValueError."""
    return parsed_toml(read_text(file))


def rows_of(text: str, delimiter: str = ",") -> tuple[list[str], list[tuple[int, dict[str, str]]]]:
    """Return a table's columns, and each row with its line. Spaces around cells do not count, nor do empty lines."""
    import csv  # a board without a table needs none

    reader = csv.reader(text.splitlines(keepends=True), delimiter=delimiter, strict=True)
    columns: list[str] = []
    rows: list[tuple[int, dict[str, str]]] = []
    try:
        for cells in reader:
            cells = [cell.strip() for cell in cells]
            if not any(cells):
                continue
            if not columns:
                columns = cells
                if twice := sorted({name or "''" for name in cells if cells.count(name) > 1}):
                    raise ValueError(f"line {reader.line_num}: columns must differ (got {', '.join(twice)} twice)")
                continue
            if len(cells) != len(columns):
                raise ValueError(
                    f"line {reader.line_num}: must have {len(columns)} cells, as the header (got {len(cells)})"
                )
            rows.append((reader.line_num, dict(zip(columns, cells, strict=True))))
    except csv.Error as error:
        raise ValueError(f"line {reader.line_num + 1}: {error}") from None
    if not rows:
        raise ValueError(
            f"line 1: must be a header, with at least one row below (got {'no row' if columns else 'an empty file'})"
        )
    return columns, rows
